"""Whether `reconstruct` applies a calibration of other jots or filters, and what it reports."""

import json
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.parameters.mosaic import Mosaic

SHAPE = (64, 64)


@pytest.fixture(autouse=True)
def captures(tmp_path, monkeypatch):
    """Write a dark and a flat capture behind filters, without a sensor, to the current folder."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(7)
    passed = np.array([0.4, 1.0, 0.6])[Mosaic("RGGB").full(*SHAPE)]
    for name, rates in (("dark.npy", 0 * passed + 0.01), ("flat.npy", 0.5 * passed)):
        jl.save(jl.Bits.from_array(rng.random((400, *SHAPE)) < rates), tmp_path / name)


@pytest.fixture
def calibrated(run):
    command = ("calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors", "--mosaic", "RGGB")
    status, printed = run(*command)
    assert status == 0, printed


def reconstruct(run, *options):
    command = ("reconstruct", "flat.npy", "-o", "x.tif", "-m", "mle")
    return run(*command, "--calibration", "c.safetensors", *options)


def test_a_capture_of_another_region_is_refused(run):
    region = ("--region", "1:33,3:47")
    assert run("calibrate", "dark.npy", "-o", "c.safetensors", *region)[0] == 0
    status, printed = reconstruct(run, "--region", "0:32,0:44")
    assert status == 1
    assert (
        "this capture is of rows 0:32 and columns 0:44 of 64 x 64, and the calibration's dark "
        "capture is of rows 1:33 and columns 3:47 of 64 x 64; open them with the same region "
        "(--region)"
    ) in printed
    status, printed = reconstruct(run, *region)
    assert status == 0, printed
    assert "assumed to be in the same places" not in printed
    dark, flat = jl.open("dark.npy"), jl.open("flat.npy")
    with pytest.raises(ValueError, match=r"flat capture is of rows 32:64 .*\(--region\)$"):
        jl.calibrate(dark[:, :32, :32], flat[:, 32:, :32])


def test_a_calibration_of_the_whole_sensor_asks_for_the_same_region(run):
    assert run("calibrate", "dark.npy", "-o", "c.safetensors")[0] == 0
    status, printed = reconstruct(run, "--region", "0:32,0:32")
    assert status == 1
    assert "opened in the same way (--rotate, --flip, --width, --region)" in printed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (
            ("--mosaic", "GRBG"),
            "its jots have color filters Mosaic('RGGB'), and the sensor has Mosaic('GRBG') on "
            "pixels of 1 x 1 jots, which are used",
        ),
        (("--mosaic", "RGGB", "--oversampling", 2), "on pixels of 2 x 2 jots, which are used"),
        (("--mosaic", "RGGB"), None),
        ((), None),
    ],
)
def test_a_mosaic_that_contradicts_the_calibration_is_used_and_reported(
    run, calibrated, options, expected
):
    status, printed = reconstruct(run, *options)
    assert status == 0, printed
    applied = json.loads(Path("x.tif.json").read_text())["calibration"]["applied"]
    if expected is None:
        assert "which are used" not in printed
        assert "color filters Mosaic('RGGB')" in printed
    else:
        assert expected in " ".join(printed.split())
    assert applied["mosaic"] == (expected is None)


@pytest.mark.filterwarnings("ignore::jotlight.errors.PeriodicRatesWarning")
def test_the_mosaic_of_a_calibration_can_be_removed(run, calibrated):
    status, printed = reconstruct(run, "--mosaic", "none")
    assert status == 0, printed
    record = json.loads(Path("x.tif.json").read_text())
    assert record["calibration"]["applied"]["mosaic"] is False
    assert "mosaic" not in record["sensor"]
    assert jl.read_image("x.tif").shape == SHAPE


@pytest.mark.filterwarnings("ignore::jotlight.errors.PeriodicRatesWarning")
def test_the_mosaic_of_a_capture_can_be_removed(run):
    sensor = jl.Sensor(frames=400, mosaic="RGGB")
    bits = jl.open("flat.npy")
    jl.save(jl.Bits(np.asarray(bits.packed), SHAPE[1], sensor), "colors.npy")
    assert run("reconstruct", "colors.npy", "-o", "y.tif", "-m", "mle", "--mosaic", "none")[0] == 0
    gray = jl.mle(bits, sensor.replace(mosaic=None))
    np.testing.assert_allclose(jl.read_image("y.tif"), gray)
