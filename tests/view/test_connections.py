"""Clients that send no complete request do not keep others from the page."""

import socket
import time

import pytest

pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
pytest.importorskip("starlette")
pytest.importorskip("websockets")

from jotlight.view import connections
from jotlight.view.serving import _MAX_CONNECTIONS
from jotlight.view.viewed import Viewed
from streams import connected, is_alive, read, wait_until
from view_servers import serving

# They wait for seconds.
pytestmark = pytest.mark.slow


@pytest.fixture
def patient_server(bits, monkeypatch):
    monkeypatch.setattr(connections, "MAX_WAITING", 1.0)
    with serving(Viewed.from_data(bits)) as running:
        yield running


@pytest.mark.parametrize("sent", [b"", b"GET / HTTP/1.1\r\nA: b\r\n"])
def test_clients_that_only_wait_are_disconnected(patient_server, sent):
    waiting = []
    try:
        for _ in range(_MAX_CONNECTIONS + 6):
            raw = socket.create_connection(("127.0.0.1", patient_server.port), timeout=20)
            raw.sendall(sent)
            waiting.append(raw)
        wait_until(lambda: _answers(patient_server))
        # The server ends the connections, not this test.
        assert waiting[0].recv(1) == b""
    finally:
        for raw in waiting:
            raw.close()


def test_the_rest_of_a_body_is_not_awaited(patient_server):
    """An answered request may have a body that arrives byte by byte."""
    address = "127.0.0.1", patient_server.port
    with socket.create_connection(address, timeout=0.1) as raw:
        raw.sendall(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\n")
        for _ in range(200):
            try:
                raw.sendall(b"x")
                if not raw.recv(1000):
                    break
            except TimeoutError:
                continue
            except ConnectionError:
                break
        else:
            pytest.fail("the connection stays open")


def test_pages_stay_connected(patient_server):
    with connected(patient_server) as page:
        read(page)
        time.sleep(1.5 * connections.MAX_WAITING)
        page.send('{"type": "recipe", "state": {}}')
        assert read(page)[0]["type"] == "recipe"


def _answers(server):
    try:
        return is_alive(server)
    except OSError:  # this client, too, has waited too long
        return False
