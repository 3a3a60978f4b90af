"""Who may use the server: checks of the token and of the headers Host and Origin.

A page of another site must not reach the server, even if its name resolves to this machine (DNS
rebinding). So the header Host must name this machine or an address, and the header Origin must name
the same host.
"""

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Collection
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

LOOPBACK = "127.0.0.1"


def is_loopback(host: str) -> bool:
    """Return whether an address to listen on is reached only from this machine.

    Examples
    --------
    >>> is_loopback("localhost"), is_loopback("::1"), is_loopback("0.0.0.0")
    (True, True, False)
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def names_of(host: str) -> frozenset[str]:
    """Return the names that the header Host may have for a server that listens on `host`.

    Any port is accepted, so that a tunnel may use another one.
    """
    names = {"localhost", LOOPBACK, "::1"}
    if not is_loopback(host):
        names |= {host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
    return frozenset(names)


def accepts_host(header: str | None, names: Collection[str], *, any_address: bool) -> bool:
    """Return whether the header Host names this server.

    Parameters
    ----------
    header : str, optional
        The header, such as "127.0.0.1:8000".
    names : collection of str
        Names of the server.
    any_address : bool
        Whether any IP address is accepted. A name that an attacker owns is no address.

    Examples
    --------
    >>> names = names_of("127.0.0.1")
    >>> accepts_host("localhost:8000", names, any_address=False)
    True
    >>> accepts_host("evil.example:8000", names, any_address=True)
    False
    """
    host = _host_of(f"//{header}") if header else None
    if host is None:
        return False
    if host in names:
        return True
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return any_address


def accepts_origin(origin: str | None, host: str | None, *, required: bool) -> bool:
    """Return whether the header Origin is that of a page of this server.

    Examples
    --------
    >>> accepts_origin("http://localhost:8000", "localhost:8000", required=True)
    True
    >>> accepts_origin("http://localhost:9", "localhost:8000", required=True)
    False
    >>> accepts_origin(None, "localhost:8000", required=False)
    True
    """
    if origin is None:
        return not required
    return host is not None and origin.lower() in (
        f"http://{host}".lower(),
        f"https://{host}".lower(),
    )


def accepts_token(given: str | None, token: str) -> bool:
    """Return whether a token is the right one, in a time that does not depend on its letters."""
    return given is not None and hmac.compare_digest(given.encode(), token.encode())


class Ticket:
    """A secret that is accepted once, in place of the token.

    All users of a machine can see the command line of a browser, which contains the address of the
    page. When the browser has used the ticket in it, the ticket is worthless to them.

    Examples
    --------
    >>> ticket = Ticket()
    >>> secret = ticket.issue()
    >>> ticket.redeem(secret), ticket.redeem(secret)
    (True, False)
    """

    def __init__(self) -> None:
        self._secret: str | None = None

    def issue(self) -> str:
        """Return a new secret. An earlier one is no longer accepted."""
        self._secret = secrets.token_urlsafe(24)
        return self._secret

    def redeem(self, given: str | None) -> bool:
        """Return whether a secret is the issued one. From then on, it is not accepted."""
        if self._secret is None or not accepts_token(given, self._secret):
            return False
        self._secret = None
        return True


def cookie_token(header: str | None, name: str) -> str | None:
    """Return the token in the header Cookie, or None.

    Examples
    --------
    >>> cookie_token("a=1; jotlight-8000=secret", "jotlight-8000")
    'secret'
    """
    try:
        cookies = SimpleCookie(header or "")
    except CookieError:
        return None
    return cookies[name].value if name in cookies else None


def _host_of(url: str) -> str | None:
    try:
        parts = urlsplit(url)
        _ = parts.port  # raises ValueError if it is no number
    except ValueError:
        return None
    if parts.path or parts.query or parts.fragment or parts.username is not None:
        return None
    return parts.hostname
