"""The command line and the code of the page make the image that it shows."""

import contextlib
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.cli.app import app, run
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.sensor_options import CapturedSensorOptions
from jotlight.cli.view import _open
from jotlight.view.estimate import estimate
from jotlight.view.recipe import recipe
from jotlight.view.running_counts import RunningCounts
from jotlight.view.saving import save_view
from jotlight.view.state import ViewState
from jotlight.view.viewed import Viewed
from moving import record

PHOTO = jl.datasets.photograph("camera")[100:140, 180:240]


def save_files():
    """Save the captures and maps of all tests in the current folder."""
    sensor = jl.Sensor(frames=60, gain=40.0)
    jl.save(sensor.expose(PHOTO, rng=0), "own sensor.npy")
    jl.save(sensor.expose(PHOTO, rng=0), "-x.npy")
    np.save("plain.npy", sensor.expose(2 * PHOTO, rng=0).packed)
    np.savez("two.npz", a=np.load("plain.npy"), b=np.load("plain.npy")[::-1])
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
    shaken = record("shake", shape=(128, 128))[1]
    jl.save(shaken, "gray.npy")
    np.save("gray without sensor.npy", shaken.packed)
    several = sensor.replace(bit_depth=4, read_noise=0.3, gain=120.0)
    readings = several.expose(PHOTO, rng=0)
    jl.save(readings, "several.npy")
    np.save("numbers.npy", readings.to_array())
    jl.save(jl.Sensor(frames=60, read_noise=0.3).expose(PHOTO, rng=0), "noisy.npy")
    bracket = jl.Sensor(frames=60, gain=[0.25, 1.0, 4.0] * 20)
    jl.save(bracket.expose(PHOTO, rng=0), "bracket.npy")
    np.save("bracket without sensor.npy", bracket.expose(PHOTO, rng=0).packed)
    for name, moving in (("moving several.npy", several), ("moving bracket.npy", bracket)):
        scene = jl.datasets.moving(motion="shake", sensor=moving, shape=(64, 72), photons=2, rng=0)
        jl.save(scene.bits, name)
    mask = np.zeros(PHOTO.shape, bool)
    mask[3, 4] = True
    np.save("mask.npy", mask)
    Image.fromarray(255 * mask.astype(np.uint8)).save("mask.png")
    np.save("thresholds.npy", np.tile([[1, 2], [2, 3]], (20, 30)))
    Path("filters.json").write_text('{"pattern": "GRBG", "filters": "GRB"}')
    np.save("mosaic bits.npy", bayer.expose(color, rng=0).packed)
    jl.save(several.replace(mosaic="RGGB").expose(color, rng=0), "several mosaic.npy")
    frames = bayer.expose(color, rng=0).to_array().reshape(6, 10, *PHOTO.shape)
    np.save("mosaic counts.npy", frames.sum(axis=1, dtype=np.uint16))
    two = jl.Sensor(frames=60).expose(color[..., :2], rng=0, channel_axis=-1)
    jl.save(two, "two channels.npy")
    dark = np.full((128, 128), 0.001)
    dark[::8, ::8] = 0.02  # hot for the largest intensity 1, and not for that of saturation
    np.save("dark.npy", dark)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Return a folder with the files."""
    folder = tmp_path_factory.mktemp("files")
    with contextlib.chdir(folder):
        save_files()
    return folder


@pytest.fixture
def folder(files, tmp_path, monkeypatch):
    """Return the current folder of a test, with copies of the files."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    return tmp_path


def open_with(name, options):
    """Return a capture as `jotlight view` opens it with some options."""
    _, bound, _ = app.parse_args(["view", name, *shlex.split(options)])
    capture = bound.arguments.get("capture", CaptureOptions())
    sensor = bound.arguments.get("sensor", CapturedSensorOptions())
    return _open(name, capture, sensor)


def run_python(option, code):
    """Run `python -c CODE` in this process, which has imported the packages."""
    assert option == "-c"
    exec(code, {})


RESPONSE = "--read-noise 0.3 --gain 120"
WIDTH = "--width 60 --gain 40"
BRACKET = "--gain 0.25,1,4,... --threshold 1 --width 60 --frames 60"
CASES = [
    ("own sensor.npy", "", ViewState(5, 20, "mle", white=0.8)),
    ("plain.npy", "--frame-range 10:50:2 --rotate 90", ViewState(3, 10, "mle", white=1.5)),
    ("plain.npy", "--mask mask.npy --width 60", ViewState(3, 10, "admm-tv", curve="log")),
    ("-x.npy", "", ViewState(5, 20, "mle", white=0.8)),
    ("hot counts.npy", "--find-hot-jots --counts --frames 60", ViewState(1, 3, "mle", white=0.8)),
    (
        "means.npy",
        "--counts-scale 255 --trials 10",
        ViewState(0, 6, "mle", align=True, white=0.8),
    ),
    ("two.npz", f"--key b --bits {WIDTH}", ViewState(1, 30, "mle", white=0.8)),
    ("mosaic.npy", "", ViewState(4, 50, "network-color", align=True, white=0.8)),
    ("gray.npy", "", ViewState(2, 44, "network-medium", align=True, white=0.8)),
    ("color.npy", "", ViewState(4, 50, "mle", align=True, white=0.8)),
    ("several.npy", "--mask mask.npy --bit-depth 4", ViewState(5, 20, "admm-tv", white=0.8)),
    ("numbers.npy", f"--bit-depth 4 {RESPONSE}", ViewState(0, 60, "noniterative-tv", white=0.8)),
    ("noisy.npy", "--read-noise 0.25", ViewState(0, 60, "mle", align=True, white=0.8)),
    ("bracket.npy", "--find-hot-jots", ViewState(6, 21, "mle", white=0.8)),
    ("bracket without sensor.npy", BRACKET, ViewState(6, 21, "mle", white=0.8)),
    ("plain.npy", f"--threshold thresholds.npy {WIDTH}", ViewState(5, 20, "mle", white=0.8)),
    ("mosaic counts.npy", "--mosaic RGGB --frames 60", ViewState(0, 6, "mle", align=True)),
    ("two channels.npy", "", ViewState(5, 20, "mle", curve="reinhard")),
    ("moving bracket.npy", "", ViewState(6, 51, "network-medium", align=True, white=0.8)),
]
SIMILAR = [
    ("own sensor.npy", "", ViewState(0, 16, "network-medium", white=0.7, curve="reinhard")),
    ("own sensor.npy", "--gain 30 --max-intensity 3", ViewState(5, 20, "mle", white=2.0)),
    ("hot.npy", "--find-hot-jots --frame-range 0:56", ViewState(5, 20, "mle", white=0.8)),
    ("hot.npy", "--find-hot-jots", ViewState(0, 60, "mle", white=0.8)),
    ("counts.npy", "--frames 60 --counts", ViewState(0, 6, "mle", align=True, white=0.8)),
    ("means.npy", "--counts-scale 255 --frames 60", ViewState(1, 4, "mle", white=0.8)),
    ("counts.npy", "--frames 60 --counts", ViewState(1, 4, "mle", white=0.8, curve="linear")),
    ("mosaic.npy", "", ViewState(4, 50, "network-color", white=0.8)),
    ("mosaic.npy", "", ViewState(4, 50, "mle", white=0.8)),
    ("mosaic.npy", "", ViewState(4, 50, "mle", align=True, white=0.8)),
    ("shaken.npy", "", ViewState(0, 60, "network-color", align=True, white=0.8)),
    ("shaken.npy", "", ViewState(0, 60, "mle", align=True, white=0.8)),
    ("gray.npy", "", ViewState(0, 48, "mle", align=True, white=0.8)),
    ("color.npy", "", ViewState(4, 50, "network-color", white=0.8)),
    ("several.npy", "", ViewState(5, 20, "network-medium", white=0.8)),
    ("several.npy", "--gain 90 --max-intensity 3", ViewState(5, 20, "mle", white=2.0)),
    ("numbers.npy", f"--bit-depth 4 {RESPONSE}", ViewState(5, 20, "mle", white=0.8)),
    ("noisy.npy", "--find-hot-jots", ViewState(5, 20, "network-small", white=0.8)),
    ("bracket.npy", "", ViewState(6, 21, "network-medium", white=0.8)),
    ("bracket.npy", "--frame-range 1:50 --efficiency 0.5", ViewState(6, 21, "mle", white=0.8)),
    ("bracket without sensor.npy", BRACKET, ViewState(6, 21, "network-medium", align=True)),
    ("plain.npy", "--mask mask.png --width 60", ViewState(3, 10, "mle", white=0.8)),
    ("gray without sensor.npy", "--dark-counts dark.npy", ViewState(0, 48, "mle", align=True)),
    ("mosaic bits.npy", f"--mosaic filters.json {WIDTH}", ViewState(5, 20, "mle", white=0.8)),
    ("several mosaic.npy", "", ViewState(0, 60, "mle", align=True, white=0.8)),
    ("moving several.npy", "", ViewState(6, 50, "network-medium", align=True, white=0.8)),
]
"""Cases whose options and methods the cases above have in other combinations."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize(
    ("name", "options", "state"),
    [*CASES, *(pytest.param(*case, marks=pytest.mark.exhaustive) for case in SIMILAR)],
)
def test_both_make_the_saved_image(folder, name, options, state):
    viewed = open_with(name, options)
    expected = folder / "expected.png"
    expected.write_bytes(save_view(viewed, state, "png"))
    texts = recipe(viewed, state)
    program, *words = shlex.split(texts["command"])
    if program == "python":
        run_python(*words)
    else:
        assert run(words) == 0
    by_command = np.asarray(Image.open("view.png")).astype(int)
    exec(texts["python"], {})
    by_code = np.asarray(Image.open("view.png")).astype(int)
    saved = np.asarray(Image.open(expected)).astype(int)
    np.testing.assert_array_equal(by_code, saved)
    np.testing.assert_array_equal(by_command, saved)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")  # a network clips
@pytest.mark.parametrize(
    ("name", "options", "state"),
    [
        pytest.param(
            "own sensor.npy", "", ViewState(5, 20, "counts"), marks=pytest.mark.exhaustive
        ),
        pytest.param(
            "own sensor.npy", "", ViewState(5, 20, "mle", "admm-tv"), marks=pytest.mark.exhaustive
        ),
        ("gray.npy", "", ViewState(0, 48, "mle", "network-small", align=True)),
        pytest.param(
            "plain.npy",
            "--width 60",
            ViewState(0, 16, "mle", "network-small"),
            marks=pytest.mark.exhaustive,
        ),
        ("plain.npy", "--width 60", ViewState(0, 16, "network-small", "mle", align=True)),
        pytest.param(
            "two channels.npy", "", ViewState(5, 20, "mle", "admm-tv"), marks=pytest.mark.exhaustive
        ),
        ("two channels.npy", "", ViewState(5, 20, "counts")),
        ("counts.npy", "--frames 60 --counts", ViewState(1, 4, "counts", align=True)),
        pytest.param(
            "counts.npy",
            "--frames 60 --counts",
            ViewState(1, 4, "counts"),
            marks=pytest.mark.exhaustive,
        ),
        pytest.param("several.npy", "", ViewState(5, 20, "counts"), marks=pytest.mark.exhaustive),
        ("bracket.npy", "", ViewState(6, 21, "counts")),
        ("moving bracket.npy", "", ViewState(6, 51, "mle", "network-small", align=True)),
    ],
)
def test_the_command_for_counts_and_differences_runs_the_code(folder, name, options, state):
    viewed = open_with(name, options)
    words = shlex.split(recipe(viewed, state)["command"])
    run_python(*words[1:])
    (folder / "saved.tif").write_bytes(save_view(viewed, state, "tif"))
    np.testing.assert_array_equal(jl.read_image("view.tif"), jl.read_image("saved.tif"))


def test_readings_in_memory_have_code_that_makes_the_image():
    readings = jl.Sensor(frames=16, bit_depth=4, oversampling=2, gain=99.0).expose(PHOTO, rng=0)
    viewed = Viewed.from_data(readings)
    for method in ("counts", "mle"):
        code = recipe(viewed, ViewState(4, 8, method))["python"].partition("\ntone")[0]
        names = {"readings": readings}
        for _ in range(2):  # as when a cell of a notebook runs again
            exec(code.partition("\njl.save")[0], names)
        assert names["readings"] is readings
        shown = estimate(viewed, range(4, 12), method, RunningCounts(viewed).move(range(4, 12)))
        np.testing.assert_array_equal(names["image"].astype(np.float32), shown.image)


def test_bits_in_memory_have_code_but_no_command():
    viewed = Viewed.from_data(jl.Sensor(frames=16).expose(PHOTO, rng=0))
    texts = recipe(viewed, ViewState(4, 8, "mle", compare="network-small", align=True))
    assert texts["command"] is None
    assert "bits[4 : 12]" in texts["python"]
    assert "jl.merge(window, sensor)" in texts["python"]
    compile(texts["python"], "recipe", "exec")


def test_a_live_capture_has_neither(tmp_path):
    from jotlight.view.live.options import LiveOptions, open_live

    (tmp_path / "a.bin").write_bytes(bytes(8))
    live = open_live(tmp_path / "a.bin", LiveOptions(layout="8x8"), {"frames": 1})
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
