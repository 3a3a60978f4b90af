"""Periodic rates are found under mosaics, and in no scene."""

import re

import numpy as np
import pytest

import jotlight as jl
from jotlight.calibration import find_periodic_rates
from jotlight.datasets import photograph
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.frames.selection import select
from jotlight.sensing.data.periodic_rates import PeriodicRates
from jotlight.sensing.parameters.mosaic import Mosaic

SCENES = ("camera", "astronaut", "coffee")


def expose(light, frames, seed=0):
    return np.random.default_rng(seed).binomial(frames, -np.expm1(-light)).astype(np.int32)


def mosaic(shape, side, levels):
    rows, columns = (np.arange(length) // side % 2 for length in shape)
    return np.array(levels)[rows[:, None] + columns]


def gray(name):
    image = photograph(name)
    return image if image.ndim == 2 else image.mean(axis=2)


def kinds_of_mosaics():
    """Yield all products. The fast ones have each scene, and each number of frames."""
    for i, scene in enumerate(SCENES):
        for j, frames in enumerate((1, 16, 1000)):
            marks = [] if (i + j) % 3 == 0 else [pytest.mark.slow]
            yield pytest.param(scene, frames, marks=marks)


@pytest.mark.parametrize(("scene", "frames"), list(kinds_of_mosaics()))
def test_a_mosaic_over_a_photograph_is_found(scene, frames):
    image = gray(scene)
    for side, period in ((1, 2), (2, 4)):
        filters = mosaic(image.shape, side, [0.5, 1.0, 0.4])
        found = find_periodic_rates(expose(0.7 * image * filters, frames))
        assert found.period == period
        assert found.score > 10
        assert 0.1 < found.amplitude < 0.5
        bits = jl.Bits.from_array(np.array([expose(0.7 * image * filters, 1)]))
        assert find_periodic_rates(bits).period == period


def test_the_largest_significant_period_of_a_pattern_is_reported():
    pattern = np.random.default_rng(5).uniform(1, 4, (4, 4))
    light = np.tile(pattern, (64, 64))
    bits = jl.Sensor(frames=64, gain=12.8).expose(light, rng=0)
    found = find_periodic_rates(bits)
    assert (found.period, found.side) == (4, 1)
    advice = found.describe()
    assert "every 4 x 4 jots, for example under the color filters of a mosaic of 4 x 4" in advice
    assert 'mosaic="the letters of the filters, with / after each 4"' in advice


@pytest.mark.parametrize("frames", [1, 16, 1000, 10**6])
@pytest.mark.parametrize("scene", SCENES)
def test_a_photograph_has_no_periodic_rates(scene, frames):
    assert find_periodic_rates(expose(0.7 * gray(scene), frames)) is None


@pytest.mark.parametrize("oversampling", [2, 4])
@pytest.mark.parametrize("kernel", ["box", "cubic"])
def test_the_pixels_of_an_oversampled_sensor_are_no_period(oversampling, kernel):
    sensor = jl.Sensor(oversampling=oversampling, frames=64, kernel=kernel)
    assert find_periodic_rates(sensor.expose(gray("camera")[:256, :256], rng=0)) is None


def test_stripes_edges_and_hot_jots_are_no_period():
    rows, columns = np.indices((256, 256))
    rng = np.random.default_rng(0)
    for light in (
        0.2 + 0.2 * (columns // 7.3 % 2),  # the edges continue from tile to tile
        0.2 + 0.2 * (columns > 100) + 0.1 * (rows > 31),
        0.001 * columns + 0.002 * rows,
        np.where(rng.random((256, 256)) < 0.02, 2.0, 0.1),
        0.2 + 0.1 * np.sin(0.97 * np.pi * columns),  # nearly a period of 2
    ):
        assert find_periodic_rates(expose(light, 1000)) is None


@pytest.mark.parametrize(("axis", "name"), [(0, "rows"), (1, "columns")])
def test_alternating_rows_or_columns_are_periodic(axis, name):
    factor = 1 + 0.05 * (-1.0) ** np.indices((256, 256))[axis]
    assert find_periodic_rates(expose(0.3 * factor, 500)).period == 2, name


def test_the_amplitude_is_that_of_the_periodic_part():
    factor = 1 + 0.1 * (-1.0) ** np.indices((256, 256))[0]
    found = find_periodic_rates(np.rint(1e6 * factor).astype(np.int32))
    assert found.amplitude == pytest.approx(0.1, rel=1e-3)


@pytest.mark.slow
def test_without_a_period_the_score_is_normal():
    rng = np.random.default_rng(0)
    from jotlight.sensing.data.periodic_rates import _score

    scores = [_score(rng.poisson(5, (96, 96)).astype(float))[0] for _ in range(300)]
    assert np.mean(scores) == pytest.approx(0, abs=0.2)
    assert np.std(scores) == pytest.approx(1, abs=0.15)


def test_colors_and_small_images_are_not_tested():
    assert find_periodic_rates(mosaic((63, 640), 1, [1, 9, 4])) is None
    assert find_periodic_rates(np.ones((128, 128, 3), int), channel_axis=-1) is None
    assert find_periodic_rates(jl.Bits.from_array(np.ones((1, 128, 128, 3), bool))) is None
    assert find_periodic_rates(np.zeros((128, 128), int)) is None
    assert find_periodic_rates(np.eye(1, 128 * 128, dtype=int).reshape(128, 128)) is None
    row = np.zeros((128, 128), int)
    row[5] = 1
    assert find_periodic_rates(row) is None


@pytest.mark.parametrize(
    ("shape", "message"), [((9, 8, 4), "looks like color"), ((3, 9, 8), "expected one image")]
)
def test_counts_of_color_need_their_axis_and_stacks_are_refused(shape, message):
    with pytest.raises(ValueError, match=message):
        find_periodic_rates(np.zeros(shape, int))


@pytest.mark.parametrize("side", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_advice_returns_the_intensities_of_each_color(side):
    sensor = jl.Sensor(frames=64, gain=6.4, dark_counts=0.05, efficiency=0.7, max_intensity=8)
    levels = mosaic((128 * side, 128 * side), side, [2.0, 4.0, 1.0])
    bits = jl.Bits(sensor.expose(levels, rng=0).packed, 128 * side, sensor)
    advice = find_periodic_rates(bits).describe()
    assert "Two of four filters see about the same light, as in RGGB or BGGR" in advice
    call = re.search(r"jotlight\.(reconstruct\(.*?\)\))", advice)[1]
    call = f'{call[:-1]}, demosaicing="differences")'
    color = eval(call, {"reconstruct": jl.reconstruct, "bits": bits, "sensor": bits.sensor})
    np.testing.assert_allclose(color.mean(axis=(0, 1)), [2, 4, 1], rtol=0.02)


@pytest.mark.parametrize("frames", [1, 16, 1000])
def test_a_mosaic_that_alternates_in_one_direction_is_found(frames):
    light = gray("camera")[:192, :240]
    filters = Mosaic("RGBW/BWRG").light(np.full((*light.shape, 3), 1.0))
    found = find_periodic_rates(expose(0.4 * light * filters, frames))
    assert (found.period, found.alternating) == (2, "columns")
    advice = found.describe()
    assert "the rates repeat every 2 columns of jots, for example under the color filters" in advice
    assert "RGGB" not in advice


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("frames", [1, 16, 1000, 10**6])
def test_a_small_photograph_alternates_in_no_direction(scene, frames):
    assert find_periodic_rates(expose(0.7 * gray(scene)[:192, :240], frames)) is None


@pytest.mark.parametrize("order", ["RGBW", "WRGB", "RWGB"])
@pytest.mark.parametrize("levels", [(1.0, 1.0, 1.0), (0.6, 1.0, 0.5)])
def test_the_hint_for_a_white_filter_names_a_white_filter(order, levels):
    light = 0.1 * Mosaic(order).light(np.full((128, 128, 3), levels))
    found = find_periodic_rates(expose(light, 100))
    assert found.white.index("W") == order.index("W")
    for advice in (found.describe(), found.describe_flat()):
        assert f"as the white one in {found.white}" in advice
        assert f'mosaic="{found.white}"' in advice
        assert "RGGB" not in advice


@pytest.mark.parametrize(
    ("levels", "order"),
    [([[4, 2], [1, 4]], "as in GRBG or GBRG"), ([[3, 2], [1, 9]], None)],
)
def test_the_greens_of_a_mosaic_are_the_filters_that_are_alike(levels, order):
    bits = jl.Sensor(frames=64, gain=6.4).expose(np.tile(np.array(levels, float), (64, 64)), rng=0)
    assert find_periodic_rates(bits).greens == order


def test_the_advice_names_an_order_that_fits():
    advice = PeriodicRates(2, 0.1, 9.0, 1, "as in GRBG or GBRG").describe()
    assert "--mosaic GRBG" in advice
    advice = PeriodicRates(4, 0.1, 9.0, 2, "as in GRBG or GBRG").describe()
    assert "--mosaic GGRR/GGRR/BBGG/BBGG" in advice


def test_readings_of_several_bits_are_tested():
    light = np.tile([[0.9, 0.5], [0.5, 0.2]], (80, 80))
    readings = jl.Sensor(frames=8, bit_depth=4, gain=16).expose(light, rng=0)
    assert find_periodic_rates(readings).period == 2
    with pytest.warns(jl.errors.PeriodicRatesWarning, match="as in RGGB or BGGR"):
        jl.mle(readings)


@pytest.mark.parametrize("shape", [(128, 128), (128, 128, 3)])
def test_simulated_bits_are_not_tested(shape):
    stripes = np.where(np.arange(128) % 2, 0.3, 0.1)[:, None, None]
    image = np.broadcast_to(stripes[..., 0] if len(shape) == 2 else stripes, shape)
    sensor = jl.Sensor(frames=64)
    bits = sensor.expose(image, rng=0, channel_axis=None if len(shape) == 2 else -1)
    rotated = select(bits, ReadingOptions(rotate=90))
    for each in (*bits.channels(), *rotated.channels()):
        jl.mle(each)  # warnings are errors
    assert find_periodic_rates(bits.channels()[0]).period == 2


def test_progress_is_reported_for_readings():
    readings = jl.Sensor(frames=6, bit_depth=4).expose(np.full((8, 8), 1.0), rng=0)
    fractions = []
    find_periodic_rates(readings, progress=fractions.append)
    assert fractions[-1] == 1.0
