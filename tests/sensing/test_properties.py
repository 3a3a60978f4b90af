"""Properties that hold for every sensor and all bits."""

import tempfile
from pathlib import Path

import hypothesis.extra.numpy as hnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl

NUMBERS = {
    "gain": st.none() | st.floats(0.01, 1e5),
    "threshold": st.integers(1, 12),
    "efficiency": st.floats(0.01, 1),
    "max_intensity": st.floats(0.01, 100),
    "dark_counts": st.floats(0, 3),
}
IMAGE_SHAPES = hnp.array_shapes(min_dims=2, max_dims=2, max_side=9)


@st.composite
def sensors(draw, **fixed):
    numbers = draw(st.fixed_dictionaries({k: v for k, v in NUMBERS.items() if k not in fixed}))
    return jl.Sensor(**numbers, **fixed)


@st.composite
def sensors_and_bits(draw):
    """A sensor with or without maps, and any bits that fit it."""
    side, frames = draw(st.integers(1, 4)), draw(st.integers(1, 5))
    height, width = (side * draw(st.integers(1, 5)) for _ in range(2))
    maps = {}
    if draw(st.booleans()):
        maps["mask"] = draw(hnp.arrays(bool, (height, width)))
        maps["mask"][0, 0] = False
    if draw(st.booleans()):
        maps["dark_counts"] = draw(
            hnp.arrays(np.float32, (height, width), elements=st.floats(0, 3, width=32))
        )
    sensor = draw(sensors(oversampling=side, frames=frames, **maps))
    return sensor, draw(hnp.arrays(bool, (frames, height, width)))


def without_warnings(function, *arguments, **options):
    """Return the result without the warnings about inpainted dead pixels."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        return function(*arguments, **options)


def assert_in_range(estimate, sensor):
    assert np.isfinite(estimate).all()
    assert estimate.min() >= 0
    assert estimate.max() <= np.float32(sensor.max_intensity)


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


@given(sensors_and_bits(), st.floats(0.05, 5), st.integers(5, 200))
def test_the_initial_network_stays_between_0_and_the_largest_intensity(case, sigma, coefficients):
    sensor, bits = case
    network = jl.Network.initial(sensor, sigma=sigma, coefficients=coefficients)
    estimate = without_warnings(network.reconstruct, jl.Bits.from_array(bits), sensor)
    assert_in_range(estimate, sensor)


@given(st.data())
def test_the_maximum_likelihood_estimate_rises_with_the_counts(data):
    sensor = data.draw(sensors(frames=data.draw(st.integers(1, 5000))))
    counts = st.integers(0, sensor.frames)
    fewer = data.draw(hnp.arrays(np.int64, data.draw(IMAGE_SHAPES), elements=counts))
    more = np.maximum(fewer, data.draw(hnp.arrays(np.int64, fewer.shape, elements=counts)))
    assert (jl.mle(fewer, sensor) <= jl.mle(more, sensor)).all()


@given(sensors_and_bits(), st.data())
def test_another_one_never_makes_a_pixel_darker(case, data):
    sensor, bits = case
    frame, row, column = (data.draw(st.integers(0, size - 1)) for size in bits.shape)
    before = without_warnings(jl.mle, jl.Bits.from_array(bits), sensor)
    bits[frame, row, column] = True
    assert (before <= without_warnings(jl.mle, jl.Bits.from_array(bits), sensor)).all()


@given(sensors_and_bits())
def test_saved_bits_are_opened_with_their_width_and_sensor(case):
    sensor, values = case
    bits = jl.Bits.from_array(values, sensor)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cube.npy"
        jl.save(bits, path)
        loaded = jl.open(path)
        assert loaded.shape == bits.shape
        assert loaded.sensor == sensor
        np.testing.assert_array_equal(loaded.to_array(), values)


@given(
    hnp.arrays(bool, hnp.array_shapes(min_dims=3, max_dims=4, max_side=20)),
)
def test_saved_bits_of_any_width_and_color_are_opened(values):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cube.npy"
        jl.save(jl.Bits.from_array(values), path)
        np.testing.assert_array_equal(jl.open(path).to_array(), values)


@given(sensors(frames=4), st.floats(0.1, 3), st.booleans())
def test_saved_networks_are_loaded(sensor, sigma, tied):
    network = jl.Network.initial(sensor, sigma=sigma, tied=tied)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        network.save(path)
        loaded = jl.Network.load(path)
    assert loaded.sensor == sensor
    bits = jl.Bits.from_array(np.random.default_rng(0).random((4, 5, 6)) < 0.5)
    np.testing.assert_array_equal(loaded.reconstruct(bits), network.reconstruct(bits))


@given(hnp.arrays(np.float64, 50, elements=st.floats(-1e6, 1e6)), st.integers(1, 3000))
def test_inverse_transforms_map_any_value_to_the_range_of_counts(z, bits):
    for inverse in jl.vst.INVERSES:
        counts = jl.vst.inverse_anscombe(np.sort(z), bits, inverse=inverse)
        assert (np.diff(counts) >= 0).all()
        assert counts.min() >= 0
        assert counts.max() <= bits
