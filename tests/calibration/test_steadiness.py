"""Correlated frames and change over time: found where they are, and no alarm where they are not."""

import dataclasses
import tracemalloc

import numpy as np
import pytest
from scipy.stats import binom, norm

import jotlight as jl
from jotlight.calibration import steadiness
from jotlight.calibration.steadiness import block_frames
from jotlight.sensing.bits.frames import Frames


@pytest.mark.slow
@pytest.mark.parametrize(("chance", "frames"), [(0.02, 100), (0.3, 64), (0.9, 35), (0.2, 9)])
def test_frames_without_fault_raise_alarm_at_the_stated_rate(chance, frames):
    rng = np.random.default_rng(8)
    z = [
        (found.correlation_z, found.homogeneity_z)
        for _ in range(200)
        if (found := steadiness(jl.Bits.from_array(rng.random((frames, 20, 20)) < chance)))
    ]
    z = np.array(z)
    assert len(z) == 200
    np.testing.assert_allclose(z.mean(axis=0), 0, atol=4 / np.sqrt(200))
    np.testing.assert_allclose(z.std(axis=0), 1, atol=4 / np.sqrt(400))
    for alarms in (np.abs(z[:, 0]) > norm.isf(0.025), z[:, 1] > norm.isf(0.05)):
        assert alarms.sum() <= binom.isf(1e-3, 200, 0.06)


def test_correlated_frames_are_found():
    rng = np.random.default_rng(9)
    frames = rng.random((400, 32, 32)) < 0.1
    # Afterpulses: each detection brings one in the next frame with a chance of 3 %.
    frames[1:] |= frames[:-1] & (rng.random((399, 32, 32)) < 0.03)
    found = steadiness(jl.Bits.from_array(frames))
    assert abs(found.correlation - 0.027) < 4 * found.correlation_error + 0.003
    assert found.correlation_z > 8
    with pytest.warns(jl.JotlightWarning, match="successive frames are correlated"):
        jl.calibrate(jl.Bits.from_array(frames))


@pytest.mark.slow
def test_motion_is_found_where_it_is():
    rng = np.random.default_rng(10)
    chance = np.full((200, 32, 32), 0.2)
    for t in range(200):
        place = t * 20 // 200
        chance[t, 8:16, place : place + 8] = 0.5
    bits = jl.Bits.from_array(rng.random(chance.shape) < chance)
    found = steadiness(bits)
    assert found.homogeneity_z > 15
    assert found.map[8:16, 4:24].mean() > 2
    assert abs(found.map[20:].mean()) < 0.3
    # Jots that the mask leaves out do not count.
    mask = np.zeros((32, 32), bool)
    mask[8:16] = True
    assert abs(steadiness(bits, mask).homogeneity_z) < 4
    with pytest.warns(jl.JotlightWarning, match="counts change over time"):
        jl.calibrate(bits)


def test_few_frames_and_frames_that_never_change_tell_nothing():
    assert steadiness(jl.Bits.from_array(np.eye(7, 8, dtype=bool)[:, :, None])) is None
    assert steadiness(jl.Bits.from_array(np.ones((30, 4, 4), bool))) is None


def test_frames_in_files_are_looked_at_in_constant_memory():
    rng = np.random.default_rng(11)
    block = np.packbits(rng.random((64, 128, 256)) < 0.2, axis=2)

    def read(start, stop):
        return block[np.arange(start, stop) % 64]

    bits = jl.Bits(Frames((6400, *block.shape[1:]), read))
    tracemalloc.start()
    found = steadiness(bits)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found is not None
    # All frames are 26 MB packed, 210 MB unpacked; larger captures take no more.
    assert peak < 64 << 20
    same = steadiness(jl.Bits(np.tile(block, (2, 1, 1))))
    parts = steadiness(jl.Bits(Frames((128, *block.shape[1:]), read)))
    assert same.correlation == parts.correlation
    np.testing.assert_array_equal(same.map, parts.map)


@pytest.mark.parametrize("mask", [np.zeros((6, 8), np.int64), np.zeros((8, 6), bool)])
def test_a_mask_of_another_type_or_shape_is_refused(mask):
    bits = jl.Bits.from_array(np.random.default_rng(0).random((40, 6, 8)) < 0.3)
    with pytest.raises(ValueError, match=r"mask: expected bool of shape \(6, 8\), got"):
        steadiness(bits, mask)


@pytest.mark.parametrize("frames", [8, 76, 79, 1000])
def test_the_number_of_blocks_is_as_documented(frames):
    assert 2 <= frames // block_frames(frames) <= 19
    assert {79: 19, 1000: 16}.get(frames, 0) in (0, frames // block_frames(frames))


def test_results_are_equal_if_all_values_are():
    frames = np.random.default_rng(12).random((64, 8, 8)) < 0.3
    found, again = (steadiness(jl.Bits.from_array(frames)) for _ in range(2))
    assert found == again
    assert hash(found) == hash(again)
    assert found != dataclasses.replace(found, map=found.map + 1)
    assert found != dataclasses.replace(found, correlation=0.5)
    assert found != "steady"
