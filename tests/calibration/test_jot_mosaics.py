"""The filters of jots, and those of pixels: both put the same filter on each jot."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.calibration.jot_mosaics import mosaic_of_jots, mosaic_of_pixels
from jotlight.sensing.parameters.mosaic import Mosaic

SHAPE = (48, 72)
PIXELS = {
    "Bayer": "RGGB",
    "a row": "RGB",
    "another aspect": "RGBW/BWRG",
    "own transmission": Mosaic("RGGB", transmission=[[0.8, 0.1, 0], [0, 0.9, 0], [0, 0.1, 1]]),
}


@pytest.mark.parametrize("side", [1, 2, 3, 12])
@pytest.mark.parametrize("name", PIXELS)
def test_each_jot_has_the_filter_of_its_pixel(name, side):
    pixels = Mosaic.of(PIXELS[name])
    sensor = jl.Sensor(oversampling=side, mosaic=pixels)
    bits = jl.Bits.from_array(np.zeros((1, *SHAPE), bool), sensor)
    jots = mosaic_of_jots(bits, None, SHAPE)
    expected = [
        [
            pixels.pattern[row // side % len(pixels.pattern)][
                column // side % pixels.pattern.shape[1]
            ]
            for column in range(SHAPE[1])
        ]
        for row in range(SHAPE[0])
    ]
    np.testing.assert_array_equal(jots.full(*SHAPE), expected)
    back = mosaic_of_pixels(jots, side)
    size = SHAPE[0] // side, SHAPE[1] // side
    np.testing.assert_array_equal(back.full(*size), pixels.full(*size))
    assert (back.filters, back.transmission.tolist()) == (
        pixels.filters,
        pixels.transmission.tolist(),
    )


def test_the_mosaic_of_pixels_has_their_period():
    jots = Mosaic("RRRGGG/RRRGGG/RRRGGG/GGGBBB/GGGBBB/GGGBBB")
    assert mosaic_of_pixels(jots, 3) == Mosaic("RGGB")
    assert mosaic_of_pixels(jots, 1) == jots


@pytest.mark.parametrize("mosaic", ["RGGB", np.random.default_rng(0).integers(3, size=(24, 24))])
def test_pixels_over_several_filters_are_refused(mosaic):
    jots = Mosaic(mosaic, None if isinstance(mosaic, str) else "RGB")
    with pytest.raises(ValueError, match=r"oversampling: expected pixels whose jots lie .* 2 x 2"):
        mosaic_of_pixels(jots, 2)


def test_gray_captures_have_no_mosaic():
    gray = jl.Bits.from_array(np.zeros((1, *SHAPE), bool), jl.Sensor())
    assert mosaic_of_jots(gray, None, SHAPE) is None
    assert mosaic_of_jots(np.zeros(SHAPE, int), None, SHAPE) is None
