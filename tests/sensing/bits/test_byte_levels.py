"""Arrays in place of packed bits whose bytes each hold one number."""

import numpy as np
import pytest

import jotlight as jl

UNPACKED = (np.random.default_rng(0).random((16, 64, 64)) < 0.3).astype(np.uint8)


@pytest.mark.parametrize(("white", "packing"), [(1, "array"), (255, r"array == 255")])
def test_unpacked_bits_are_refused(white, packing):
    with pytest.raises(ValueError, match=rf"only 0 and {white}, .*from_array\({packing}\) packs"):
        jl.Bits(UNPACKED * np.uint8(white), sensor=jl.Sensor(frames=16))


def test_counts_are_refused():
    counts = np.random.default_rng(1).poisson(3.0, (4, 16, 16)).astype(np.uint8)
    with pytest.raises(ValueError, match=f"at most {counts.max()}, as in images of counts"):
        jl.Bits(counts)


def test_a_width_states_that_bits_are_packed():
    np.testing.assert_array_equal(jl.Bits(UNPACKED, width=512).packed, UNPACKED)


@pytest.mark.parametrize("light", [1e-5, 1e-4, 1e-3, 0.1, 50.0])
def test_packed_bits_of_dim_and_bright_scenes_are_accepted(light):
    sensor = jl.Sensor(frames=16, gain=16.0, max_intensity=100.0)
    for seed in range(20):
        bits = sensor.expose(np.full((64, 64), light), rng=seed)
        assert jl.Bits(bits.packed).shape == (16, 64, 64)


def test_the_middle_and_the_end_of_dim_frames_are_inspected():
    frames = np.zeros((600, 64, 64), np.uint8)
    frames[300, :2, :4] = 1
    with pytest.raises(ValueError, match="only 0 and 1"):
        jl.Bits(frames)
    frames[-1, 5, 5] = 2
    frames[300, :2, 3:] = 0
    assert jl.Bits(frames).shape == (600, 64, 512)
