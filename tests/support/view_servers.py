"""The server of the viewer, in a thread."""

import contextlib
import threading

from jotlight.view.serving import Server
from streams import wait_until

_END_SECONDS = 10.0


@contextlib.contextmanager
def serving(viewed, **options):
    """Yield a server of a capture that runs while the block does, and raise what it raises."""
    server, failures = Server(viewed, **options), []

    def run():
        try:
            server.run()
        except BaseException as failure:  # uvicorn may also exit
            failures.append(failure)

    thread = threading.Thread(target=run, daemon=True, name="jotlight-view")
    thread.start()
    try:
        wait_until(lambda: server._server.started or not thread.is_alive())
        if thread.is_alive():
            yield server
    finally:
        server.stop()
        thread.join(_END_SECONDS)
        for failure in failures:
            raise failure
        assert not thread.is_alive(), "the server does not end"
