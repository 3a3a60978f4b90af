"""The server: pages, images, and attacks, over real sockets."""

import http.client
import json
import socket
import threading
import time
from contextlib import contextmanager, suppress

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
pytest.importorskip("starlette")
client = pytest.importorskip("websockets.sync.client")
exceptions = pytest.importorskip("websockets.exceptions")

from jotlight.images.tone import Tone  # noqa: E402
from jotlight.view.app import MAX_PAGES  # noqa: E402
from jotlight.view.serving import Server, serving  # noqa: E402
from jotlight.view.viewed import Viewed  # noqa: E402

PHOTO = jl.datasets.photograph("camera")[100:140, 180:240]
BITS = jl.Sensor(frames=200, max_intensity=4.0).expose(PHOTO, rng=0)


@pytest.fixture(scope="module")
def server():
    with serving(Viewed.from_bits(BITS, "<script>alert(1)</script>")) as running:
        yield running


def get(server, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in {"Host": f"127.0.0.1:{server.port}", **headers}.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def cookie(server):
    return {"Cookie": f"jotlight-{server.port}={server.token}"}


@contextmanager
def connected(server, origin=None, token=None, **options):
    token = server.token if token is None else token
    address = f"ws://127.0.0.1:{server.port}/stream?token={token}"
    origin = f"http://127.0.0.1:{server.port}" if origin is None else origin
    with client.connect(address, origin=origin or None, max_size=None, **options) as stream:
        yield stream


def read(stream):
    message = stream.recv(timeout=20)
    size = int.from_bytes(message[:4], "little")
    header = json.loads(message[4 : 4 + size])
    if header["type"] in ("image", "overlay"):
        stream.send('{"type": "ack"}')
    return header, np.frombuffer(message[4 + size :], np.uint8)


def ask(stream, number=1, moving=False, **state):
    state = {"window": 16, "method": "mle", "white": 1.0, **state}
    stream.send(json.dumps({"type": "view", "id": number, "moving": moving, "state": state}))


def read_until(stream, kind, stage=None):
    while True:
        header, payload = read(stream)
        assert header["type"] != "error" or kind == "error", header
        if header["type"] == kind and stage in (None, header.get("stage")):
            return header, payload


def receive_all(stream, timeout, received=None):
    """Receive until an error, and return its type."""
    while True:
        try:
            message = stream.recv(timeout=timeout)
        except (TimeoutError, exceptions.ConnectionClosed) as error:
            return type(error)
        if received is not None:
            received.append(message)


def is_alive(server):
    return get(server, "/", **cookie(server))[0].status == 200


def test_the_address_leads_to_the_page_and_sets_a_cookie(server):
    answer, _ = get(server, f"/?token={server.token}")
    assert (answer.status, answer.getheader("Location")) == (303, "/")
    given = answer.getheader("Set-Cookie")
    assert "HttpOnly" in given
    assert "samesite=strict" in given.lower()
    answer, body = get(server, "/", Cookie=given.split(";")[0])
    assert answer.status == 200
    assert b"<title>jotlight</title>" in body
    policy = answer.getheader("Content-Security-Policy")
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for name in ("main.js", "theme.css"):
        assert get(server, f"/page/{name}", **cookie(server))[0].status == 200


@pytest.mark.parametrize("path", ["/", "/page/main.js", "/save?format=png&state={}", "/?token=x"])
def test_nothing_is_served_without_the_token(server, path):
    answer, body = get(server, path)
    assert answer.status == 403
    assert b"token" in body
    assert server.token.encode() not in body


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


def test_images_are_those_of_the_library(server):
    with connected(server) as stream:
        hello, _ = read(stream)
        assert hello["title"] == "<script>alert(1)</script>"
        ask(stream, start=5, window=32, curve="gamma")
        header, levels = read_until(stream, "image", "final")
    expected = np.rint(255 * Tone("gamma", 1.0)(jl.mle(BITS[5:37])))
    assert (header["start"], header["window"], header["id"]) == (5, 32, 1)
    np.testing.assert_array_equal(levels.reshape(PHOTO.shape), expected)


def test_counts_come_first_and_are_refined(server):
    with connected(server) as stream:
        read(stream)
        ask(stream, method="network-medium")
        stages = []
        while not stages or stages[-1] != "final":
            stages.append(read_until(stream, "image")[0]["stage"])
    assert stages == ["counts", "mle", "final"]


def test_a_moving_slider_gets_the_newest_image(server):
    with connected(server) as stream:
        read(stream)
        for number in range(1, 120):
            ask(stream, number, moving=True, start=number)
        numbers = []
        while not numbers or numbers[-1] < 119:
            numbers.append(read_until(stream, "image")[0]["id"])
    assert numbers == sorted(numbers)
    assert len(numbers) < 119


def test_overlays_values_and_recipes_are_sent(server):
    with connected(server) as stream:
        read(stream)
        ask(stream, overlays=["jots", "saturated", "uncertainty"])
        kinds = [read_until(stream, "overlay")[0]["kind"] for _ in range(3)]
        assert kinds == ["jots", "saturated", "uncertainty"]
        stream.send('{"type": "probe", "row": 3, "column": 4}')
        values = read_until(stream, "values")[0]["values"]
        counts = BITS[:16].counts()
        assert values["counts"] == counts[3, 4]
        assert values["intensity"] == pytest.approx(jl.mle(BITS[:16])[3, 4])
        assert values["photons"] == pytest.approx(
            jl.reconstruct(BITS[:16], method="mle", units="photons")[3, 4]
        )
        stream.send('{"type": "probe", "row": 3000, "column": 4}')
        assert read_until(stream, "values")[0]["values"] is None
        stream.send('{"type": "recipe", "state": {"window": 4}}')
        assert "jl.reconstruct" in read_until(stream, "recipe")[0]["python"]


def test_the_difference_to_another_method_is_sent_in_color(server):
    with connected(server) as stream:
        read(stream)
        ask(stream, compare="network-medium")
        header, levels = read_until(stream, "image", "final")
    assert header["channels"] == 3
    assert levels.size == 3 * PHOTO.size
    assert header["tone"]["other"] == "network, medium"


def test_a_method_that_does_not_serve_the_sensor_is_an_error_not_an_end(server):
    with connected(server) as stream:
        read(stream)
        ask(stream, method="network-small")
        assert "medium" in read_until(stream, "error")[0]["text"]
        ask(stream, 2)
        assert read_until(stream, "image", "final")[0]["id"] == 2


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
        with pytest.raises(exceptions.InvalidStatus), connected(server):
            pass
    finally:
        for manager, _ in streams:
            manager.__exit__(None, None, None)
    wait_until(lambda: _can_connect(server))


def _can_connect(server):
    try:
        with connected(server):
            return True
    except exceptions.InvalidStatus:
        return False


def wait_until(condition, seconds=10):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


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


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_saved_images_are_attachments_with_safe_names(server, ending):
    state = json.dumps({"start": 1, "window": 4, "method": "mle"}).replace('"', "%22")
    path = f"/save?format={ending}&state={state.replace(' ', '')}"
    answer, body = get(server, path, **cookie(server))
    assert answer.status == 200
    assert answer.getheader("Content-Disposition").endswith(f'-1-5-mle.{ending}"')
    assert "<" not in answer.getheader("Content-Disposition")
    assert body[:4] in (b"\x89PNG", b"II*\0")


@pytest.mark.parametrize("query", ["", "format=exe&state={}", "format=png&state=x", "format=png"])
def test_bad_requests_to_save_are_refused(server, query):
    assert get(server, f"/save?{query}", **cookie(server))[0].status == 400


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


def test_the_token_differs_each_time_and_the_port_is_checked():
    one, other = Server(Viewed.from_bits(BITS)), Server(Viewed.from_bits(BITS))
    assert one.token != other.token
    assert len(one.token) >= 32
    with pytest.raises(OSError, match=f"port {one.port}"):
        Server(Viewed.from_bits(BITS), port=one.port)
    for each in (one, other):
        each._socket.close()
        each._workshop.close()
    with pytest.raises(OSError, match="no address"):
        Server(Viewed.from_bits(BITS), host="no.such.host.invalid")
    with pytest.raises(ValueError, match="port: expected"):
        Server(Viewed.from_bits(BITS), port=70_000)


def test_a_server_leaves_no_thread_behind():
    before = {thread.name for thread in threading.enumerate()}
    with serving(Viewed.from_bits(BITS)) as running, connected(running) as stream:
        read(stream)
    wait_until(
        lambda: (
            not any(
                thread.name.startswith("jotlight-view") and thread.name not in before
                for thread in threading.enumerate()
            )
        )
    )


def test_a_public_server_shows_a_name_and_accepts_its_addresses():
    running = Server(Viewed.from_bits(BITS), host="0.0.0.0")
    thread = threading.Thread(target=running.run, daemon=True)
    thread.start()
    try:
        wait_until(lambda: running._server.started)
        assert running.address.startswith(f"http://{socket.gethostname()}:")
        for host, status in (
            ("192.0.2.7", 200),
            (socket.gethostname(), 200),
            ("evil.example", 403),
        ):
            headers = {**cookie(running), "Host": f"{host}:{running.port}"}
            assert get(running, "/", **headers)[0].status == status
    finally:
        running.stop()
        thread.join(10)
