"""Calibration of sensors with a color mosaic."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.parameters.mosaic import Mosaic

SHAPE = (160, 160)


def counts(rng, rates, frames):
    return rng.binomial(frames, -np.expm1(-rates))


def flat_scene(rng, spread, frames=4000):
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] / SHAPE[0]
    light = 0.7 * (1 + 0.3 * x - 0.3 * (y - 0.5) ** 2)
    relative = np.clip(1 + spread * rng.standard_normal(SHAPE), 0.3, 2)
    dark = rng.gamma(4, 0.002, SHAPE)
    return counts(rng, dark, frames), light, relative, dark


@pytest.mark.slow
@pytest.mark.parametrize("side", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_the_response_behind_a_mosaic_is_relative_to_that_of_its_filter(side):
    rng = np.random.default_rng(5)
    ones, light, relative, dark = flat_scene(rng, 0.05)
    relative[3, 4] = 0
    height, width = SHAPE[0] // side * side, SHAPE[1] // side * side
    mosaic = Mosaic("RGGB")
    places = mosaic.full(height // side, width // side).repeat(side, 0).repeat(side, 1)
    passed = np.array([0.4, 1.0, 0.6])[places]
    part = np.s_[:height, :width]
    frames = rng.random((600, height, width)) < -np.expm1(
        -(dark[part] + 2 * (light * relative)[part] * passed)
    )
    gray = jl.Sensor(oversampling=side, frames=600)
    bits = jl.Bits.from_array(frames, sensor=gray.replace(mosaic=mosaic, gain=gray.gain))
    found = jl.calibrate(ones[part], bits, frames=4000)
    assert found.dead[3, 4]
    assert found.dead.sum() <= 2
    good = ~found.mask
    assert found.prnu == pytest.approx(0.05, abs=4 * found.prnu_error + 2e-3)
    usual = [np.median(found.efficiency[good & (places == index)]) for index in range(3)]
    np.testing.assert_allclose(usual, np.median(found.efficiency[good]), rtol=0.01)
    assert np.corrcoef(found.efficiency[good], relative[part][good])[0, 1] > 0.6
    stated = jl.calibrate(
        ones[part],
        frames.sum(0),
        frames=4000,
        flat_frames=600,
        mosaic=np.array(list("RGB"))[places],
    )
    np.testing.assert_array_equal(stated.efficiency, found.efficiency)
    # The sensor of pixels has their mosaic, whichever way the filters were stated.
    for calibration in (found, stated):
        pixels = calibration.sensor(oversampling=side).mosaic
        size = height // side, width // side
        np.testing.assert_array_equal(pixels.full(*size), mosaic.full(*size))


def test_a_filter_without_light_is_refused():
    rng = np.random.default_rng(6)
    ones = counts(rng, np.full(SHAPE, 0.01), 400)
    passed = np.array([1.0, 1.0, 0.0])[Mosaic("RGGB").full(*SHAPE)]
    flat = counts(rng, 0.5 * passed, 400)
    with pytest.raises(ValueError, match="flat: expected light behind each color filter"):
        jl.calibrate(ones, flat, frames=400, mosaic="RGGB")
    hot = np.where(passed == 0, 400, ones)
    with pytest.raises(ValueError, match="dark: expected good jots behind each color filter"):
        jl.calibrate(hot, flat, frames=400, mosaic="RGGB")
    with pytest.raises(ValueError, match="mosaic: is for a flat capture"):
        jl.calibrate(ones, frames=400, mosaic="RGGB")
    with pytest.raises(ValueError, match=r"expected a filter for each of 160 x 160 jots.*20 x 20"):
        jl.calibrate(ones, flat, frames=400, mosaic=np.tile([["R", "G"], ["G", "B"]], (10, 10)))


@pytest.mark.slow
def test_the_command_line_states_the_filters_of_a_flat_capture(run, tmp_path):
    rng = np.random.default_rng(7)
    passed = np.array([0.4, 1.0, 0.6])[Mosaic("RGGB").full(64, 64)]
    dark, flat = rng.random((2, 400, 64, 64)) < np.stack([0 * passed + 0.01, 0.5 * passed])[:, None]
    for name, frames in (("dark.npy", dark), ("flat.npy", flat)):
        np.save(tmp_path / name, np.packbits(frames, axis=2))
    status, printed = run(
        "calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors", "--mosaic", "RGGB"
    )
    assert status == 0, printed
    found = jl.Calibration.load(tmp_path / "c.safetensors")
    bits = [jl.Bits.from_array(each) for each in (dark, flat)]
    expected = jl.calibrate(*bits, mosaic="RGGB")
    np.testing.assert_array_equal(found.efficiency, expected.efficiency)
    assert found.prnu < 0.05  # 0.4 and more if the filters were differences between jots
    assert found.mosaic == Mosaic("RGGB")
    assert "color filters" in run("info", "c.safetensors")[1]
    status, printed = run(
        "reconstruct",
        "flat.npy",
        "--calibration",
        "c.safetensors",
        "-o",
        "x.tif",
        "--frames",
        "400",
    )
    assert status == 0, printed
    assert jl.read_image(tmp_path / "x.tif").shape == (64, 64, 3)
    assert "color filters Mosaic('RGGB')" in printed
    assert run("calibrate", "dark.npy", "-o", "d.safetensors", "--mosaic", "RGGB")[0] == 1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
def test_the_lazy_calibration_is_that_of_one_machine():
    pytest.importorskip("dask")
    rng = np.random.default_rng(8)
    passed = np.array([0.4, 1.0, 0.6])[Mosaic("RGGB").full(24, 32)]
    dark, flat = rng.random((2, 200, 24, 32)) < np.stack([0 * passed + 0.01, 0.5 * passed])[:, None]
    sensor = jl.Sensor(frames=200, mosaic="RGGB")
    dark, flat = jl.Bits.from_array(dark), jl.Bits.from_array(flat, sensor=sensor)
    expected = jl.calibrate(dark, flat)
    for lazy in (jl.dask.calibrate(dark, flat), jl.dask.calibrate(dark, flat, mosaic="RGGB")):
        np.testing.assert_array_equal(lazy.efficiency.compute(), expected.efficiency)
        assert lazy.compute() == expected
    with pytest.raises(ValueError, match="mosaic: is for a flat capture"):
        jl.dask.calibrate(dark, mosaic="RGGB")


def test_an_undeclared_mosaic_is_reported():
    rng = np.random.default_rng(8)
    ones = counts(rng, np.full(SHAPE, 0.01), 400)
    flat = counts(rng, np.array([0.8, 0.4, 0.2])[Mosaic("RGGB").full(*SHAPE)], 400)
    advice = r'flat: the rates repeat .* as in RGGB or BGGR.* mosaic="RGGB" \(--mosaic RGGB\)$'
    with pytest.warns(jl.errors.PeriodicRatesWarning, match=advice):
        jl.calibrate(ones, flat, frames=400)


def test_a_calibration_keeps_its_mosaic(tmp_path):
    rng = np.random.default_rng(9)
    ones = counts(rng, np.full(SHAPE, 0.01), 400)
    passed = np.array([0.4, 1.0, 0.6])[Mosaic("RGGB").full(*SHAPE)]
    flat = counts(rng, 0.7 * passed, 400)
    found = jl.calibrate(ones, flat, frames=400, mosaic="RGGB")
    path = tmp_path / "c.safetensors"
    found.save(path)
    assert jl.Calibration.load(path) == found
    bits = jl.Bits.from_array(rng.random((16, *SHAPE)) < 0.3 * passed)
    assert jl.Calibration.load(path).sensor(bits).mosaic == Mosaic("RGGB")
    # What the sensor or the caller states comes first.
    assert found.applied_to(jl.Sensor(mosaic="BGGR")).mosaic == Mosaic("BGGR")
    assert found.sensor(16, mosaic=None).mosaic is None
    with pytest.raises(ValueError, match="oversampling: expected pixels whose jots lie behind one"):
        found.sensor(16, oversampling=2)
    gray = jl.calibrate(ones, frames=400)
    gray.save(path)
    assert jl.Calibration.load(path).sensor(bits).mosaic is None
