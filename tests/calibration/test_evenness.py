"""A flat capture that is none is reported, and one of even light is not; so are dark ones."""

import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.parameters.mosaic import Mosaic


def calibrate(light, frames=400, seed=0, dark=0.01, **options):
    rng = np.random.default_rng(seed)
    dark = np.full(light.shape, dark)
    dark[rng.random(light.shape) < 0.005] = 0.06
    return jl.calibrate(
        rng.binomial(1000, -np.expm1(-dark)),
        rng.binomial(frames, -np.expm1(-dark - light)),
        frames=1000,
        flat_frames=frames,
        **options,
    )


def response(shape, spread=0.05, seed=1):
    rng = np.random.default_rng(seed)
    return 1 + spread * rng.standard_normal(shape)


@pytest.mark.slow
@pytest.mark.parametrize("frames", [1000, 16])
@pytest.mark.parametrize("name", ["camera", "coins"])
def test_a_photograph_is_no_flat_capture(name, frames):
    image = jl.datasets.photograph(name, gray=True)[:256, :256]
    with pytest.warns(jl.JotlightWarning, match=r"flat: expected even light, got .*white wall"):
        calibrate(0.7 * image / image.mean(), frames)


@pytest.mark.slow
def test_a_photograph_behind_color_filters_is_no_flat_capture():
    image = jl.datasets.photograph("camera", gray=True)[:256, :256]
    passed = np.array([0.4, 1.0, 0.6])[Mosaic("RGGB").full(*image.shape)]
    with pytest.warns(jl.JotlightWarning, match="flat: expected even light"):
        calibrate(image / image.mean() * passed, mosaic="RGGB")


def lights(shape):
    y, x = np.mgrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j]
    clusters = np.ones(shape)
    clusters[40:49, 60:69], clusters[80:85, 20:23] = 1e-6, 1e-6
    columns = 1 + 0.05 * np.random.default_rng(2).standard_normal(shape[1])
    return {
        "even": np.ones(shape),
        "cosine": (1 + 0.6 * ((x - 0.3) ** 2 + y**2)) ** -2,
        "lamp on one side": 1 + 0.6 * x,
        "near lamp": 1 / ((x - 1.5) ** 2 + y**2 + 0.5),
        "dead clusters": clusters,
        "columns": np.tile(columns, (shape[0], 1)),
    }


@pytest.mark.slow
@pytest.mark.parametrize("frames", [1000, 16])
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name, marks=[pytest.mark.exhaustive] * (name in ("cosine", "lamp on one side"))
        )
        for name in lights((128, 160))
    ],
)
def test_even_and_smoothly_falling_light_is_a_flat_capture(name, frames):
    shape = (128, 160)
    with warnings.catch_warnings():
        warnings.simplefilter("error", jl.JotlightWarning)
        calibrate(0.6 * lights(shape)[name] * response(shape), frames)


COLORS = np.array([0.8, 0.4, 0.2])


@pytest.mark.parametrize(
    ("shape", "side", "frames"), [((16, 16), 1, 400), ((24, 20), 1, 100), ((24, 24), 2, 400)]
)
def test_an_undeclared_mosaic_is_reported_on_few_jots(shape, side, frames):
    places = Mosaic("RGGB").full(shape[0] // side, shape[1] // side)
    passed = COLORS[places.repeat(side, 0).repeat(side, 1)]
    period = 2 * side
    words = rf"flat: the rates repeat every {period} x {period} jots.* as in RGGB or BGGR"
    with pytest.warns(jl.PeriodicRatesWarning, match=words):
        calibrate(passed * response(shape), frames)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(8, 8), (16, 16), (33, 48), (128, 128)])
def test_no_mosaic_is_reported_where_there_is_none(shape):
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    columns = 1 + 0.05 * np.random.default_rng(3).standard_normal(shape[1])
    light = 0.5 * (1 + 0.3 * x - 0.2 * y) * columns
    with warnings.catch_warnings():
        warnings.simplefilter("error", jl.JotlightWarning)
        for seed in range(10):
            calibrate(light * response(shape, seed=seed), seed=seed)


def test_a_stated_mosaic_is_not_reported():
    passed = COLORS[Mosaic("RGGB").full(16, 16)]
    with warnings.catch_warnings():
        warnings.simplefilter("error", jl.JotlightWarning)
        calibrate(passed * response((16, 16)), mosaic="RGGB")


@pytest.mark.parametrize("frames", [100, pytest.param(4000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("light", [0.02, 0.3])
def test_a_photograph_is_no_dark_capture(frames, light):
    image = jl.datasets.photograph("coins", gray=True)[:256, :256]
    rates = -np.expm1(-light * image / image.mean())
    counts = np.random.default_rng(0).binomial(frames, rates)
    with pytest.warns(jl.JotlightWarning, match=r"dark: expected a capture without .* cover it"):
        jl.calibrate(counts, frames=frames)


# A corner that the electronics heat, a slow slope, and jots that differ by themselves.
@pytest.mark.parametrize("frames", [100, pytest.param(4000, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "usual",
    [
        lambda y, x: 1 + 3 * np.exp(-((x - 1) ** 2 + (y - 1) ** 2) / 0.1),
        lambda y, x: np.exp(x / 2),
        lambda y, x: 1 + 0 * y,
    ],
)
def test_a_dark_capture_may_be_uneven(usual, frames):
    rng = np.random.default_rng(1)
    y, x = np.mgrid[-1:1:160j, -1:1:200j]
    dark = rng.gamma(2, 0.005, x.shape) * usual(y, x)
    dark[rng.random(x.shape) < 0.01] = 0.5
    counts = rng.binomial(frames, -np.expm1(-dark))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jl.calibrate(counts, frames=frames)
