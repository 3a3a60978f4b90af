"""Blocks that agree with the others or not: the engine against its twin, and simulated scenes."""

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import jotlight as jl
from jotlight.motion.agreement import consistency
from jotlight.motion.agreement.consistency import ComparedBlock, add_agreeing, find_consistent
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements import disagreement as disagreement_module
from jotlight.motion.displacements.scoring import Template, make_template
from jotlight.motion.displacements.track import Paths, Track
from moving import blocks_of, random_counts
from reference import motion as reference


@pytest.mark.parametrize("light", [1e-4, 8.0])
def test_bits_of_dim_and_of_saturated_scenes_agree(light):
    """Few bits differ from the others there, and none of them disagrees by itself."""
    rng = np.random.default_rng(0)
    bits = rng.random((64, 64, 64)) < -np.expm1(-light * rng.uniform(0.9, 1.1, (64, 1, 1)))
    blocks = blocks_of(jl.Bits.from_array(bits))
    still = Paths([Track.still(blocks)], np.zeros(blocks.size, np.uint8))
    assert find_consistent(still).accepted.mean() > 0.999


def random_sums(seed, size, trials):
    """Return sums of random counts; a part of the pixels has no trials."""
    sums = Sums.zeros(size)
    sums.ones, sums.trials = random_counts(np.random.default_rng(seed), size, trials)
    return sums


def agreeing_case(seed, size, light=1.0, threads=None):
    """Return three neighboring blocks, and a template that is brighter by a factor."""
    rng = np.random.default_rng(seed)
    blocks = [random_sums(seed + index, size, 9) for index in range(3)]
    probability = np.clip(light * 0.4 + rng.normal(0, 0.1, size), 0.01, 0.99).astype(np.float32)
    template = Template(probability, rng.integers(0, 50, size, np.int32), threads)
    near = [(blocks[:2], 0), (blocks, 1), (blocks[1:], 1)]
    return [ComparedBlock(block, *each, max_trials=27) for block, each in enumerate(near)], template


def accept(tested, template, size):
    """Return the counts and masks where blocks agree with a template, and the available trials."""
    total, available = Sums.zeros(size), np.ones(size, np.int32)
    masks = np.full((len(tested), size[0], -(-size[1] // 8)), 7, np.uint8)
    add_agreeing(total, tested, template, 1.2, masks, available)
    return total.ones, total.trials, masks, available


@settings(max_examples=20)
@given(st.integers(0, 2**32), st.tuples(st.integers(40, 80), st.integers(40, 100)))
def test_the_counts_that_agree_are_those_of_the_twin(seed, size):
    tested, template = agreeing_case(seed, size)
    arrays, is_clear = [template.probability, template.trials], np.ones(size, bool)
    expected = np.zeros((2, *size), int)
    ones, trials, masks, available = accept(tested, template, size)
    for each, mask in zip(tested, masks, strict=True):
        parts = [(near.ones, near.trials) for near in each.near]
        counts = [sum(part) for part in zip(*parts, strict=True)]
        assume(abs(reference.brightness(*counts, arrays[0]) - 1) < 0.029)
        own = each.sums.ones, each.sums.trials
        *accepted, agrees = reference.accept_agreeing(parts, *arrays, 1.2, own)
        expected += accepted
        is_clear &= abs(reference.chi_squared(*counts, *arrays) - 1.2) > 1e-3
        found = np.unpackbits(mask, axis=1, count=size[1]).astype(bool)
        np.testing.assert_array_equal(found[is_clear], agrees[is_clear])
    np.testing.assert_array_equal(np.stack([ones, trials])[:, is_clear], expected[:, is_clear])
    np.testing.assert_array_equal(available, 1 + sum(each.sums.trials for each in tested))


@pytest.mark.parametrize("light", [1.0, 1.3])
def test_the_engine_accepts_the_counts_that_single_steps_accept(light, monkeypatch):
    """Where the light changes, the template changes with it, so the engine leaves it to them."""
    size = 97, 61
    alone = accept(*agreeing_case(5, size, light), size)
    for threads in (1, 2, 3):
        again = accept(*agreeing_case(5, size, light, threads), size)
        for one, other in zip(alone, again, strict=True):
            np.testing.assert_array_equal(one, other)
    for module in (consistency, disagreement_module):
        monkeypatch.setattr(module, "FEW_TRIALS", 0)
    for one, other in zip(alone, accept(*agreeing_case(5, size, light), size), strict=True):
        np.testing.assert_array_equal(one, other)
    assert 0 < alone[1].sum() < alone[3].sum() - alone[3].size


def hidden_scene(rng, channels=()):
    """Return static bits, (T, H, W), of which a square is hidden from frame 40 of 64 on."""
    p = np.full((64, 64, 80, *channels), 0.15)
    p[:, ::4] = 0.4
    # The mean is the same as before: else, the whole block would seem to be brighter.
    p[40:, 20:44, 20:32], p[40:, 20:44, 32:44] = 0.4, 0.025
    return rng.random(p.shape) < p


def test_what_hides_the_scene_is_left_out():
    bits = hidden_scene(np.random.default_rng(3))
    still = Track.still(blocks_of(jl.Bits.from_array(bits)))
    found = find_consistent(still)
    # The last block before it is tested together with the next one, so it may be left out, too.
    assert np.isin(found.total.trials[24:40, 24:40], (36, 40)).mean() > 0.9
    assert found.accepted[24:40, 24:40].mean() == pytest.approx(38 / 64, abs=0.04)
    assert found.accepted[:, 60:].mean() > 0.98
    # The sums are those of the accepted blocks.
    ones, trials = np.zeros((64, 80), int), np.zeros((64, 80), int)
    masks = np.unpackbits(found.masks, axis=2, count=80).astype(bool)
    for block, mask in enumerate(masks):
        ones += np.where(mask, bits[4 * block : 4 * block + 4].sum(axis=0), 0)
        trials += np.where(mask, 4, 0)
    np.testing.assert_array_equal(found.total.ones, ones)
    np.testing.assert_array_equal(found.total.trials, trials)
    np.testing.assert_allclose(found.accepted, trials / 64)
    assert masks[7:9].all()
    np.testing.assert_array_equal(found.before.trials + found.after.trials, trials)
    assert found.before.trials.max() <= 32


@pytest.mark.parametrize(("rings", "templates"), [((2, 2), 3), ((4, 4), 1), ((2, 4), 2)])
def test_wider_rings_leave_out_the_same_with_fewer_templates(rings, templates, monkeypatch):
    made = []

    def make(*args):
        made.append(make_template(*args))
        return made[-1]

    monkeypatch.setattr(consistency, "make_template", make)
    still = Track.still(blocks_of(jl.Bits.from_array(hidden_scene(np.random.default_rng(3)))))
    found = find_consistent(still, rings=rings)
    assert len(made) == templates
    assert found.accepted[24:40, 24:40].mean() == pytest.approx(38 / 64, abs=0.05)
    assert found.accepted[:, 60:].mean() > 0.98
    masks = np.unpackbits(found.masks, axis=2, count=80)
    first = rings[0] // 2
    assert masks[8 - first : 8 + first].all()


def test_a_dim_scene_that_stands_still_keeps_nearly_all_bits():
    image = jl.datasets.photograph("camera")[100:228, 180:308]
    sensor = jl.Sensor(frames=64, gain=0.05 * 64 / image.mean())
    kept = []
    for seed in range(4):
        still = Track.still(blocks_of(sensor.expose(image, rng=seed)))
        kept.append(find_consistent(still, is_still=True).accepted.mean())
    # Up to a χ² of 3.5, it would be 0.9985.
    assert np.mean(kept) > 0.999


@pytest.mark.parametrize("size", [(1, 512), (512, 1), (2, 256)])
def test_a_line_of_pixels_that_stands_still_keeps_most_bits(size):
    place = np.linspace(0, 9, 512)
    image = (0.5 + 0.4 * np.sin(place**2)).reshape(size)
    still = Track.still(blocks_of(jl.Sensor(frames=256, gain=256).expose(image, rng=1)))
    assert find_consistent(still, is_still=True).accepted.mean() > 0.85


def test_other_channels_are_counted_where_their_sum_agrees():
    color = hidden_scene(np.random.default_rng(4), (3,))
    still = Track.still(blocks_of(jl.Bits.from_array(color)))
    found = find_consistent(still)
    parts = []
    for channel in range(3):
        one = dataclasses.replace(still, blocks=dataclasses.replace(still.blocks, channel=channel))
        parts.append(found.count(one))
    np.testing.assert_array_equal(sum(part.ones for part in parts), found.total.ones)
    for part in parts:
        np.testing.assert_array_equal(3 * part.trials, found.total.trials)


def test_a_block_that_is_brighter_as_a_whole_agrees():
    rng = np.random.default_rng(5)
    p = np.full((64, 64), 0.15)
    p[::4] = 0.4
    brightness = np.where(np.arange(64) % 20 < 10, 1.3, 0.7)[:, None, None]
    bits = jl.Bits.from_array(rng.random((64, 64, 64)) < p * brightness)
    assert find_consistent(Track.still(blocks_of(bits))).accepted.mean() > 0.97


def test_pixels_without_bits_have_no_accepted_bits():
    rng = np.random.default_rng(6)
    valid = rng.random((32, 32)) < 0.5
    blocks = blocks_of(jl.Bits.from_array(rng.random((32, 32, 32)) < 0.3))
    blocks = dataclasses.replace(blocks, valid=np.packbits(valid, axis=1))
    found = find_consistent(Track.still(blocks))
    assert (found.total.trials[~valid] == 0).all()
    assert (found.accepted[~valid] == 0).all()
    assert found.accepted[valid].mean() > 0.95


@pytest.mark.slow
def test_a_scene_that_is_half_as_bright_far_from_the_middle_keeps_its_bits():
    image = jl.datasets.photograph("camera")[100:228, 180:308]
    sensor = jl.Sensor(frames=256, gain=0.3 * 256)
    frames = sensor.expose(image, rng=0).to_array()
    dim = sensor.replace(gain=0.15 * 256).expose(image, rng=1).to_array()
    frames[:64], frames[192:] = dim[:64], dim[192:]
    merged = jl.merge(jl.Bits.from_array(frames), sensor)
    assert merged.acceptance.mean() > 0.97


@pytest.mark.parametrize(("blocks", "outermost"), [(2, []), (4, [1, 1]), (6, [1, 1]), (16, [4, 4])])
def test_the_outermost_blocks_are_those_of_the_last_ring(blocks, outermost):
    bits = np.random.default_rng(0).random((blocks, 24, 32)) < 0.3
    counted = blocks_of(jl.Bits.from_array(bits))
    assert len(counted.centers) == blocks
    still = Paths([Track.still(counted)], np.zeros(counted.size, np.uint8))
    found = find_consistent(still, is_still=True).outermost
    assert [sums.frames for sums in found] == outermost
    for sums, frames in zip(found, (bits[: blocks // 4], bits[-(blocks // 4) :]), strict=False):
        if blocks in (4, 16):
            np.testing.assert_array_equal(sums.ones, frames.sum(axis=0))
