"""The bits of a seed never change, so that published seeds reproduce their data."""

import hashlib

import numpy as np
import pytest
from scipy.stats import poisson

import jotlight as jl
from jotlight.seeds import seed_bytes
from reference import sensing
from reference.chacha import chacha8, noise, uniforms

IMAGE = np.linspace(0, 1, 77).reshape(7, 11)


def test_the_reference_generator_has_the_published_keystream():
    """ECRYPT test vector of ChaCha8 with 256-bit key 0 and stream 0."""
    assert chacha8(bytes(32), 0, 1).tobytes().hex() == (
        "3e00ef2f895f40d67f5bb8e81f09a5a12c840ec3ce9a7f3b181be188ef711a1e"
        "984ce172b9216f419f445367456d5619314a42a3da86b001387bfdb80e0cfe42"
    )


@pytest.mark.parametrize(
    ("kernel", "threshold"),
    [
        ("box", 1),
        ("cubic", 3),
        pytest.param("box", 3, marks=pytest.mark.slow),
        pytest.param("cubic", 1, marks=pytest.mark.slow),
    ],
)
def test_a_bit_is_1_if_the_random_number_of_its_position_is_below_its_probability(
    threshold, kernel
):
    sensor = jl.Sensor(oversampling=7, frames=2, gain=300, threshold=threshold, kernel=kernel)
    image = np.stack([IMAGE, IMAGE[::-1] / 50], axis=2)
    bits = sensor.expose(image, rng=5, channel_axis=-1).to_array()
    for channel, frame, row in [(0, 0, 0), (0, 1, 48), (1, 0, 17), (1, 1, 30)]:
        draws = uniforms(seed_bytes(5), channel=channel, frame=frame, row=row, columns=77)
        probability = sensing.probability(sensor, image[..., channel])[row] * 2**48
        np.testing.assert_array_equal(bits[frame, row, :, channel], draws < np.rint(probability))


@pytest.mark.slow
def test_draws_of_wide_rows_come_from_several_groups():
    sensor = jl.Sensor(frames=2, kernel="linear")
    image = np.random.default_rng(0).random((3, 5000))
    bits = sensor.expose(image, rng=6, tile=(slice(1, 3), slice(700, 4900))).to_array()
    draws = uniforms(seed_bytes(6), frame=1, row=2, columns=5000)
    probability = sensing.probability(sensor, image)[2] * 2**48
    np.testing.assert_array_equal(bits[1, 1], (draws < np.rint(probability))[700:4900])


@pytest.mark.filterwarnings("ignore:read_noise")
def test_read_noise_has_random_numbers_of_its_own():
    """Readings are the photons of the random numbers of bits, plus normal numbers."""
    sensor = jl.Sensor(frames=2, bit_depth=6, read_noise=0.7, dark_counts=20.0)
    readings = sensor.expose(np.zeros((2, 301)), rng=2, tile=(slice(2), slice(50, 301))).to_array()
    seed, place = seed_bytes(2), {"frame": 1, "row": 1, "columns": 301}
    photons = poisson.isf((uniforms(seed, **place) + 0.5) / 2**48, 20)
    u, v = ((noise(seed, **place) >> np.uint64(12)) + 0.5).T / 2**52
    normal = np.sqrt(-2 * np.log(u)) * np.cos(2 * np.pi * v)
    expected = np.clip(np.rint(photons + 0.7 * normal), 0, 63)
    np.testing.assert_array_equal(readings[1, 1], expected[50:])


def test_the_second_random_number_decides_where_the_first_is_equal():
    """Some random numbers equal the probability even in their first 16 bits."""
    sensor = jl.Sensor()
    probability = 2.4 / 2**16
    image = np.full((1, 1 << 18), -np.log1p(-probability))
    draws = uniforms(seed_bytes(1), columns=image.shape[1])
    expected = draws < probability * 2**48
    assert np.count_nonzero(draws >> 32 == 2) > 1
    np.testing.assert_array_equal(sensor.expose(image, rng=1).to_array()[0, 0], expected)


@pytest.mark.parametrize(
    ("sensor", "digest"),
    [
        (jl.Sensor(), "d9b57a1082bbaa2e"),
        (jl.Sensor(oversampling=5, frames=3, threshold=2, gain=150), "b577489f20ff6806"),
        (
            jl.Sensor(oversampling=4, frames=2, kernel="quadratic", dark_counts=0.01),
            "95abbbc051238c99",
        ),
    ],
)
def test_the_bits_of_a_seed_never_change(sensor, digest):
    bits = sensor.expose(IMAGE, rng=20160224)
    assert hashlib.sha256(bits.packed.tobytes()).hexdigest()[:16] == digest
