"""Runs of `reconstruct` over captures and windows, behind a mosaic and with three channels."""

import json
from pathlib import Path

import numpy as np
import pytest
import zarr

import jotlight as jl
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.io import read_image
from jotlight.networks.pretrained import CHANNELS_FILE, FOLDER, MOSAIC_FILE

SCENE = jl.datasets.photograph("astronaut")[40:160:4, 160:288:4].astype(np.float64)
SENSOR = jl.Sensor(frames=24, mosaic="RGGB")
WINDOW = ("--window", 12, "--step", 6)


@pytest.fixture
def captures(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for seed in (1, 2):
        jl.save(SENSOR.expose(SCENE, rng=seed), f"{seed}.npy")
    return [Path("1.npy"), Path("2.npy")]


def windows_of(bits, sensor=None, **options):
    """Return the estimates of the windows that `WINDOW` requests."""
    sensor = (sensor or bits.sensor).replace(frames=12)
    axis = {"channel_axis": -1} if len(bits.shape) == 4 else {}
    parts = bits.windows(12, 6)
    return [jl.reconstruct(part.counts(), sensor, **axis, **options) for part in parts]


def content(folder):
    files = (path for path in sorted(Path(folder).rglob("*")) if path.is_file())
    return {path.relative_to(folder): path.read_bytes() for path in files}


@pytest.mark.slow
def test_each_capture_becomes_a_color_image(run, captures):
    args = ("reconstruct", *captures, "-o", "i/{name}.tif")
    code, out = run(*args)
    assert code == 0, out
    for path in captures:
        expected = jl.reconstruct(jl.open(path).counts(), SENSOR)
        np.testing.assert_array_equal(read_image(Path("i", f"{path.stem}.tif")), expected)
    record = json.loads(Path("i/1.tif.json").read_text())["run"]
    files = MOSAIC_FILE, FOLDER / "large.safetensors"
    assert record["weights_sha256"] == sorted(map(file_checksum, files))
    assert record["method"] == "network-color"
    assert record["sensor"]["mosaic"]["filters"] == "RGB"
    assert "2 complete before" in run(*args)[1]
    code, out = run(*args[:-1], "named/{name}.tif", "--method", "network-color")
    assert code == 0, out
    np.testing.assert_array_equal(
        read_image(Path("named", "1.tif")), read_image(Path("i", "1.tif"))
    )
    assert run("reconstruct", *captures, "-o", "{name}.png")[0] == 0
    assert read_image(Path("2.png")).shape == SCENE.shape


@pytest.mark.slow
def test_windows_become_a_color_video(run, captures):
    code, out = run("reconstruct", captures[0], "-o", "v.zarr", *WINDOW)
    assert code == 0, out
    video = zarr.open_array("v.zarr", mode="r")
    np.testing.assert_array_equal(video[:], windows_of(jl.open(captures[0])))
    code, out = run("info", "v.zarr")
    assert code == 0
    assert "3 images of 30 x 32 x 3" in out
    assert "network-color" in out
    weights = sorted(map(file_checksum, (MOSAIC_FILE, FOLDER / "large.safetensors")))
    assert f"weights{','.join(weights)}sensor" in "".join(out.split())
    for chunks, part in (("200B", "1/2"), ("200B", "2/2")):
        options = ("--chunks", chunks, "--part", part)
        assert run("reconstruct", captures[0], "-o", "p.zarr", *WINDOW, *options)[0] == 0
    assert run("gather", ".")[0] == 0
    assert zarr.open_array("p.zarr", mode="r").shape == (3, *SCENE.shape)
    images = {name: data for name, data in content("v.zarr").items() if name.name[:2] == "c."}
    parts = content("p.zarr")
    assert len(images) == 3
    assert {name: parts[name] for name in images} == images


@pytest.mark.slow
def test_processes_make_the_same_colors(run, captures):
    assert run("reconstruct", captures[0], "-o", "one.zarr", *WINDOW)[0] == 0
    assert run("reconstruct", captures[0], "-o", "two.zarr", *WINDOW, "--workers", 2)[0] == 0
    assert content("one.zarr") == content("two.zarr")


@pytest.mark.slow
def test_a_stated_mosaic_with_color_differences(run, captures):
    bits = jl.open(captures[0])
    np.save("raw.npy", np.asarray(bits.packed))
    options = ("--mosaic", "GRBG", "--max-intensity", 2, "--demosaicing", "differences", "--bits")
    code, out = run("reconstruct", "raw.npy", "-o", "v.zarr", *WINDOW, *options)
    assert code == 0, out
    sensor = jl.Sensor(frames=12, mosaic="GRBG", max_intensity=2)
    expected = windows_of(jl.open("raw.npy", counts=False), sensor, demosaicing="differences")
    video = zarr.open_array("v.zarr", mode="r")
    np.testing.assert_array_equal(video[:], expected)
    record = video.attrs["jotlight"]["run"]
    assert (record["method"], record["options"]) == (
        "network-medium",
        {"demosaicing": "differences"},
    )
    assert record["weights_sha256"] == file_checksum(FOLDER / "medium.safetensors")
    other = ("--mosaic", "RGGB", *options[2:])
    code, out = run("reconstruct", "raw.npy", "-o", "v.zarr", *WINDOW, *other)
    assert code == 1
    assert "v.zarr: belongs to another run: its sensor mosaic pattern was" in out


def test_a_requested_method_estimates_planes(run, captures):
    options = ("-m", "mle", "--demosaicing", "differences")
    assert run("reconstruct", *captures, "-o", "{name}.tif", *options)[0] == 0
    counts = jl.open(captures[1]).counts()
    expected = jl.reconstruct(counts, SENSOR, method="mle", demosaicing="differences")
    np.testing.assert_array_equal(read_image("2.tif"), expected)


@pytest.mark.slow
def test_a_calibration_keeps_the_mosaic(run, captures):
    dark = jl.Sensor(frames=64, dark_counts=0.05).expose(np.zeros(SCENE.shape[:2]), rng=0)
    calibration = jl.calibrate(dark)
    calibration.save("c.safetensors")
    options = ("--calibration", "c.safetensors")
    code, out = run("reconstruct", captures[0], "-o", "v.zarr", *WINDOW, *options)
    assert code == 0, out
    sensor = calibration.applied_to(SENSOR)
    expected = windows_of(jl.open(captures[0]), sensor)
    np.testing.assert_array_equal(zarr.open_array("v.zarr", mode="r")[:], expected)


@pytest.mark.slow
def test_three_channels_are_estimated_by_the_color_network(run, captures):
    bits = jl.Sensor(frames=24).expose(SCENE, rng=0, channel_axis=-1)
    jl.save(bits, "channels.npy")
    assert run("reconstruct", "channels.npy", "-o", "v.zarr", *WINDOW)[0] == 0
    video = zarr.open_array("v.zarr", mode="r")
    np.testing.assert_array_equal(video[:], windows_of(bits))
    weights = video.attrs["jotlight"]["run"]["weights_sha256"]
    assert file_checksum(CHANNELS_FILE) in weights


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--demosaicing", "linear"), "expected one of network, menon, differences, got"),
        (("--demosaicing", "network", "-m", "mle"), '"network" estimates colors without'),
        (("--mosaic", "RGBW", "--demosaicing", "menon"), "menon is for RGGB, BGGR, GRBG, and GBRG"),
    ],
)
def test_bad_options_are_refused_before_work(run, captures, options, message):
    for output in (("-o", "v.zarr", *WINDOW), ("-o", "{name}.tif", "2.npy")):
        code, out = run("reconstruct", captures[0], *output, *options)
        assert code == 1
        assert message in " ".join(out.split())
    assert {path.stem for path in Path.cwd().iterdir()} == {"1", "2"}


def test_options_of_colors_need_colors(run, captures):
    jl.save(jl.Bits.from_array(np.zeros((24, 6, 8), bool)), "gray.npy")
    args = ("reconstruct", "gray.npy", "-o", "v.zarr", *WINDOW, "--demosaicing", "differences")
    code, out = run(*args)
    assert code == 1
    assert "demosaicing: is for a sensor with a mosaic" in " ".join(out.split())
    jl.save(jl.Bits.from_array(np.zeros((24, 6, 8, 3), bool)), "channels.npy")
    args = ("reconstruct", "channels.npy", "-o", "v.zarr", *WINDOW, "--mosaic", "RGGB")
    code, out = run(*args)
    assert code == 1
    assert "expected gray frames" in " ".join(out.split())
