"""Properties of the estimates of every sensor from any bits."""

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from any_sensor import IMAGE_SHAPES, assert_in_range, sensors, sensors_and_bits, without_warnings


@pytest.mark.slow
@given(sensors_and_bits())
def test_every_estimate_lies_between_0_and_the_largest_intensity(case):
    sensor, bits = case
    packed = jl.Bits.from_array(bits, sensor)
    assert_in_range(without_warnings(jl.mle, packed, sensor), sensor)
    for inverse in jl.vst.INVERSES:
        estimate = without_warnings(
            jl.noniterative, packed, sensor, denoiser="gaussian", inverse=inverse
        )
        assert_in_range(estimate, sensor)


@pytest.mark.slow
@given(st.data())
def test_the_maximum_likelihood_estimate_rises_with_the_counts(data):
    sensor = data.draw(sensors(frames=data.draw(st.integers(1, 5000))))
    counts = st.integers(0, sensor.frames)
    fewer = data.draw(hnp.arrays(np.int64, data.draw(IMAGE_SHAPES), elements=counts))
    more = np.maximum(fewer, data.draw(hnp.arrays(np.int64, fewer.shape, elements=counts)))
    assert (jl.mle(fewer, sensor) <= jl.mle(more, sensor)).all()


@pytest.mark.slow
@given(sensors_and_bits(), st.data())
def test_another_one_never_makes_a_pixel_darker(case, data):
    sensor, bits = case
    frame, row, column = (data.draw(st.integers(0, size - 1)) for size in bits.shape)
    before = without_warnings(jl.mle, jl.Bits.from_array(bits), sensor)
    bits[frame, row, column] = True
    assert (before <= without_warnings(jl.mle, jl.Bits.from_array(bits), sensor)).all()
