"""The bits of a seed never change, so that published seeds reproduce their data."""

import hashlib

import numpy as np
import pytest

import jotlight as jl
from jotlight.seeds import seed_bytes
from reference import sensing
from reference.chacha import chacha8, uniforms

IMAGE = np.linspace(0, 1, 77).reshape(7, 11)


def test_the_reference_generator_has_the_published_keystream():
    """ECRYPT test vector of ChaCha8 with 256-bit key 0 and stream 0."""
    assert chacha8(bytes(32), 0, 1).tobytes().hex() == (
        "3e00ef2f895f40d67f5bb8e81f09a5a12c840ec3ce9a7f3b181be188ef711a1e"
        "984ce172b9216f419f445367456d5619314a42a3da86b001387bfdb80e0cfe42"
    )


@pytest.mark.parametrize("threshold", [1, 3])
@pytest.mark.parametrize("kernel", ["box", "cubic"])
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


def test_the_second_random_number_decides_where_the_first_is_equal():
    """About one in 2¹⁶ random numbers equals the probability in its first 16 bits."""
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
        (jl.Sensor(), "46e1cd3980ca546f"),
        (jl.Sensor(oversampling=5, frames=3, threshold=2, gain=150), "821a54be0019531f"),
        (
            jl.Sensor(oversampling=4, frames=2, kernel="quadratic", dark_counts=0.01),
            "231188191876ce4b",
        ),
    ],
)
def test_the_bits_of_a_seed_never_change(sensor, digest):
    bits = sensor.expose(IMAGE, rng=20160224)
    assert hashlib.sha256(bits.packed.tobytes()).hexdigest()[:16] == digest
