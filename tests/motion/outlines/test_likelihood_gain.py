"""The gain of the likelihood: noise gains nothing, and true motions gain much."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.displacements.scoring import make_blurred_template, make_template
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.outlines.likelihood_gain import likelihood_gain
from jotlight.motion.tiles import tile_counts
from moving import blocks_of, paths_of, record


def still(blocks):
    return Paths([Track.still(blocks)], np.zeros(blocks.size, np.uint8))


@pytest.mark.parametrize("density", [0.01, 0.1, 0.5])
@pytest.mark.parametrize("speed", [0.3, 2.0])
def test_motions_of_noise_gain_nothing(density, speed):
    """Fewer bits remain in view, so their own template fits them better. Other bits it does not."""
    rng = np.random.default_rng(0)
    blocks = blocks_of(jl.Bits.from_array(rng.random((32, 64, 64)) < density))
    moving = paths_of(blocks, np.outer(blocks.centers - 16, (speed, -speed)), 16)
    assert likelihood_gain(moving) < len(blocks.centers)


@pytest.mark.parametrize("photons", [0.05, 0.5])
def test_the_true_motion_gains_much_and_the_wrong_one_loses(photons):
    scene, bits = record("shake", photons=photons)
    blocks = blocks_of(bits)
    shifts = np.stack([scene.motion(time)[:, 0, 0] for time in blocks.centers])
    gain = likelihood_gain(paths_of(blocks, shifts, scene.reference))
    # Most photons show the texture at places that differ by some pixels from those without motion.
    assert gain > 0.02 * bits.counts().sum()
    assert likelihood_gain(paths_of(blocks, -shifts, scene.reference)) < 0.5 * gain


def test_the_gain_of_mirrored_bits_along_the_mirrored_motion_is_the_same():
    """Bits that leave the view at one border count as much as those at the opposite one."""
    size, rng = (64, 80), np.random.default_rng(1)
    rows, columns = np.indices(size) / size[0]
    bits = rng.random((32, *size)) < 0.05 + 0.4 * rows * columns
    gains = []
    for sign, array in ((1, bits), (-1, bits[:, ::-1, ::-1])):
        blocks = blocks_of(jl.Bits.from_array(np.ascontiguousarray(array)))
        shifts = sign * np.outer(blocks.centers - 15.5, (0.2, 0.3))
        gains.append(likelihood_gain(paths_of(blocks, shifts, 16), make_blurred_template))
    assert gains[0] == pytest.approx(gains[1], rel=0.01)


def test_nothing_gains_over_itself():
    _, bits = record("shake")
    none = still(blocks_of(bits))
    assert likelihood_gain(none) == 0


@pytest.mark.slow
def test_the_gain_is_that_of_a_loop_over_frames():
    """With whole shifts in each block, a loop over blocks counts the same bits."""
    _, bits = record("shake", photons=0.3)
    array, (height, width) = bits.to_array(), bits.shape[1:]
    blocks = blocks_of(bits, 12)
    shifts = np.outer(np.arange(12) - 6, (1, -2))
    moving = paths_of(blocks, shifts, 24)

    rows, columns = np.indices((height, width))

    def counts(block, shift):
        y, x = rows + shift[0], columns + shift[1]
        seen = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        frames = array[4 * block : 4 * block + 4].sum(axis=0)
        return np.where(seen, frames[y % height, x % width], 0), 4 * seen

    # Each block has one shift if it does not change toward its neighbors.
    moving.tracks[0].sums = lambda block: constant_sums(blocks, block, shifts[block])
    mean = array.mean()
    gain, kept, others, unmoved = 0.0, 0.0, 0.0, 0.0
    none = still(blocks)
    for block in range(12):
        halves = [
            [motion.sums(other) for other in range(12) if other % 2 != block % 2]
            for motion in (moving, none)
        ]
        own, of_still = (
            make_template(sum(half[1:], half[0]), None).probability.astype(float) for half in halves
        )
        ones, trials = counts(block, shifts[block])
        gain += (ones * np.log(own / mean)).sum()
        gain += ((trials - ones) * np.log((1 - own) / (1 - mean))).sum()
        kept += trials.sum()
        # The share of the bits of a position that are in view, in squares of four pixels.
        half = [other for other in range(12) if other % 2 == block % 2]
        share = np.zeros((height, width))
        for shift in shifts[half]:
            y, x = rows // 4 * 4 + 1.5 - shift[0], columns // 4 * 4 + 1.5 - shift[1]
            share += ((y > -0.5) & (y < height - 0.5) & (x > -0.5) & (x < width - 0.5)) / 6
        ones, trials = counts(block, (0, 0))
        terms = ones * np.log(of_still / mean)
        terms += (trials - ones) * np.log((1 - of_still) / (1 - mean))
        others += (terms * share).sum()
        unmoved += (trials * share).sum()
    expected = gain - others * kept / unmoved
    assert likelihood_gain(moving) == pytest.approx(expected, rel=1e-3)


def constant_sums(blocks, block, shift):
    field = np.zeros((2, *tile_counts(blocks.size))) + np.asarray(shift)[:, None, None]
    frames = range(blocks.edges[block], blocks.edges[block + 1])
    return blocks.count(frames, (field, field), (frames.start, frames.stop))
