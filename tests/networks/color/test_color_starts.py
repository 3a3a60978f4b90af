"""The classical colors that color networks improve."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets import photograph
from jotlight.metrics import psnr
from jotlight.networks.color.color_inference import planes_of_channels
from jotlight.networks.color.color_starts import guided_filter
from jotlight.networks.planes.color_planes import CENTER, START
from jotlight.networks.pretrained import COLOR_START, pretrained_conditional
from jotlight.sensing.data.pixel_counts import count_pixels


def by_least_squares(guide, values, known, side, noise):
    """Return the guided filter as He et al. define it, pixel by pixel."""
    height, width = guide.shape
    reach = side // 2
    lines = {}
    for row, column in np.ndindex(height, width):
        part = np.s_[
            max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1
        ]
        own = known[part]
        if own.any():
            x, y = guide[part][own], values[part][own]
            slope = np.mean((x - x.mean()) * (y - y.mean())) / (x.var() + noise)
            lines[row, column] = slope, y.mean() - slope * x.mean()
    found = np.zeros_like(guide)
    for row, column in np.ndindex(height, width):
        around = [
            lines[r, c]
            for r in range(row - reach, row + reach + 1)
            for c in range(column - reach, column + reach + 1)
            if (r, c) in lines
        ]
        if around:
            slope, offset = np.mean(around, axis=0)
            found[row, column] = slope * guide[row, column] + offset
    return found


@pytest.mark.parametrize("fraction", [1.0, 0.6, 0.05, 0.0])
@pytest.mark.parametrize("side", [3, 5])
def test_the_guided_filter_agrees_with_least_squares_in_each_square(fraction, side):
    rng = np.random.default_rng(0)
    guide = rng.random((11, 13))
    values, known = rng.random((11, 13)) - guide, rng.random((11, 13)) < fraction
    found = guided_filter(guide, values, known, side, 0.01)
    np.testing.assert_allclose(found, by_least_squares(guide, values, known, side, 0.01), atol=1e-6)


def start_of(counts, sensor):
    channels = [count_pixels(np.ascontiguousarray(each), sensor, 1) for each in counts]
    planes = planes_of_channels(pretrained_conditional(sensor, COLOR_START), channels, 1)
    return np.sin(planes[START] + CENTER) ** 2


@pytest.mark.parametrize("trials", [1, 16, 256])
def test_the_start_is_better_than_gray_estimates_of_each_channel(trials):
    scene = photograph("astronaut")[:256:2, 100:356:2].astype(np.float64)
    sensor = jl.Sensor(frames=trials)
    counts = sensor.expose(scene, rng=0, channel_axis=-1).counts()
    gray = jl.reconstruct(counts, sensor, channel_axis=-1, quality="medium")
    probability = start_of(np.moveaxis(counts, -1, 0), sensor)
    found = np.moveaxis(np.minimum(-np.log1p(-np.minimum(probability, 0.9999)), 1), 0, -1)
    assert psnr(found, scene, data_range=1.0) > 0.3 + psnr(gray, scene, data_range=1.0)


def test_a_color_without_structure_is_exact():
    scene = np.ones((40, 40, 3)) * [0.8, 0.4, 0.05]
    sensor = jl.Sensor(frames=256)
    counts = np.round(256 * -np.expm1(-np.moveaxis(scene, -1, 0))).astype(np.int32)
    expected = -np.expm1(-np.moveaxis(scene, -1, 0))
    np.testing.assert_allclose(start_of(counts, sensor), expected, atol=0.01)


def test_no_valid_bit_is_an_error():
    counts = np.full((3, 24, 24), 5, np.int32)
    sensor = jl.Sensor(frames=10, mask=np.ones((24, 24), bool))
    with pytest.raises(ValueError, match="expected at least one pixel with a valid bit"):
        start_of(counts, sensor)
