"""Equivalent counts: against the exact log-likelihood of jots that differ."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

import jotlight as jl
from jotlight.motion.counts.equivalent import (
    equivalent_sums,
    estimate_probability,
    expected_probability,
    flatten_counts,
)
from jotlight.motion.counts.jots import Jots
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import chi_squared, disagreement
from jotlight.motion.displacements.scoring import Template, make_blurred_template, normal_equations
from jotlight.sensing.parameters.response import detection_probability

SIZE = 80, 96
MANY = 10**6


def smooth_texture(seed, size=SIZE):
    """Return light that shifts of parts of a pixel do not alias."""
    image = gaussian_filter(np.random.default_rng(seed).normal(size=size), 3, mode="wrap")
    return 0.5 + 0.3 * np.tanh(image / image.std())


def random_jots(threshold=1, seed=1, size=SIZE):
    """Return jots with vignetting to a half, a fixed pattern, and dark counts like the light."""
    rng = np.random.default_rng(seed)
    rows, columns = (np.linspace(-1, 1, length) for length in size)
    vignetting = 1 - 0.25 * (rows[:, None] ** 2 + columns**2)
    efficiency = vignetting * rng.uniform(0.8, 1, size)
    sensor = jl.Sensor(
        threshold=threshold, efficiency=efficiency, dark_counts=0.5 * rng.gamma(2, 0.5, size)
    )
    return Jots.of_sensor(sensor, size, None)


def exact_probability(jots, light):
    """Return P(q, η s + d) of jots at rest, in double precision."""
    trials = np.ones(light.shape, np.int32)
    efficiency, dark = jots.at_rest(trials).mean(trials).astype(float)
    return detection_probability(jots.threshold, efficiency * light + dark)


def reference_probability(jots, light):
    efficiency, dark = jots.reference
    return detection_probability(jots.threshold, efficiency * light + dark)


def sums_of(jots, ones, trials):
    zeros = Sums.zeros(trials.shape)
    return Sums(
        ones.astype(np.int32), trials.astype(np.int32), zeros.remainders, 1, jots.at_rest(trials)
    )


def test_counts_of_equal_jots_are_not_converted():
    sums = Sums.zeros(SIZE)
    assert equivalent_sums(sums) is sums
    p = np.full(SIZE, 0.3, np.float32)
    assert expected_probability(sums, p) is p
    with pytest.raises(ValueError, match="expected those of jots that differ"):
        estimate_probability(sums)


@pytest.mark.parametrize("threshold", [1, 3])
def test_equivalent_counts_have_the_derivative_and_the_information_of_the_likelihood(threshold):
    jots, light = random_jots(threshold), smooth_texture(0) * threshold
    p = reference_probability(jots, light)
    rng = np.random.default_rng(2)
    trials = rng.integers(1, 40, SIZE)
    ones = rng.binomial(trials, exact_probability(jots, light))
    found = equivalent_sums(sums_of(jots, ones, trials), p.astype(np.float32))
    step = 1e-5

    def log_likelihood(change):
        own = exact_probability(jots, light + change)
        return ones * np.log(own) + (trials - ones) * np.log(1 - own)

    # Derivatives with respect to p follow from those with respect to the light.
    slope = (
        reference_probability(jots, light + step) - reference_probability(jots, light - step)
    ) / (2 * step)
    derivative = (log_likelihood(step) - log_likelihood(-step)) / (2 * step) / slope
    score = (found.ones - found.trials * p) / (p * (1 - p))
    np.testing.assert_allclose(score, derivative, rtol=1e-2, atol=2e-3 * abs(derivative).max())
    own = exact_probability(jots, light)
    steps = exact_probability(jots, light + step) - exact_probability(jots, light - step)
    information = trials * (steps / (2 * step) / slope) ** 2 / (own * (1 - own))
    np.testing.assert_allclose(found.trials / (p * (1 - p)), information, rtol=1e-2)


def test_the_normal_equations_are_derivatives_of_the_likelihood_of_a_displacement():
    """L(e) = Σ N log P(q, η s(x + e) + d) + (D - N) log[1 - P]: gradient and information."""
    jots, light, trials = random_jots(), smooth_texture(3), np.full(SIZE, 5000)
    moved = shift(light, (0.1, -0.15), order=5, mode="grid-wrap")
    ones = np.random.default_rng(4).binomial(trials, exact_probability(jots, moved))
    p = reference_probability(jots, light).astype(np.float32)
    template = Template(p, np.full(SIZE, 2**31 - 1, np.int32))
    found = normal_equations(sums_of(jots, ones, trials), template, 0.1)
    inner = np.zeros(SIZE, bool)
    inner[16:-16, 16:-16] = True

    def probability(displacement):
        # The scene moves, and the jots stay where they are.
        place = shift(light, -np.asarray(displacement), order=5, mode="grid-wrap")
        return exact_probability(jots, place)

    # The equations are about a scene as bright as the template.
    equivalent = equivalent_sums(sums_of(jots, ones, trials), p)
    brightness = equivalent.ones.sum() / (equivalent.trials * p).sum()
    ones = ones + (1 / brightness - 1) * trials * probability((0, 0))

    def log_likelihood(displacement):
        own = probability(displacement)
        return (ones * np.log(own) + (trials - ones) * np.log(1 - own))[inner].sum()

    step = 1e-3
    sides = [[sign * step * unit for sign in (1, -1)] for unit in np.eye(2)]
    gradient = [
        (log_likelihood(above) - log_likelihood(below)) / (2 * step) for above, below in sides
    ]
    tiles = np.s_[:, 1:-1, 1:-1]
    right = found.right[tiles].sum(axis=(1, 2))
    np.testing.assert_allclose(right, gradient, rtol=0.02)
    own = probability((0, 0))
    slopes = [(probability(above) - probability(below)) / (2 * step) for above, below in sides]
    weight = np.where(inner, trials / (own * (1 - own)), 0)
    information = [(weight * slopes[i] * slopes[j]).sum() for i, j in ((0, 0), (0, 1), (1, 1))]
    np.testing.assert_allclose(
        found.information[tiles].sum(axis=(1, 2)), information, rtol=0.02, atol=20
    )
    solution = np.linalg.solve(np.array(information)[[[0, 1], [1, 2]]], right)
    np.testing.assert_allclose(solution, (-0.1, 0.15), atol=0.02)


@pytest.mark.parametrize("threshold", [1, 2])
def test_a_pattern_of_the_jots_is_not_in_the_template(threshold):
    jots, light = random_jots(threshold), smooth_texture(5) * threshold
    trials = np.full(SIZE, MANY)
    sums = sums_of(jots, np.rint(trials * exact_probability(jots, light)), trials)
    p = reference_probability(jots, light)
    exact = equivalent_sums(sums, p.astype(np.float32))
    np.testing.assert_allclose(exact.ones, exact.trials * p, rtol=1e-3)
    # Without the light, an estimate from squares of pixels suffices.
    assert abs(estimate_probability(sums) - p).mean() < 0.06
    estimated = equivalent_sums(sums)
    difference = abs(estimated.ones / estimated.trials - p)
    assert difference.mean() < 0.004
    assert difference.max() < 0.03
    raw = sums.ones / sums.trials
    assert abs(raw - p).max() > 0.1
    blurred = make_blurred_template(sums, 1).probability
    inner = np.s_[8:-8, 8:-8]
    limit = 0.2 * abs(gaussian_filter(raw, 1.5) - gaussian_filter(p, 1.5))[inner].max()
    assert abs(blurred - gaussian_filter(p, 1.5))[inner].max() < limit


def test_the_tests_of_bits_expect_the_pattern():
    jots, light = random_jots(), smooth_texture(6)
    rng = np.random.default_rng(7)
    p = reference_probability(jots, light).astype(np.float32)
    template = Template(p, np.full(SIZE, MANY, np.int32))
    parts = []
    for number in (4, 40, 400):
        trials = np.full(SIZE, number)
        parts.append(sums_of(jots, rng.binomial(trials, exact_probability(jots, light)), trials))
        assert chi_squared(parts[-1], template).mean() == pytest.approx(1, abs=0.1)
    # Other jots have seen the same scene.
    other = random_jots(seed=8)
    trials = np.full(SIZE, 40)
    second = sums_of(other, rng.binomial(trials, exact_probability(other, light)), trials)
    assert disagreement(parts[1], second).mean() == pytest.approx(1, abs=0.15)
    unaware = [Sums(each.ones, each.trials, each.remainders, 1) for each in (parts[1], second)]
    assert disagreement(*unaware).mean() > 2


@pytest.mark.parametrize("side", [1, 2])
def test_counts_at_rest_are_flattened(side):
    rng = np.random.default_rng(9)
    efficiency, dark = rng.uniform(0.4, 1, SIZE), rng.uniform(0, 0.3, SIZE)
    valid = rng.random(SIZE) > 0.05
    valid[20:24, 30:34] = False
    sensor = jl.Sensor(efficiency=efficiency, dark_counts=dark)
    jots = Jots.of_sensor(sensor, SIZE, np.packbits(valid, axis=1))
    trials = 10**5
    expected = trials * detection_probability(1, 0.3 * efficiency + dark) * valid
    height, width = (length // side for length in SIZE)
    counts = np.rint(expected.reshape(height, side, width, side).sum(axis=(1, 3)))
    flat = flatten_counts(np.stack([counts, counts]).astype(np.int32), trials, side, jots)
    assert flat.std() < 0.02 * flat.mean()
    assert counts.std() > 0.1 * counts.mean()
