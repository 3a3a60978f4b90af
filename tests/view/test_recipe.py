"""The command line and the code of the page make the image that it shows."""

import shlex
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.cli.app import app, run
from jotlight.cli.capture_options import CaptureOptions
from jotlight.cli.sensor_options import CapturedSensorOptions
from jotlight.cli.view import _open
from jotlight.view.recipe import recipe
from jotlight.view.saving import save_view
from jotlight.view.state import ViewState
from jotlight.view.viewed import Viewed
from moving import record

PHOTO = jl.datasets.photograph("camera")[100:140, 180:240]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sensor = jl.Sensor(frames=60, gain=40.0)
    jl.save(sensor.expose(PHOTO, rng=0), "own sensor.npy")
    jl.save(sensor.expose(PHOTO, rng=0), "-x.npy")
    np.save("plain.npy", sensor.expose(2 * PHOTO, rng=0).packed)
    counts = np.stack([sensor.replace(frames=10).expose(PHOTO, rng=n).counts() for n in range(6)])
    np.save("counts.npy", counts)
    np.save("means.npy", np.rint(255 * counts / 10).astype(np.uint8))
    noisy = np.zeros(PHOTO.shape)
    noisy[[5, 20, 33], [7, 40, 12]] = 3.0
    hot = sensor.replace(dark_counts=noisy).expose(0.2 * PHOTO, rng=0)
    jl.save(jl.Bits(hot.packed, hot.width, sensor), "hot.npy")
    np.save("hot counts.npy", hot.to_array().reshape(6, 10, *PHOTO.shape).sum(axis=1, dtype=int))
    color = np.stack([PHOTO, PHOTO[::-1], PHOTO[:, ::-1]], axis=2)
    jl.save(sensor.expose(color, rng=0, channel_axis=-1), "color.npy")
    bayer = sensor.replace(mosaic="RGGB", gain=sensor.gain)
    jl.save(bayer.expose(color, rng=0), "mosaic.npy")
    scene = jl.datasets.moving(color, sensor=bayer, photons=0.6, rng=4)
    jl.save(scene.bits, "shaken.npy")
    jl.save(record("shake", shape=(128, 128))[1], "gray.npy")
    mask = np.zeros(PHOTO.shape, bool)
    mask[3, 4] = True
    np.save("mask.npy", mask)
    return tmp_path


def open_with(name, options):
    """Return a capture as `jotlight view` opens it with some options."""
    _, bound, _ = app.parse_args(["view", name, *shlex.split(options)])
    capture = bound.arguments.get("capture", CaptureOptions())
    sensor = bound.arguments.get("sensor", CapturedSensorOptions())
    return _open(name, capture, sensor)


CASES = [
    ("own sensor.npy", "", ViewState(5, 20, "mle", white=0.8)),
    ("own sensor.npy", "", ViewState(0, 16, "network-medium", white=0.7, curve="reinhard")),
    ("own sensor.npy", "--gain 30 --max-intensity 3", ViewState(5, 20, "mle", white=2.0)),
    ("plain.npy", "--frame-range 10:50:2 --rotate 90", ViewState(3, 10, "mle", white=1.5)),
    ("plain.npy", "--mask mask.npy --width 60", ViewState(3, 10, "admm-tv", curve="log")),
    ("-x.npy", "", ViewState(5, 20, "mle", white=0.8)),
    ("hot.npy", "--find-hot-jots --frame-range 0:56", ViewState(5, 20, "mle", white=0.8)),
    ("hot.npy", "--find-hot-jots", ViewState(0, 60, "mle", white=0.8)),
    ("hot counts.npy", "--find-hot-jots --counts --frames 60", ViewState(1, 3, "mle", white=0.8)),
    ("counts.npy", "--frames 60 --counts", ViewState(0, 6, "mle", align=True, white=0.8)),
    (
        "means.npy",
        "--counts-scale 255 --trials 10",
        ViewState(0, 6, "mle", align=True, white=0.8),
    ),
    ("counts.npy", "--frames 60 --counts", ViewState(1, 4, "mle", white=0.8, curve="linear")),
    ("mosaic.npy", "", ViewState(4, 50, "network-color", white=0.8)),
    ("mosaic.npy", "", ViewState(4, 50, "mle", white=0.8)),
    ("mosaic.npy", "", ViewState(4, 50, "network-color", align=True, white=0.8)),
    ("mosaic.npy", "", ViewState(4, 50, "mle", align=True, white=0.8)),
    ("shaken.npy", "", ViewState(0, 60, "network-color", align=True, white=0.8)),
    ("shaken.npy", "", ViewState(0, 60, "mle", align=True, white=0.8)),
    ("gray.npy", "", ViewState(0, 48, "mle", align=True, white=0.8)),
    ("gray.npy", "", ViewState(2, 44, "network-medium", align=True, white=0.8)),
    ("color.npy", "", ViewState(4, 50, "network-color", white=0.8)),
    ("color.npy", "", ViewState(4, 50, "mle", align=True, white=0.8)),
]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize(("name", "options", "state"), CASES)
def test_both_make_the_saved_image(folder, name, options, state):
    viewed = open_with(name, options)
    expected = folder / "expected.png"
    expected.write_bytes(save_view(viewed, state, "png"))
    texts = recipe(viewed, state)
    program, *words = shlex.split(texts["command"])
    if program == "python":
        subprocess.run([sys.executable, *words], check=True)
    else:
        assert run(words) == 0
    by_command = np.asarray(Image.open("view.png")).astype(int)
    exec(texts["python"], {})
    by_code = np.asarray(Image.open("view.png")).astype(int)
    saved = np.asarray(Image.open(expected)).astype(int)
    np.testing.assert_array_equal(by_code, saved)
    np.testing.assert_array_equal(by_command, saved)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options", "state"),
    [
        ("own sensor.npy", "", ViewState(5, 20, "counts")),
        ("own sensor.npy", "", ViewState(5, 20, "mle", "admm-tv")),
        ("gray.npy", "", ViewState(0, 48, "mle", "network-small", align=True)),
        ("counts.npy", "--frames 60 --counts", ViewState(1, 4, "counts")),
    ],
)
def test_the_command_for_counts_and_differences_runs_the_code(folder, name, options, state):
    viewed = open_with(name, options)
    words = shlex.split(recipe(viewed, state)["command"])
    subprocess.run([sys.executable, *words[1:]], check=True)
    (folder / "saved.tif").write_bytes(save_view(viewed, state, "tif"))
    np.testing.assert_array_equal(jl.read_image("view.tif"), jl.read_image("saved.tif"))


def test_bits_in_memory_have_code_but_no_command():
    viewed = Viewed.from_bits(jl.Sensor(frames=16).expose(PHOTO, rng=0))
    texts = recipe(viewed, ViewState(4, 8, "mle", compare="network-small", align=True))
    assert texts["command"] is None
    assert "bits[4 : 12]" in texts["python"]
    assert "jl.merge(bits, sensor)" in texts["python"]
    compile(texts["python"], "recipe", "exec")


def test_a_live_capture_has_neither(tmp_path):
    from jotlight.view.live.options import LiveOptions, open_live

    (tmp_path / "a.bin").write_bytes(bytes(8))
    live = open_live(tmp_path / "a.bin", LiveOptions(shape="8x8"), {"frames": 1})
    try:
        assert recipe(live, ViewState()) == {"command": None, "python": None}
    finally:
        live.close()


def test_names_of_files_are_quoted():
    from jotlight.view.viewed import Opening

    bits = jl.Sensor(frames=4).expose(PHOTO, rng=0)
    viewed = Viewed("x", bits, bits.sensor, opening=Opening("a'; rm -rf x;'.npy"))
    texts = recipe(viewed, ViewState(0, 4, "mle"))
    assert shlex.split(texts["command"])[2] == "a'; rm -rf x;'.npy"
    compile(texts["python"], "recipe", "exec")
