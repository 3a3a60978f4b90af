"""The jots that pixels see: against loops over frames, and the response against its formula."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.counts.burst import as_burst
from jotlight.motion.counts.jots import Jots, SeenJots, inverse_response, response
from jotlight.motion.counts.sensor_blocks import as_blocks
from jotlight.motion.counts.sums import Sums
from jotlight.sensing.parameters.response import detection_probability

SIZE = 40, 70


def random_maps(rng, size=SIZE):
    return rng.uniform(0.3, 1, size).astype(np.float32), rng.uniform(0, 0.4, size)


def jots_of(threshold=1, size=SIZE, valid=None, seed=0):
    efficiency, dark = random_maps(np.random.default_rng(seed), size)
    sensor = jl.Sensor(threshold=threshold, efficiency=efficiency, dark_counts=dark)
    return Jots.of_sensor(sensor, size, valid), efficiency, dark


def test_jots_that_are_all_alike_need_no_maps():
    hot = np.zeros(SIZE)
    hot[3, 5] = 1.0
    valid = np.packbits(hot == 0, axis=1)
    mask = np.zeros(SIZE, bool)
    mask[2] = True
    for sensor, counted in [
        (jl.Sensor(efficiency=0.4, dark_counts=0.2), None),
        (jl.Sensor(efficiency=np.full(SIZE, 0.4)), None),
        (jl.Sensor(mask=mask), np.packbits(~mask, axis=1)),
        (jl.Sensor(dark_counts=hot), valid),
        (jl.Sensor(dark_counts=hot), np.zeros_like(valid)),
    ]:
        assert Jots.of_sensor(sensor, SIZE, counted) is None
    assert Jots.of_sensor(jl.Sensor(dark_counts=hot), SIZE, None) is not None


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_jots_along_a_motion_are_those_of_a_loop_over_frames(threshold):
    rng = np.random.default_rng(1)
    efficiency, dark = random_maps(rng)
    mask = rng.random(SIZE) < 0.1
    frames = 6
    sensor = jl.Sensor(
        frames=frames, threshold=threshold, efficiency=efficiency, dark_counts=dark, mask=mask
    )
    bits = jl.Bits.from_array(rng.random((frames, *SIZE)) < 0.3)
    blocks = as_blocks(as_burst(bits), np.array([0, frames]), sensor, 1, with_hot_jots=True)
    # More than a quarter of a pixel per frame, so every frame is looked up.
    fields = np.zeros((2, 2, *SIZE), np.float32)
    fields[1] = rng.uniform(-9, 9, (2, *SIZE))
    sums = blocks.count(range(frames), fields, (0, frames - 1))
    rows, columns = np.indices(SIZE)
    trials, totals = np.zeros(SIZE, int), np.zeros((2, *SIZE))
    for frame in range(frames):
        field = fields[0] + np.float32(frame / (frames - 1)) * (fields[1] - fields[0])
        y, x = rows + np.rint(field[0]).astype(int), columns + np.rint(field[1]).astype(int)
        inside = (y >= 0) & (y < SIZE[0]) & (x >= 0) & (x < SIZE[1])
        y, x = np.where(inside, y, 0), np.where(inside, x, 0)
        inside &= ~mask[y, x]
        trials += inside
        totals[0] += inside * efficiency[y, x]
        totals[1] += inside * (np.exp(-dark[y, x]) if threshold == 1 else dark[y, x])
    np.testing.assert_array_equal(sums.trials, trials)
    seen = trials > 0
    means = sums.jots.mean(trials)[:, seen]
    expected = totals[:, seen] / trials[seen]
    if threshold == 1:
        # With this mean, exactly as many bits are expected to be 0 as with the various jots.
        expected[1] = -np.log(expected[1])
    np.testing.assert_allclose(means, expected, rtol=1e-4, atol=1e-5)


def test_slow_motions_are_looked_up_in_a_few_frames():
    frames, (efficiency, dark) = 400, random_maps(np.random.default_rng(2))
    # The maps are smooth, and the motion is less than their scale.
    rows, columns = np.indices(SIZE)
    efficiency = 0.5 + 0.004 * rows + 0.002 * columns
    sensor = jl.Sensor(frames=frames, efficiency=efficiency, dark_counts=dark.mean())
    bits = jl.Bits.from_array(np.zeros((frames, *SIZE), bool))
    blocks = as_blocks(as_burst(bits), np.array([0, frames]), sensor, 1)
    fields = np.zeros((2, 2, *SIZE), np.float32)
    fields[1, 0] = 3.0
    sums = blocks.count(range(frames), fields, (0, frames - 1))
    inner = np.s_[:-4]
    means = sums.jots.mean(sums.trials)[0][inner]
    np.testing.assert_allclose(means, (efficiency + 1.5 * 0.004)[inner], atol=5e-4)


def test_pixels_without_bits_have_the_reference_jot():
    jots, _, _ = jots_of()
    trials = np.zeros(SIZE, np.int32)
    trials[:, 30:] = 2
    means = jots.at_rest(trials).mean(trials)
    np.testing.assert_array_equal(means[0][:, :30], np.float32(jots.reference[0]))
    np.testing.assert_array_equal(means[1][:, :30], np.float32(jots.reference[1]))


def test_a_burst_at_rest_sees_each_jot_itself():
    jots, efficiency, dark = jots_of()
    trials = np.full(SIZE, 7, np.int32)
    means = jots.at_rest(trials).mean(trials)
    np.testing.assert_allclose(means, [efficiency, dark], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_the_response_is_that_of_the_sensor(threshold):
    """P(q, η s + d), with the light s that the reference jot shows, and its derivative."""
    jots, efficiency, dark = jots_of(threshold)
    rng = np.random.default_rng(3)
    light = rng.uniform(0.3, 3, SIZE) * threshold
    own_efficiency, own_dark = jots.reference
    p = detection_probability(threshold, own_efficiency * light + own_dark).astype(np.float32)
    trials = np.full(SIZE, 4, np.int32)
    seen = jots.at_rest(trials)
    probability, slope = seen.response(trials, p)
    exact = detection_probability(threshold, efficiency * light + dark)
    np.testing.assert_allclose(probability, exact, atol=2e-5)
    step = 1e-4
    above, below = (
        detection_probability(threshold, efficiency * (light + change) + dark)
        for change in (step, -step)
    )
    own_above, own_below = (
        detection_probability(threshold, own_efficiency * (light + change) + own_dark)
        for change in (step, -step)
    )
    np.testing.assert_allclose(slope, (above - below) / (own_above - own_below), rtol=2e-3)


@pytest.mark.parametrize("threshold", [1, 2, 7])
def test_the_response_is_inverted(threshold):
    p = np.linspace(1e-4, 1 - 1e-4, 500, dtype=np.float32)
    rates = inverse_response(threshold, p)
    np.testing.assert_allclose(response(threshold, rates)[0], p, atol=2e-6)
    np.testing.assert_allclose(detection_probability(threshold, rates), p, atol=2e-6)


def test_sums_over_jots_are_added_selected_and_masked():
    jots, _, _ = jots_of()
    rng = np.random.default_rng(4)

    def random_sums():
        trials = rng.integers(0, 5, SIZE, np.int32)
        zeros = Sums.zeros(SIZE)
        return Sums(trials // 2, trials, zeros.remainders, 5, jots.at_rest(trials))

    one, other = random_sums(), random_sums()
    expected = one.jots.sums + other.jots.sums
    np.testing.assert_array_equal((one + other).jots.sums, expected)
    np.testing.assert_array_equal(Sums.total([one, other]).jots.sums, expected)
    np.testing.assert_array_equal((Sums.zeros(SIZE) + one).jots.sums, one.jots.sums)
    labels = (rng.random(SIZE) < 0.5).astype(np.uint8)
    chosen = Sums.select([one, other], labels)
    np.testing.assert_array_equal(
        chosen.jots.sums, np.where(labels, other.jots.sums, one.jots.sums)
    )
    np.testing.assert_array_equal(one.masked(labels > 0).jots.sums, one.jots.sums * labels)
    rest = one.without(one.ones, one.ones)
    np.testing.assert_array_equal(rest.trials, one.trials - one.ones)
    np.testing.assert_allclose(
        rest.jots.mean(rest.trials)[:, rest.trials > 0],
        one.jots.mean(one.trials)[:, rest.trials > 0],
        rtol=1e-5,
    )
    assert isinstance(one.jots, SeenJots)
