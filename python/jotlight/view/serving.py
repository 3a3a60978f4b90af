"""The server: a socket, an address with a token, and uvicorn."""

import secrets
import socket
import threading
import webbrowser

import uvicorn

from jotlight.view.access import LOOPBACK, Ticket, is_loopback, names_of
from jotlight.view.app import make_app
from jotlight.view.connections import BoundedProtocol
from jotlight.view.state import MAX_STATE_BYTES
from jotlight.view.viewed import Viewable
from jotlight.view.workshop import Workshop

_MAX_CONNECTIONS = 64
"""Maximum number of connections at a time. Further ones receive the status 503."""

_BACKLOG = 64
"""Maximum number of connections that wait to be accepted."""


class Server:
    """A server of one capture, and its address.

    Parameters
    ----------
    viewed : Viewable
        The capture.
    host : str
        Address to listen on. Default: this machine only.
    port : int
        Port. Default: any free one.
    token : str, optional
        The secret in the address. Default: a random one.

    Raises
    ------
    OSError
        When the port is in use, or the address is not of this machine.
    """

    def __init__(
        self, viewed: Viewable, host: str = LOOPBACK, port: int = 0, token: str | None = None
    ) -> None:
        self._socket = _listen(host, port)
        self.port = int(self._socket.getsockname()[1])
        self.token = token or secrets.token_urlsafe(24)
        # An address that stands for all addresses of this machine is none to connect to.
        name = socket.gethostname() if host in ("0.0.0.0", "::") else host  # noqa: S104
        shown = f"[{name}]" if ":" in name else name
        self._page = f"http://{shown}:{self.port}/"
        self.address = f"{self._page}?token={self.token}"
        """The address of the page."""
        self._ticket = Ticket()
        self._workshop = Workshop(viewed)
        app = make_app(
            self._workshop,
            self.token,
            names_of(host),
            self._ticket,
            port=self.port,
            any_address=not is_loopback(host),
        )
        config = uvicorn.Config(
            app,
            http=BoundedProtocol,
            access_log=False,  # addresses contain the token
            log_level="critical",
            lifespan="off",
            limit_concurrency=_MAX_CONNECTIONS,
            timeout_keep_alive=5,
            timeout_graceful_shutdown=1,
            ws_max_size=MAX_STATE_BYTES,
            ws_max_queue=8,
            ws_per_message_deflate=False,  # noise cannot be compressed
            server_header=False,
        )
        self._server = uvicorn.Server(config)

    def open_browser(self) -> None:
        """Open the page in the browser of this machine, in a thread.

        The socket listens already, so the page may be opened before :meth:`run`. A browser that
        runs in the terminal would wait for the server. The command line of the browser has a ticket
        in place of the token.
        """
        address = f"{self._page}?ticket={self._ticket.issue()}"
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    def run(self) -> None:
        """Serve until Ctrl-C, or until :meth:`stop` is called."""
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self._workshop.close()
            self._socket.close()

    def stop(self) -> None:
        """Stop serving soon."""
        self._server.should_exit = True


def _listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens."""
    if not 0 <= port <= 65535:
        raise ValueError(f"port: expected 0 to 65535, got {port}")
    try:
        [(family, _, _, _, address), *_] = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except socket.gaierror as error:
        raise OSError(f"host: {host} is no address of this machine ({error.strerror})") from error
    listening = socket.socket(family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(_BACKLOG)
    except OSError as error:
        listening.close()
        raise OSError(f"cannot listen on {host}, port {port}: {error.strerror}") from error
    return listening
