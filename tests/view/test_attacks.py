"""Attacks on the server are refused or bounded, and the server stays up."""

import socket
from contextlib import suppress

import pytest

pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
pytest.importorskip("starlette")
exceptions = pytest.importorskip("websockets.exceptions")

from jotlight.view.app import MAX_PAGES  # noqa: E402
from jotlight.view.viewed import Viewed  # noqa: E402
from streams import (  # noqa: E402
    ask,
    connected,
    cookie,
    get,
    is_alive,
    read,
    read_until,
    receive_all,
    wait_until,
)
from view_servers import serving  # noqa: E402


@pytest.mark.parametrize("path", ["/", "/page/main.js", "/save?format=png&state={}", "/?token=x"])
def test_nothing_is_served_without_the_token(server, path):
    answer, body = get(server, path)
    assert answer.status == 403
    assert b"token" in body
    assert server.token.encode() not in body


def test_a_refused_client_is_disconnected(server):
    """Otherwise, clients that read no answers would keep all connections."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=5) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        answer = b""
        while part := raw.recv(10_000):
            answer += part
    assert answer.startswith(b"HTTP/1.1 403")
    assert b"\r\nconnection: close\r\n" in answer.lower()


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1.evil.example"},
        {"Host": ""},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
    ],
)
def test_other_hosts_and_origins_are_refused(server, headers):
    assert get(server, "/", **{**cookie(server), **headers})[0].status == 403


@pytest.mark.parametrize(
    "path",
    [
        *("/../etc/passwd", "/page/../app.py", "/page/..%2fapp.py", "/page/%2e%2e/app.py"),
        *("/page/..%5c..%5capp.py", "/page//etc/passwd", "/page/%00", "/static/x", "/page/"),
        *("/page/main.js/../../app.py", "//etc/passwd", "/page/app.py", "/page/.."),
    ],
)
def test_no_path_leads_to_other_files(server, path):
    answer, body = get(server, path, **cookie(server))
    assert answer.status in (404, 405, 307)
    assert b"import" not in body
    assert b"root:" not in body


@pytest.mark.parametrize(
    ("origin", "token"),
    [("http://evil.example", None), ("null", None), ("", None), (None, "wrong"), (None, "")],
)
def test_foreign_websockets_are_refused(server, origin, token):
    with (
        pytest.raises(exceptions.InvalidStatus) as caught,
        connected(server, origin=origin, token=token),
    ):
        pass
    assert caught.value.response.status_code == 403


@pytest.mark.parametrize(
    "message",
    [
        *("", "{", "[]", '{"type": "x"}', '{"type": "view", "id": 1, "state": {"window": 0}}'),
        *('{"type": "view", "id": "1", "state": {}}', '{"type": "probe", "row": -1}'),
        *('{"type": "view", "id": 1, "state": {"__class__": 1}}', "x" * 20_000),
    ],
)
def test_invalid_messages_end_only_their_own_connection(server, message):
    with connected(server) as other:
        read(other)
        with connected(server) as stream:
            read(stream)
            stream.send(message)
            assert receive_all(stream, 10) is exceptions.ConnectionClosedError
        ask(other)
        assert read_until(other, "image", "final")[0]["id"] == 1


def test_the_number_of_pages_is_limited(server):
    streams = []
    try:
        for _ in range(MAX_PAGES):
            manager = connected(server)
            streams.append((manager, manager.__enter__()))
        with (
            connected(server) as stream,
            pytest.raises(exceptions.ConnectionClosedError, match="8 pages, which is the limit"),
        ):
            read(stream)
    finally:
        for manager, _ in streams:
            manager.__exit__(None, None, None)
    wait_until(lambda: _can_connect(server))


@pytest.mark.slow
def test_a_client_that_never_reads_gets_a_few_images_only(server):
    """Without confirmations, the server computes nothing more."""
    with connected(server) as stream:
        stream.recv()
        for number in range(200):
            ask(stream, number, moving=True, start=number % 100)
        received: list[bytes] = []
        assert receive_all(stream, 0.5, received) is TimeoutError
        assert len([each for each in received if b'"image"' in each[:200]]) <= 2
    assert is_alive(server)


@pytest.mark.parametrize("query", ["", "format=exe&state={}", "format=png&state=x", "format=png"])
def test_bad_requests_to_save_are_refused(server, query):
    assert get(server, f"/save?{query}", **cookie(server))[0].status == 400


@pytest.mark.slow
def test_broken_http_does_not_end_the_server(server):
    for data in (
        b"\0" * 1000,
        b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 20_000,
        b"GET",
        b"PUT / X\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", server.port), timeout=5) as raw:
            raw.sendall(data)
            raw.settimeout(0.5)
            with suppress(TimeoutError, ConnectionError):
                assert b"200 OK" not in raw.recv(1000)
    assert is_alive(server)


def test_many_connections_are_refused_not_fatal(server):
    sockets = []
    try:
        for _ in range(150):
            raw = socket.create_connection(("127.0.0.1", server.port), timeout=5)
            raw.sendall(b"GET / HTTP/1.1\r\n")  # never completed
            sockets.append(raw)
    finally:
        for raw in sockets:
            raw.close()
    wait_until(lambda: is_alive(server))


@pytest.mark.slow
def test_a_public_server_shows_a_name_and_accepts_its_addresses(bits):
    with serving(Viewed.from_data(bits), host="0.0.0.0") as running:
        assert running.address.startswith(f"http://{socket.gethostname()}:")
        for host, status in (
            ("192.0.2.7", 200),
            (socket.gethostname(), 200),
            ("evil.example", 403),
        ):
            headers = {**cookie(running), "Host": f"{host}:{running.port}"}
            assert get(running, "/", **headers)[0].status == status


def _can_connect(server):
    try:
        with connected(server) as stream:
            return read(stream)[0]["type"] == "hello"
    except exceptions.ConnectionClosedError:
        return False
