"""`jotlight calibrate`, and what `reconstruct` and `info` do with a calibration."""

import hashlib
import json

import numpy as np
import pytest
import tifffile

import jotlight as jl
from folders import file_names
from jotlight.formats.writing import write_capture
from jotlight.images.io import read_image

pytestmark = pytest.mark.filterwarnings("ignore:.*no valid bit")

SHAPE = (24, 32)


@pytest.fixture
def captures(tmp_path):
    """Return a folder with a dark, a flat, and an image capture of one sensor."""
    rng = np.random.default_rng(0)
    dark = rng.gamma(4, 0.002, SHAPE)
    dark[5, 6] = 1.0
    relative = 1 + 0.05 * rng.standard_normal(SHAPE)
    relative[10:13, 20:23] = 1e-4
    efficiency = np.clip(relative / 1.3, 1e-4, 1)
    sensor = jl.Sensor(frames=600, gain=600 * 1.3, dark_counts=dark, efficiency=efficiency)
    jl.save(sensor.expose(np.zeros(SHAPE), 1), tmp_path / "dark.npy")
    jl.save(sensor.expose(np.full(SHAPE, 0.7), 2), tmp_path / "flat.npy")
    scene = np.tile(np.linspace(0.1, 0.8, SHAPE[1]), (SHAPE[0], 1))
    bits = sensor.replace(frames=16).expose(scene, 3)
    # A camera does not store the sensor beside its capture.
    jl.save(jl.Bits(bits.packed, bits.width), tmp_path / "capture.npy")
    np.save(tmp_path / "counts.npy", bits.counts(1))
    return tmp_path


@pytest.fixture
def calibrated(run, captures):
    assert run("calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors")[0] == 0
    return jl.Calibration.load(captures / "c.safetensors")


@pytest.mark.slow
def test_calibrate_writes_what_the_python_function_returns(run, captures):
    status, output = run(
        "calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors", "--plot", "page.png"
    )
    assert status == 0
    found = jl.Calibration.load(captures / "c.safetensors")
    same = jl.calibrate(jl.open(captures / "dark.npy"), jl.open(captures / "flat.npy"))
    assert found.sensor(16) == same.sensor(16)
    assert np.argwhere(found.hot).tolist() == [[5, 6]]
    assert np.argwhere(found.dead).tolist() == [[y, x] for y in (10, 11, 12) for x in (20, 21, 22)]
    assert f"hot: 1 ({1 / 768:.2%}); {found.hot_threshold} ones or more" in output
    chance = (
        f"{found.hot_probability * 768:.2g}, a rate of {found.hot_probability:.2g}; at most 0.0001"
    )
    assert f"hot by chance: {chance}" in output
    assert 1e-5 < found.hot_probability <= 1e-4
    assert "dead: 9 (" in output
    assert f"PRNU: {found.prnu:.2%} ± " in output
    assert "dark: correlation of frames: " in output
    assert (captures / "page.png").read_bytes().startswith(b"\x89PNG")
    assert {name: provenance.name for name, provenance in found.provenance.items()} == {
        "dark": "dark.npy",
        "flat": "flat.npy",
    }


@pytest.mark.slow
def test_counts_need_the_option_frames(run, captures):
    for name in ("dark", "flat"):
        np.save(captures / f"{name}-counts.npy", jl.open(captures / f"{name}.npy").counts(1))
    command = ("calibrate", "dark-counts.npy", "flat-counts.npy", "-o", "c.safetensors")
    status, output = run(*command)
    assert status == 1
    assert "--frames, --flat-frames" in output
    assert run(*command, "--frames", 600, "--plot", "page.pdf")[0] == 0
    found = jl.Calibration.load(captures / "c.safetensors")
    same = jl.calibrate(jl.open(captures / "dark.npy"), jl.open(captures / "flat.npy"))
    assert found.sensor(4) == same.sensor(4)
    assert found.dark_steadiness is None
    assert run("calibrate", "dark.npy", "flat-counts.npy", "-o", "d.safetensors", "-t", 600)[0] == 0
    assert jl.Calibration.load(captures / "d.safetensors").sensor(4) == same.sensor(4)


@pytest.mark.parametrize("method", ["mle", "noniterative-tv", "admm-tv", "mle-iterative"])
@pytest.mark.parametrize("data", ["capture.npy", "counts.npy"])
@pytest.mark.slow
def test_a_calibration_and_its_maps_lead_to_the_same_estimate(
    run, captures, calibrated, method, data
):
    np.save("d.npy", calibrated.dark_counts)
    np.save("e.npy", calibrated.efficiency)
    np.save("m.npy", calibrated.mask)
    command = ("reconstruct", data, "-m", method, "-t", 16)
    status, output = run(*command, "-o", "a.npy", "--calibration", "c.safetensors")
    assert status == 0
    assert "calibration c.safetensors: dark counts (median 0.0" in output
    assert "10 masked jots, response (PRNU " in output
    maps = ("--dark-counts", "d.npy", "--efficiency", "e.npy", "--mask", "m.npy")
    assert run(*command, "-o", "b.npy", *maps, "--gain", 16 * calibrated.scale)[0] == 0
    np.testing.assert_array_equal(np.load("a.npy"), np.load("b.npy"))
    recorded = {name: json.loads((captures / f"{name}.npy.json").read_text()) for name in "ab"}
    assert "calibration" in recorded["a"]
    assert "calibration" not in recorded["b"]


def test_the_applied_calibration_is_recorded_beside_the_estimate(run, captures, calibrated):
    np.save("d.npy", np.zeros(SHAPE))
    command = ("reconstruct", "capture.npy", "-o", "a.tif", "--calibration", "c.safetensors")
    status, output = run(*command, "-m", "mle", "--dark-counts", "d.npy", "--gain", 20)
    assert status == 0
    assert "calibration c.safetensors: 10 masked jots, response" in output
    record = json.loads((captures / "a.tif.json").read_text())
    assert record["format"] == "jotlight record"
    assert (record["data"], record["method"]) == ("capture.npy", "mle")
    assert record["sensor"]["gain"] == 20
    assert record["sensor"]["frames"] == 16
    calibration = record["calibration"]
    assert calibration["file"] == "c.safetensors"
    content = (captures / "c.safetensors").read_bytes()
    assert calibration["sha256"] == hashlib.sha256(content).hexdigest()
    assert calibration["applied"] == {
        "dark_counts": False,
        "efficiency": True,
        "mask": True,
        "mosaic": False,
    }
    assert calibration["masked_jots"] == 10
    # A record by jotlight is replaced; any other file stays.
    assert run(*command, "-m", "mle")[0] == 0
    (captures / "a.tif.json").write_text("{}")
    before = (captures / "a.tif").read_bytes()
    status, output = run(*command)
    assert status == 1
    assert "this file is not such a record" in output
    assert (captures / "a.tif").read_bytes() == before
    assert (captures / "a.tif.json").read_text() == "{}"


@pytest.mark.slow
@pytest.mark.parametrize("brightest", [None, 3.5])
def test_photons_refer_to_the_median_jot(run, tmp_path, brightest):
    rng = np.random.default_rng(5)
    response = 1 + 0.05 * rng.standard_normal((64, 96))
    if brightest is not None:
        response[20, 30] = brightest
    truth = np.full(response.shape, 0.4)
    camera = jl.Sensor(frames=512, gain=512 * 4.0, efficiency=response / 4)
    jl.save(camera.expose(0 * truth, 1), "dark.npy")
    jl.save(camera.expose(truth, 2), "flat.npy")
    bits = camera.expose(truth, 3)
    jl.save(jl.Bits(bits.packed, bits.width), "capture.npy")
    assert run("calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors")[0] == 0
    command = ("capture.npy", "-m", "mle", "--calibration", "c.safetensors")
    arguments = ("-o", "a.tif", "--units", "photons", "--uncertainty", "u.npz")
    assert run("reconstruct", *command, *arguments)[0] == 0
    estimate = read_image(tmp_path / "a.tif")
    assert np.median(estimate) == pytest.approx(0.4, rel=0.01)
    with np.load("u.npz") as bounds:
        inside = (bounds["low"] <= 0.4) & (bounds["high"] >= 0.4)
        assert np.median(bounds["standard_error"]) == pytest.approx(estimate.std(), rel=0.5)
    assert inside.mean() > 0.9
    arguments = ("-o", "film.npy", "--units", "photons", "--window", 256)
    assert run("film", *command, *arguments)[0] == 0
    assert np.median(np.load("film.npy")) == pytest.approx(0.4, rel=0.01)


def test_the_default_method_supports_a_calibrated_sensor(run, captures, calibrated):
    command = ("reconstruct", "capture.npy", "-o", "a.npy", "--calibration", "c.safetensors")
    assert run(*command)[0] == 0
    record = json.loads((captures / "a.npy.json").read_text())
    scene = np.linspace(0.1, 0.8, SHAPE[1])
    assert np.sqrt(np.mean((np.load("a.npy") - scene) ** 2)) < 0.1
    assert record["method"] == "network-medium"


def test_bits_that_carry_a_sensor_keep_its_other_parameters(run, captures, calibrated):
    sensor = jl.Sensor(frames=4, gain=2.0, oversampling=2)
    jl.save(sensor.expose(np.full((12, 16), 0.5), 0), captures / "carried.npy")
    command = ("reconstruct", "carried.npy", "-m", "mle", "-o", "a.npy")
    assert run(*command, "--calibration", "c.safetensors")[0] == 0
    expected = jl.mle(jl.open("carried.npy"), calibrated.applied_to(sensor))
    np.testing.assert_array_equal(np.load("a.npy"), expected)


def test_a_capture_of_another_shape_is_refused(run, captures, calibrated):
    for data in ("capture.npy", "counts.npy"):
        command = ("reconstruct", data, "-o", "a.npy", "-t", 16, "--rotate", 90)
        status, output = run(*command, "--calibration", "c.safetensors")
        assert status == 1
        assert "it has 24 x 32 jots, and the capture has 32 x 24" in output
    assert "a.npy" not in file_names(captures)


@pytest.mark.slow
@pytest.mark.parametrize("data", ["capture.npy", "counts.npy"])
def test_a_capture_of_another_orientation_is_refused(run, captures, calibrated, data):
    command = ("reconstruct", data, "-m", "mle", "-o", "a.npy", "-t", 16)
    command += ("--calibration", "c.safetensors")
    for turn, expected in (
        (("--rotate", 180), "rotated by 180 degrees"),
        (("--flip", "vertical"), "rotated by 180 degrees and mirrored left to right"),
    ):
        status, output = run(*command, *turn)
        assert status == 1
        assert (
            f"this capture is {expected}, and the calibration's dark capture not turned" in output
        )
        assert "a.npy" not in file_names(captures)
    calibrate = ("calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors", "--rotate", 180)
    assert run(*calibrate)[0] == 0
    status, output = run(*command, "--flip", "vertical")
    assert status == 1
    assert "dark capture rotated by 180 degrees" in output
    # The same orientation, written differently.
    assert run(*command, "--rotate", -180)[0] == 0
    record = json.loads((captures / "a.npy.json").read_text())
    assert record["provenance"]["orientation"] == [2, False]
    assert record["calibration"]["provenance"]["flat"]["orientation"] == [2, False]


def test_an_unknown_orientation_is_reported(run, captures, calibrated):
    command = ("reconstruct", "counts.npz", "-m", "mle", "-o", "a.npy", "-t", 16)
    np.savez("counts.npz", np.load("counts.npy"))
    status, output = run(*command, "--calibration", "c.safetensors")
    assert status == 0
    assert "the calibration is from npy and the capture is from npz; the jots are assumed" in output


@pytest.mark.slow
def test_two_arrays_of_one_file_are_distinguished(run, captures):
    arrays = {name: jl.open(f"{name}.npy").counts(1) for name in ("dark", "flat")}
    np.savez("both.npz", **arrays)
    command = ("calibrate", "both.npz", "both.npz", "-o", "c.safetensors", "-t", 600)
    status, output = run(*command, "--key", "dark", "--flat-key", "flat", "--plot", "page.svg")
    assert status == 0
    assert "npz: the array flat" in output
    assert "both.npz (npz; the array dark)" in run("info", "c.safetensors")[1]
    provenance = jl.Calibration.load(captures / "c.safetensors").provenance
    assert [provenance[name].notes for name in ("dark", "flat")] == [
        ("the array dark",),
        ("the array flat",),
    ]
    arguments = ("reconstruct", "both.npz", "--key", "flat", "-t", 600, "-m", "mle", "-o", "a.tif")
    assert run(*arguments, "--calibration", "c.safetensors")[0] == 0
    with tifffile.TiffFile("a.tif") as file:
        assert json.loads(file.pages[0].description)["provenance"]["notes"] == ["the array flat"]
    assert json.loads((captures / "a.tif.json").read_text())["provenance"]["notes"] == [
        "the array flat"
    ]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:dark. no jot is called hot")
def test_a_dark_capture_that_is_too_short_is_reported(run, captures):
    command = ("calibrate", "dark.npy", "-o", "c.safetensors", "--frame-range", ":1")
    status, output = run(*command, "--plot", "page.png")
    assert status == 0
    assert "hot: none found: too few frames" in output
    assert "hot by chance: 1 of 1 bits are ones by chance in 0.0" in output
    assert not jl.Calibration.load(captures / "c.safetensors").hot.any()


def test_dark_and_flat_captures_of_different_orientations_are_refused(captures):
    dark, flat = jl.open(captures / "dark.npy"), jl.open(captures / "flat.npy", rotate=180)
    with pytest.raises(ValueError, match="flat capture is rotated by 180 degrees, and dark"):
        jl.calibrate(dark, flat)


@pytest.mark.slow
def test_info_describes_and_draws_a_calibration(run, captures, calibrated):
    status, output = run("info", "c.safetensors", "--plot", "page.svg")
    assert status == 0
    assert "calibration" in output
    assert "24 x 32" in output
    assert "masked" in output
    assert "<svg" in (captures / "page.svg").read_text()


def test_a_refused_calibration_leaves_all_files_unchanged(run, captures):
    before = file_names(captures)
    for arguments, expected in (
        (("-o", "dark.safetensor"), "ends in .safetensors"),
        (("-o", "c.safetensors", "--plot", "page.gif"), "ends in .png"),
        (("-o", "c.safetensors", "--plot", "dark.json"), "this file is read"),
        (("-o", "c.safetensors", "--false-positive-rate", 2), "expected a number in (0, 0.01]"),
        (("-o", "c.safetensors", "--rotate", 45), "rotate"),
        (
            ("-o", "c.safetensors", "--frames", 600),
            "frames: is for counts. These captures hold bits",
        ),
    ):
        status, output = run("calibrate", "dark.npy", "flat.npy", *arguments)
        assert status == 1
        assert expected in output
        assert file_names(captures) == before
    status, output = run("calibrate", "dark.npy", "counts.npy", "-o", "c.safetensors", "-t", 1)
    assert status == 1
    assert "at least the largest of the flat counts" in output
    assert file_names(captures) == before


def test_a_network_is_refused_as_a_calibration(run, captures):
    jl.Network.initial(jl.Sensor(frames=16)).save("n.safetensors")
    command = ("reconstruct", "capture.npy", "-o", "a.npy")
    status, output = run(*command, "--calibration", "n.safetensors")
    assert status == 1
    assert "expected a jotlight calibration, got a jotlight network" in output


def test_a_converted_capture_keeps_its_original_format(run, captures, calibrated):
    assert run("convert", "capture.npy", "-o", "capture.npy.gz")[0] == 0
    command = ("reconstruct", "capture.npy.gz", "-o", "a.npy", "-m", "mle")
    status, output = run(*command, "--calibration", "c.safetensors")
    assert status == 0
    assert "the calibration is from" not in output


def test_frames_stated_by_counts_are_used_and_contradictions_refused(run, captures):
    for name in ("dark", "flat"):
        bits = jl.open(captures / f"{name}.npy")
        write_capture(bits[:500].counts(1), captures / f"{name}.npz", "npz", trials=500)
        np.save(captures / f"{name}-counts.npy", bits.counts(1))
    destination = ("-o", "c.safetensors")
    assert run("calibrate", "dark.npz", "flat.npz", *destination)[0] == 0
    assert run("calibrate", "dark-counts.npy", "flat.npz", *destination, "--frames", 600)[0] == 0
    found = jl.Calibration.load(captures / "c.safetensors")
    assert (found.dark_frames, found.flat_frames) == (600, 500)
    for arguments, expected in (
        (
            ["dark.npz", "flat.npz", "--frames", 600],
            "dark.npz: states counts of 500 trials, but --frames 600",
        ),
        (
            ["dark.npy", "flat.npz", "--frames", 600],
            "flat.npz: states counts of 500 trials, but --frames 600",
        ),
        (["dark.npz", "flat.npz", "--flat-frames", 7], "but --flat-frames 7 means 7;"),
    ):
        status, output = run("calibrate", *arguments, *destination)
        assert status == 1
        assert expected in output
