"""Lists of data."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.data.data_lists import list_of_data

SENSOR = jl.Sensor(frames=4)
BITS = SENSOR.expose(np.full((6, 8), 0.5), rng=0)
COUNTS = BITS.counts()


@pytest.mark.parametrize("data", [[BITS, BITS], (BITS,)])
def test_bits_are_listed(data):
    assert list_of_data(data) == list(data)


@pytest.mark.parametrize("data", [BITS, COUNTS, [COUNTS, COUNTS], COUNTS.tolist(), None])
def test_other_data_are_no_list(data):
    assert list_of_data(data) == []


@pytest.mark.parametrize("sensor", [SENSOR, SENSOR.replace(mosaic="RGGB"), None])
@pytest.mark.parametrize(
    ("data", "error", "message"),
    [
        ([], ValueError, "data: expected at least one image, got an empty list"),
        ((), ValueError, "data: expected at least one image, got an empty tuple"),
        ([BITS, COUNTS], TypeError, "a list of only Bits, got ndarray at index 1; leave it out"),
        # They have the shape of the bits, so NumPy would take both for counts.
        ([np.ones(BITS.shape, int), BITS], TypeError, "only Bits, got ndarray at index 0"),
        ([BITS, None], TypeError, "data: .* got NoneType at index 1"),
        ([COUNTS, COUNTS[:3]], ValueError, r"same shape in a list, got \(3, 8\) and \(6, 8\)"),
        ([[1, 2], [3]], ValueError, r"data: .* got \(1,\) and \(2,\)"),
        (["a.npy", "b.npy"], TypeError, "data: .* got the path 'a.npy'"),
        ([np.ma.ones((6, 8), int)] * 2, TypeError, "data: .* got a masked one"),
        (BITS.windows(2), TypeError, r"got generator; pass a list, such as list\(bits.windows\("),
    ],
)
def test_lists_that_are_no_data_are_refused(sensor, data, error, message):
    with pytest.raises(error, match=message):
        jl.reconstruct(data, sensor, method="mle")


@pytest.mark.parametrize("data", [[[], []], np.empty((0, 8))])
def test_data_without_a_pixel_are_refused_for_their_shape(data):
    for call in (lambda: jl.mle(data, SENSOR), lambda: jl.calibrate(data, frames=4)):
        with pytest.raises(ValueError, match="at least one pixel, got "):
            call()
