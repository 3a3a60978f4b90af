"""χ² of blocks: the engine against its twin, and blocks that agree or not."""

import dataclasses

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, shift

import jotlight as jl
from jotlight import _engine as engine
from jotlight.motion import consistency
from jotlight.motion.blocks import Sums
from jotlight.motion.consistency import (
    ComparedBlock,
    add_agreeing,
    chi_squared,
    disagreement,
    find_consistent,
)
from jotlight.motion.path_search import _still
from jotlight.motion.scoring import Template
from jotlight.motion.track import Paths
from moving import blocks_of, random_counts
from reference import motion as reference


def random_case(seed, size, trials, threads=None):
    """Return sums and a template of random counts; a part of the pixels has no trials."""
    rng = np.random.default_rng(seed)
    sums = Sums.zeros(size)
    sums.ones, sums.trials = random_counts(rng, size, trials)
    probability = rng.uniform(0.01, 0.99, size).astype(np.float32)
    return sums, Template(probability, rng.integers(0, 50, size, np.int32), threads)


@settings(max_examples=60)
@given(
    st.integers(0, 2**32),
    st.tuples(st.integers(1, 80), st.integers(1, 100)),
    st.sampled_from([0, 1, 8, 128]),
)
def test_chi_squared_is_that_of_the_twin(seed, size, trials):
    sums, template = random_case(seed, size, trials)
    expected = reference.chi_squared(sums.ones, sums.trials, template.probability, template.trials)
    np.testing.assert_allclose(chi_squared(sums, template), expected, rtol=1e-4)


@pytest.mark.parametrize("light", [1e-4, 8.0])
def test_bits_of_dim_and_of_saturated_scenes_agree(light):
    """Few bits differ from the others there, and none of them disagrees by itself."""
    rng = np.random.default_rng(0)
    bits = rng.random((64, 64, 64)) < -np.expm1(-light * rng.uniform(0.9, 1.1, (64, 1, 1)))
    blocks = blocks_of(jl.Bits.from_array(bits))
    still = Paths([_still(blocks, 32)], np.zeros(blocks.size, np.uint8))
    assert find_consistent(still).accepted.mean() > 0.999


def test_many_trials_do_not_show_small_errors():
    """More trials than 512 count as 512 with the same fraction of ones."""
    size, rng = (60, 70), np.random.default_rng(3)
    probability = rng.uniform(0.1, 0.9, size).astype(np.float32)
    template = Template(probability, np.full(size, 10**6, np.int32))
    shifted = np.clip(probability + rng.normal(0, 0.02, size), 0, 1)

    def sums_of(trials):
        sums = Sums.zeros(size)
        sums.trials[:], sums.ones[:] = trials, np.rint(trials * shifted)
        return sums

    few, many = sums_of(512), sums_of(512 * 1000)
    np.testing.assert_allclose(
        chi_squared(many, template), chi_squared(few, template), rtol=0.2, atol=0.05
    )
    np.testing.assert_allclose(disagreement(many, few), disagreement(few, few), atol=0.01)
    raw = reference.chi_squared(many.ones, many.trials, template.probability, template.trials)
    assert raw.mean() > 100
    assert chi_squared(many, template).mean() < 2.5


def test_the_shift_that_rounding_causes_is_no_disagreement():
    size, rng, trials = (96, 96), np.random.default_rng(4), 400
    image = gaussian_filter(rng.normal(size=size), 2.5, mode="wrap")
    probability = 0.4 + 0.3 * np.tanh(image / image.std())
    template = Template(probability.astype(np.float32), np.full(size, 10**6, np.int32))
    rounded = shift(probability, (-0.4, 0.3), order=5, mode="grid-wrap")
    sums = Sums.zeros(size)
    sums.trials[:], sums.ones[:], sums.frames = trials, rng.binomial(trials, rounded), trials
    inner = np.s_[8:-8, 8:-8]
    assert chi_squared(sums, template)[inner].mean() > 3
    sums.remainders[:] = trials * np.float32([0.4, -0.3])[:, None]
    assert chi_squared(sums, template)[inner].mean() < 1.4


def agreeing_case(seed, size, light=1.0, threads=None):
    """Return three neighboring blocks, and a template that is brighter by a factor."""
    rng = np.random.default_rng(seed)
    blocks = [random_case(seed + index, size, 9)[0] for index in range(3)]
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
    monkeypatch.setattr(consistency, "_FEW_TRIALS", 0)
    for one, other in zip(alone, accept(*agreeing_case(5, size, light), size), strict=True):
        np.testing.assert_array_equal(one, other)
    assert 0 < alone[1].sum() < alone[3].sum() - alone[3].size


@pytest.mark.parametrize("level", engine.cpu_levels())
@pytest.mark.parametrize("size", [(1, 1), (3, 200), (97, 61)])
def test_any_number_of_threads_gives_the_same_chi_squared(level, size):
    engine.choose_cpu_level(level)
    try:
        one, *others = (chi_squared(*random_case(1, size, 9, threads)) for threads in (1, 2, 3))
    finally:
        engine.choose_cpu_level(None)
    for other in others:
        np.testing.assert_array_equal(one, other)


def test_chi_squared_of_counts_that_agree_is_about_1():
    rng = np.random.default_rng(2)
    size, sums = (200, 200), Sums.zeros((200, 200))
    probability = rng.uniform(0.1, 0.9, size)
    sums.trials[:] = 20
    sums.ones[:] = rng.binomial(20, probability)
    template = Template(probability.astype(np.float32), np.full(size, 10**6, np.int32))
    found = chi_squared(sums, template)
    assert found.mean() == pytest.approx(1, abs=0.05)
    sums.ones[80:120, 80:120] = rng.binomial(20, 1 - probability[80:120, 80:120])
    changed = chi_squared(sums, template)
    assert changed[90:110, 90:110].min() > 2.5
    # The changed part has a slightly different mean, which counts as the brightness of the block.
    np.testing.assert_allclose(changed[:70], found[:70], rtol=0.1, atol=0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ones": np.zeros((5, 7), np.int32)}, "numbers of ones: expected \\(5, 8\\)"),
        ({"ones": np.full((5, 8), 3, np.int32)}, "expected 0 to that of trials"),
        ({"p": np.full((5, 8), np.nan, np.float32)}, "numbers above 0 and below 1"),
        ({"of_template": np.ones((5, 9), np.int32)}, "trials of the template"),
        ({"out": np.zeros((4, 8), np.float32)}, "output: expected \\(5, 8\\)"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(changes, message):
    arguments = {
        "ones": np.zeros((5, 8), np.int32),
        "trials": np.full((5, 8), 2, np.int32),
        "p": np.full((5, 8), 0.5, np.float32),
        "of_template": np.ones((5, 8), np.int32),
        "out": np.zeros((5, 8), np.float32),
    }
    with pytest.raises(ValueError, match=message):
        engine.chi_squared(*{**arguments, **changes}.values(), None)


def hidden_scene(rng, channels=()):
    """Return static bits, (T, H, W), of which a square is hidden from frame 40 of 64 on."""
    p = np.full((64, 64, 80, *channels), 0.15)
    p[:, ::4] = 0.4
    # The mean is the same as before: else, the whole block would seem to be brighter.
    p[40:, 20:44, 20:32], p[40:, 20:44, 32:44] = 0.4, 0.025
    return rng.random(p.shape) < p


def test_what_hides_the_scene_is_left_out():
    bits = hidden_scene(np.random.default_rng(3))
    still = _still(blocks_of(jl.Bits.from_array(bits)), 32)
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


def test_a_dim_scene_that_stands_still_keeps_nearly_all_bits():
    image = jl.datasets.photograph("camera")[100:228, 180:308]
    sensor = jl.Sensor(frames=64, gain=0.05 * 64 / image.mean())
    kept = []
    for seed in range(4):
        still = _still(blocks_of(sensor.expose(image, rng=seed)), 32)
        kept.append(find_consistent(still, is_still=True).accepted.mean())
    # Up to a χ² of 3.5, it would be 0.9985.
    assert np.mean(kept) > 0.999


def test_other_channels_are_counted_where_their_sum_agrees():
    color = hidden_scene(np.random.default_rng(4), (3,))
    still = _still(blocks_of(jl.Bits.from_array(color)), 32)
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
    assert find_consistent(_still(blocks_of(bits), 32)).accepted.mean() > 0.97


def test_pixels_without_bits_have_no_accepted_bits():
    rng = np.random.default_rng(6)
    valid = rng.random((32, 32)) < 0.5
    blocks = blocks_of(jl.Bits.from_array(rng.random((32, 32, 32)) < 0.3))
    blocks = dataclasses.replace(blocks, valid=np.packbits(valid, axis=1))
    found = find_consistent(_still(blocks, 16))
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
