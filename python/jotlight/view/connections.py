"""Connections to the server, which end if their requests do not become complete.

The number of connections is limited. Without an end, a few clients that send nothing would keep the
page from everybody else.
"""

from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_WAITING = 10.0
"""Maximum time in seconds in which a connection waits for a complete request."""


class BoundedProtocol(H11Protocol):  # type: ignore[misc, unused-ignore]
    """HTTP by h11, which limits the size of a request. A connection ends that only waits."""

    def connection_made(self, transport: Any) -> None:
        """Begin a connection."""
        super().connection_made(transport)
        self.loop.call_later(MAX_WAITING, self._end_waiting)

    def _end_waiting(self) -> None:
        """Close the connection, unless a response is being computed, and look again later."""
        if self not in self.connections:  # it was closed, or is a WebSocket
            return
        if self.cycle is None or self.cycle.response_complete:
            self.transport.close()
        else:
            self.loop.call_later(MAX_WAITING, self._end_waiting)
