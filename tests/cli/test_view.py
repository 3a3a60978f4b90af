"""`jotlight view`: its options and its messages."""

import contextlib
import io
import re
import shlex
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.sensor_options import CapturedSensorOptions
from jotlight.cli.view import _open
from jotlight.formats.capture import assumed_sensor_note
from jotlight.view.recipe import recipe
from jotlight.view.saving import save_view
from jotlight.view.state import ViewState
from servers import http_server


@pytest.fixture
def capture(tmp_path):
    bits = jl.Sensor(frames=40).expose(np.full((16, 24), 0.4), rng=0)
    jl.save(bits, tmp_path / "capture.npy")
    return tmp_path / "capture.npy"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["no.such.npy"], "there is no file"),
        (["no.such.bin", "--follow", "--format", "swissspad2"], "error: there is no file no.such"),
        (["-"], "-: is a stream; write it to a file first, or show it by `jotlight view - --foll"),
        (["capture.npy", "--frames", "3"], "--frame-range leaves some of them out"),
        (["several.npy", "--frames", "3"], "expected the 4 frames of the capture, got 3"),
        (["several.npy", "--bit-depth", "3"], "several.npy states readings of 4 bits, not 3"),
        (["several.npy", "--find-hot-jots"], "expected single bits, got readings of 4 bits"),
        (["capture.npy", "--gain", "8,1", "--frames", "40"], "such as --frame-range 0:20"),
        (["capture.npy", "--region", "0:8,0:8"], "`jotlight convert --region` writes a part"),
        (["capture.npy", "--port", "70000"], "port: expected 0 to 65535"),
        (["capture.npy", "--host", "no.such.host.invalid"], "no address of this machine"),
        (["capture.npy", "--layout", "16x24"], "expected raw frames, but its first bytes are"),
        (["capture.npy", "--history", "9"], "history: is for a capture that grows; add --follow"),
        (["capture.npy", "--follow", "--rotate", "90"], "--rotate is for complete captures"),
        (["capture.npy", "--follow", "--counts"], "--counts is for complete captures"),
        (["capture.npy", "--follow", "--bit-depth", "4"], "--bit-depth above 1 is for complete"),
        (["capture.npy", "--follow", "--read-noise", "0.2"], "--read-noise is for complete"),
        (["capture.npy", "--follow", "--gain", "8,1,..."], "--gain with several values is for"),
        (["capture.npy", "--follow", "--width", "60"], "width: expected 17 to 24, since a row"),
        (["raw.bin", "--follow", "--layout", "16x24", "--width", "24"], "--width is for a .npy or"),
        (["capture.npy", "--follow", "--key", "bits"], "--key is for a folder of files"),
        (["capture.npy", "--follow", "--layout", "16x24"], "leave out --layout"),
        (["capture.npy", "--follow", "--format", "swissspad2"], "leave out --format"),
        (["capture.npy", "--follow", "--format", "hdf5"], "spad512s, or npy, since --follow"),
        (["capture.npy", "--follow", "--layout", "5"], "layout: expected rows and columns"),
        (["capture.npy", "--follow", "--format", "x"], "format: expected one of"),
    ],
)
def test_bad_input_is_refused_in_one_line(run, capture, monkeypatch, options, message):
    pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
    monkeypatch.chdir(capture.parent)
    several = jl.Sensor(frames=4, bit_depth=4).expose(np.full((16, 24), 0.4), rng=0)
    jl.save(several, "several.npy")
    (capture.parent / "raw.bin").write_bytes(bytes(480))
    status, output = run("view", *options)
    assert status == 1
    assert message in output


def test_the_help_lists_no_option_that_is_always_refused(run):
    status, output = run("view", "--help")
    assert status == 0
    assert "--frame-range" in output
    assert "--region" not in output


def test_without_the_extra_the_message_says_how_to_install_it(run, capture, monkeypatch):
    monkeypatch.setattr("jotlight.view.extra.find_spec", lambda name: None)
    status, output = run("view", capture)
    assert status == 1
    assert "pip install 'jotlight[view]'" in output


def test_an_assumed_sensor_is_that_of_reconstruct(run, capture, tmp_path):
    bits = jl.open(capture)
    assert _open(str(capture), CaptureOptions(), CapturedSensorOptions()).sensor_note == ""
    jl.save(jl.Bits(bits.packed, bits.width), tmp_path / "bare.npy")
    options = CapturedSensorOptions(threshold="2")
    note = _open(str(tmp_path / "bare.npy"), CaptureOptions(), options).sensor_note
    assert note == assumed_sensor_note(jl.Sensor(frames=40, threshold=2))
    words = note.partition("assumed")[0]
    assert words in run("reconstruct", tmp_path / "bare.npy", "-q", "2", "-o", "a.tif")[1]


@pytest.mark.slow
def test_a_capture_at_a_url_is_viewed_and_its_command_makes_the_same_image(run, capture):
    pytest.importorskip("fsspec", reason="no URLs: pip install 'jotlight[dask]'")
    with http_server(capture.parent) as server:
        url = f"{server.url}/capture.npy"
        viewed = _open(url, CaptureOptions(), CapturedSensorOptions())
        assert viewed.title == "capture.npy"
        state = ViewState(5, 20, "mle", white=0.8)
        expected = np.asarray(Image.open(io.BytesIO(save_view(viewed, state, "png"))))
        status, output = run(*shlex.split(recipe(viewed, state)["command"])[1:])
    assert status == 0, output
    np.testing.assert_array_equal(np.asarray(Image.open("view.png")), expected)


@contextlib.contextmanager
def viewer(*arguments):
    """Yield the process of the command, which ends with the block, even if a check fails."""
    command = [sys.executable, "-m", "jotlight", "view", *arguments]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, **pipes) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.slow
def test_the_command_says_that_it_waits_for_the_first_frame(tmp_path):
    pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
    path = tmp_path / "a.bin"
    path.touch()
    with viewer(str(path), "--follow", "--layout", "8x8") as process:
        assert process.stdout.readline().decode().endswith("a.bin: waiting for the first frame\n")
        path.write_bytes(bytes(8))
        assert process.stdout.readline().startswith(b"a.bin: http://127.0.0.1:")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)


@pytest.mark.slow
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("kind", ["file", "pipe"])
def test_the_command_prints_an_address_that_works_and_ends_on_a_signal(capture, stop, kind):
    pytest.importorskip("uvicorn", reason="no server: pip install 'jotlight[view]'")
    arguments = [str(capture)] if kind == "file" else ["-", "--follow", "--layout", "16x24"]
    with viewer(*arguments) as process:
        if kind == "pipe":
            process.stdin.write(bytes(range(48)) * 10)
            process.stdin.flush()
        first = process.stdout.readline().decode()
        if first == "-: waiting for the first frame\n":  # on a busy machine
            first = process.stdout.readline().decode()
        if kind == "pipe":
            assert process.stdout.readline().decode() == f"{assumed_sensor_note(jl.Sensor())}\n"
        second = process.stdout.readline().decode()
        address = re.search(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32,}", first)[0]
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        assert b"<title>jotlight</title>" in opener.open(address, timeout=20).read()
        process.send_signal(stop)
        _, errors = process.communicate(timeout=20)
    assert process.returncode == (0 if stop == signal.SIGINT else 143)
    assert b"Traceback" not in errors
    assert second == "Ctrl-C ends the viewer\n"
