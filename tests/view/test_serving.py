"""The server: pages, images, and files, over real sockets."""

import json
import queue
import threading
import urllib.parse
import webbrowser

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
pytest.importorskip("starlette")
exceptions = pytest.importorskip("websockets.exceptions")

from jotlight.images.tone import Tone  # noqa: E402
from jotlight.view.facts import describe_capture  # noqa: E402
from jotlight.view.serving import Server  # noqa: E402
from jotlight.view.viewed import Viewed  # noqa: E402
from streams import (  # noqa: E402
    ask,
    connected,
    cookie,
    get,
    read,
    read_until,
    wait_until,
)
from view_servers import serving  # noqa: E402


def test_the_address_leads_to_the_page_and_sets_a_cookie(server):
    answer, _ = get(server, f"/?token={server.token}")
    assert (answer.status, answer.getheader("Location")) == (303, "/")
    given = answer.getheader("Set-Cookie")
    assert "HttpOnly" in given
    assert "samesite=lax" in given.lower()
    answer, body = get(server, "/", Cookie=given.split(";")[0])
    assert answer.status == 200
    assert b"<title>jotlight</title>" in body
    policy = answer.getheader("Content-Security-Policy")
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for name in ("main.js", "theme.css"):
        assert get(server, f"/page/{name}", **cookie(server))[0].status == 200


def test_the_address_on_the_command_line_of_a_browser_is_worthless_once_it_was_used(
    server, monkeypatch
):
    """All users of a machine can see command lines."""
    opened = queue.SimpleQueue()
    monkeypatch.setattr(webbrowser, "open", opened.put)
    server.open_browser()
    address = opened.get(timeout=20)
    assert server.token not in address
    path = address.removeprefix(f"http://127.0.0.1:{server.port}")
    assert path.startswith("/?ticket=")
    assert get(server, path.replace("/?", "/page/main.js?"))[0].status == 403
    assert get(server, path, Host="evil.example")[0].status == 403
    answer, _ = get(server, path)
    assert answer.status == 303
    assert server.token in answer.getheader("Set-Cookie")
    assert get(server, path)[0].status == 403
    assert get(server, "/?ticket=")[0].status == 403


def test_images_are_those_of_the_library(server, bits):
    with connected(server) as stream:
        hello, _ = read(stream)
        assert hello["title"] == "<script>alert(1)</script>"
        ask(stream, start=5, window=32, curve="gamma")
        header, levels = read_until(stream, "image", "final")
    expected = np.rint(255 * Tone("gamma", 1.0)(jl.mle(bits[5:37])))
    assert (header["start"], header["window"], header["id"]) == (5, 32, 1)
    np.testing.assert_array_equal(levels.reshape(bits.shape[1:]), expected)


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


def test_overlays_values_and_recipes_are_sent(server, bits):
    with connected(server) as stream:
        read(stream)
        ask(stream, overlays=["jots", "saturated", "uncertainty"])
        kinds = [read_until(stream, "overlay")[0]["kind"] for _ in range(3)]
        assert kinds == ["jots", "saturated", "uncertainty"]
        stream.send('{"type": "probe", "row": 3, "column": 4}')
        values = read_until(stream, "values")[0]["values"]
        counts = bits[:16].counts()
        assert values["counts"] == counts[3, 4]
        assert values["intensity"] == pytest.approx(jl.mle(bits[:16])[3, 4])
        assert values["photons"] == pytest.approx(
            jl.reconstruct(bits[:16], method="mle", units="photons")[3, 4]
        )
        stream.send('{"type": "probe", "row": 3000, "column": 4}')
        # The values of the first place may come once more, with its standard error.
        while read_until(stream, "values")[0]["values"] is not None:
            pass
        stream.send('{"type": "recipe", "state": {"window": 4}}')
        assert "jl.reconstruct" in read_until(stream, "recipe")[0]["python"]


def test_the_standard_error_of_a_pixel_is_that_of_the_library(server, bits):
    known = jl.uncertainty(bits[:16], method="mle").standard_error
    row, column = np.unravel_index(known.argmax(), known.shape)
    with connected(server) as stream:
        read(stream)
        ask(stream, overlays=["uncertainty"])
        read_until(stream, "overlay")
        stream.send(json.dumps({"type": "probe", "row": int(row), "column": int(column)}))
        values = {}
        while "error" not in values:
            values = read_until(stream, "values")[0]["values"] or {}
    assert values["error"] == [pytest.approx(known.max())]


def test_an_overlay_that_is_unknown_does_not_hide_the_others(photo):
    smooth = jl.Sensor(frames=40, oversampling=2, kernel="linear").expose(photo, rng=0)
    with serving(Viewed.from_data(smooth)) as server, connected(server) as stream:
        read(stream)
        overlays = ["uncertainty", "saturated"]
        ask(stream, method="noniterative-gaussian", overlays=overlays)
        first = read_until(stream, "overlay")[0]
        second = read_until(stream, "overlay")[0]
    assert [first["kind"], second["kind"]] == overlays
    assert "note" in first
    assert "largest" not in first


def test_a_file_that_has_vanished_is_named_when_an_image_is_saved(tmp_path, photo):
    path = tmp_path / "bits.npy"
    jl.save(jl.Sensor(frames=8).expose(photo, rng=0), path)
    viewed = Viewed.from_data(jl.open(path))
    path.unlink()
    with serving(viewed) as server:
        answer, body = get(server, "/save?format=tif&state={}", **cookie(server))
    assert answer.status == 400
    assert body.decode() == f"there is no file {path}"


def test_frames_that_do_not_exist_are_not_saved(server):
    state = urllib.parse.quote(json.dumps({"start": 500, "window": 16}))
    answer, body = get(server, f"/save?format=png&state={state}", **cookie(server))
    assert answer.status == 400
    assert b"expected some of 0 to 199" in body


def test_the_difference_to_another_method_is_sent_in_color(server):
    with connected(server) as stream:
        read(stream)
        ask(stream, compare="network-medium")
        header, levels = read_until(stream, "image", "final")
    assert header["channels"] == 3
    assert levels.size == 3 * 40 * 60
    assert header["tone"]["other"] == "network, medium"


def test_a_method_that_does_not_serve_the_sensor_is_an_error_not_an_end(photo):
    smooth = jl.Sensor(frames=200, kernel="linear").expose(photo, rng=0)
    with serving(Viewed.from_data(smooth)) as server, connected(server) as stream:
        read(stream)
        ask(stream, method="held-out")
        assert "expected the box kernel" in read_until(stream, "error")[0]["text"]
        stream.send('{"type": "recipe", "state": {"method": "network-color"}}')
        answer, _ = read_until(stream, "recipe")
        assert answer["python"] is None
        assert "name another method" in answer["problem"]
        ask(stream, 2)
        assert read_until(stream, "image", "final")[0]["id"] == 2


def test_frames_that_cannot_be_read_for_the_plot_are_reported_once(bits):
    class Damaged(Viewed):
        def part(self, frames):
            if 150 in frames:
                raise OSError("frame 150 is damaged")
            return super().part(frames)

    with serving(Damaged("damaged", bits, bits.sensor)) as server, connected(server) as stream:
        read(stream)
        ask(stream)
        assert read_until(stream, "error")[0]["text"] == "frame 150 is damaged"
        for number in (2, 3):
            ask(stream, number, start=number)
            assert read_until(stream, "image", "final")[0]["id"] == number


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_saved_images_are_attachments_with_safe_names(server, ending):
    state = json.dumps({"start": 1, "window": 4, "method": "mle"}).replace('"', "%22")
    path = f"/save?format={ending}&state={state.replace(' ', '')}"
    answer, body = get(server, path, **cookie(server))
    assert answer.status == 200
    assert answer.getheader("Content-Disposition").endswith(f'-1-5-mle.{ending}"')
    assert "<" not in answer.getheader("Content-Disposition")
    assert body[:4] in (b"\x89PNG", b"II*\0")


@pytest.mark.parametrize("failure", [OSError("no event loop"), SystemExit(1)])
def test_a_server_that_does_not_start_is_an_error(bits, monkeypatch, failure):
    def fails(self, sockets):
        raise failure

    monkeypatch.setattr("uvicorn.Server.run", fails)
    with pytest.raises(type(failure)), serving(Viewed.from_data(bits)) as running:
        get(running, "/")


def test_the_token_differs_each_time_and_the_port_is_checked(bits):
    one, other = Server(Viewed.from_data(bits)), Server(Viewed.from_data(bits))
    assert one.token != other.token
    assert len(one.token) >= 32
    with pytest.raises(OSError, match=f"port {one.port}"):
        Server(Viewed.from_data(bits), port=one.port)
    for each in (one, other):
        each._socket.close()
        each._workshop.close()
    with pytest.raises(OSError, match="no address"):
        Server(Viewed.from_data(bits), host="no.such.host.invalid")
    with pytest.raises(ValueError, match="port: expected"):
        Server(Viewed.from_data(bits), port=70_000)


def test_a_server_leaves_no_thread_behind(bits):
    before = {thread.name for thread in threading.enumerate()}
    with serving(Viewed.from_data(bits)) as running, connected(running) as stream:
        read(stream)
    wait_until(
        lambda: (
            not any(
                thread.name.startswith("jotlight-view") and thread.name not in before
                for thread in threading.enumerate()
            )
        )
    )


@pytest.fixture(scope="module")
def bracket(photo):
    sensor = jl.Sensor(frames=60, gain=[0.25, 1.0, 4.0] * 20)
    with serving(Viewed.from_data(sensor.expose(photo, rng=0))) as running:
        yield running


def test_a_window_of_a_bracket_becomes_whole_cycles(bracket):
    with connected(bracket) as stream:
        hello, _ = read(stream)
        assert (hello["cycle"], hello["state"]["window"]) == (3, 60)
        ask(stream, start=7, window=20)
        header, _ = read_until(stream, "image", "final")
        assert (header["start"], header["window"]) == (6, 18)
        assert header["mean_reading"][0] == "firing rate"
        stream.send('{"type": "probe", "row": 3, "column": 4}')
        values = read_until(stream, "values")[0]["values"]
        assert (values["counted"], values["trials"]) == ("ones", 18)
        assert "photons" not in values
        ask(stream, 2, start=0, window=3, align=True)
        assert "align: expected two cycles" in read_until(stream, "error")[0]["text"]


def test_readings_of_several_bits_are_called_so(photo):
    readings = jl.Sensor(frames=20, bit_depth=4, gain=60.0).expose(photo, rng=0)
    with serving(Viewed.from_data(readings)) as running, connected(running) as stream:
        hello, _ = read(stream)
        assert hello["methods"][0] == {"name": "counts", "title": "sum of readings"}
        assert ["bits of a reading b", "4"] in hello["sensor"]
        stream.send('{"type": "probe", "row": 3, "column": 4}')
        ask(stream, start=2, window=10, overlays=["jots"])
        header, _ = read_until(stream, "image", "final")
        assert header["mean_reading"] == [
            "mean reading",
            pytest.approx(readings.to_array()[2:12].mean()),
        ]
        overlay, _ = read_until(stream, "overlay")
        assert not overlay["searched"]
        values = None
        while values is None:
            values = read_until(stream, "values")[0]["values"]
        total = int(readings.to_array()[2:12, 3, 4].sum())
        assert (values["counted"], values["counts"], values["trials"]) == (
            "sum of readings",
            total,
            150,
        )
        assert values["photons"] == pytest.approx(3 * values["intensity"])


def test_methods_that_do_not_serve_the_sensor_state_why(photo):
    smooth = jl.Sensor(frames=40, oversampling=2, kernel="linear").expose(photo, rng=0)
    methods = describe_capture(Viewed.from_data(smooth))["methods"]
    reasons = {each["name"]: each.get("reason") for each in methods}
    assert "box kernel" in reasons["held-out"]
    assert reasons["mle"] is None
    assert reasons["network-medium"] is None
