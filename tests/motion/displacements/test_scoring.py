"""Normal equations and templates: the engine against its twin, and shifts that they recover."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter, shift, uniform_filter

from jotlight import _engine as engine
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.scoring import (
    Template,
    make_blurred_template,
    make_template,
    normal_equations,
    template_network,
)
from jotlight.networks.network import Network
from jotlight.networks.pretrained import FOLDER
from jotlight.training.parameters import fingerprint_network
from reference import motion as reference


def random_sums(rng, size, trials=8, masked=True):
    """Return sums of random counts; some pixels, and a whole row, have no trials."""
    counts = np.full(size, trials, np.int32)
    if masked:
        counts = rng.integers(0, trials + 1, size, np.int32) * (rng.random(size) < 0.7)
        counts[size[0] // 2] = 0
    remainders = rng.normal(0, 2, (size[0], 2, -(-size[1] // 16))).astype(np.float32)
    ones = rng.binomial(counts, 0.3).astype(np.int32)
    return Sums(ones, counts.astype(np.int32), remainders, trials)


def random_template(rng, size, threads=None):
    rough = rng.uniform(0.01, 0.99, size)
    probability = gaussian_filter(rough, rng.choice([0, 1])).astype(np.float32)
    return Template(probability, rng.integers(0, 100, size, np.int32), threads)


@st.composite
def cases(draw):
    """Draw sums, a template of the same size, and the width of a filter."""
    columns = st.integers(1, 150) | st.sampled_from([64, 128])
    size = draw(st.tuples(st.integers(1, 70), columns) | st.just((37, 1800)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    sums = random_sums(rng, size, draw(st.integers(1, 200)), draw(st.booleans()))
    return sums, random_template(rng, size), draw(st.sampled_from([0.1, 0.7, 1.0, 2.0, 8.0]))


@settings(max_examples=20)
@given(cases())
def test_the_equations_are_those_of_the_twin(case):
    sums, template, sigma = case
    found = normal_equations(sums, template, sigma)
    expected = reference.normal_equations(sums, template.probability, template.trials, sigma)
    for one, other in zip((found.information, found.right), expected, strict=True):
        assert one.shape == other.shape
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4 * abs(other).max() + 1e-6)


@pytest.mark.parametrize("level", engine.cpu_levels())
@pytest.mark.parametrize("size", [(1, 1), (16, 64), (33, 100), (70, 130)])
def test_any_number_of_threads_gives_the_same_equations(level, size):
    engine.choose_cpu_level(level)
    try:
        found = []
        for threads in (1, 2, 3):
            rng = np.random.default_rng(5)
            sums, template = random_sums(rng, size), random_template(rng, size, threads)
            found.append(normal_equations(sums, template, 2.0))
    finally:
        engine.choose_cpu_level(None)
    expected = reference.normal_equations(sums, template.probability, template.trials, 2.0)
    np.testing.assert_allclose(found[0].right, expected[1], atol=1e-5 * abs(expected[1]).max())
    for other in found[1:]:
        np.testing.assert_array_equal(other.information, found[0].information)
        np.testing.assert_array_equal(other.right, found[0].right)


def test_strided_arrays_give_the_same_equations():
    rng = np.random.default_rng(6)
    sums, template = random_sums(rng, (40, 50)), random_template(rng, (40, 50))
    strided = Sums(
        np.asfortranarray(sums.ones),
        np.repeat(sums.trials, 2, axis=1)[:, ::2],
        np.asfortranarray(sums.remainders),
        sums.frames,
    )
    fortran = Template(np.asfortranarray(template.probability), np.asfortranarray(template.trials))
    one, other = normal_equations(sums, template, 1.0), normal_equations(strided, fortran, 1.0)
    np.testing.assert_array_equal(one.right, other.right)


def test_pixels_without_trials_add_nothing():
    rng = np.random.default_rng(7)
    template = random_template(rng, (48, 48))
    empty = Sums.zeros((48, 48))
    found = normal_equations(empty, template, 2.0)
    assert (found.information == 0).all()
    assert (found.right == 0).all()
    sums = random_sums(rng, (48, 48), masked=False)
    sums.trials[16:32, 16:32] = 0
    sums.ones[16:32, 16:32] = 0
    found = normal_equations(sums, template, 1.0)
    assert (found.information[:, 1, 1] == 0).all()
    assert (found.right[:, 1, 1] == 0).all()
    assert (found.information[[0, 2]][:, 0] > 0).all()


def texture(size):
    """Return smooth random probabilities, which shifts of parts of a pixel do not alias."""
    image = gaussian_filter(np.random.default_rng(8).normal(size=size), 2.5, mode="wrap")
    return 0.4 + 0.3 * np.tanh(image / image.std())


def expected_sums(probability, trials, displacement):
    """Return the expected counts D p(x + e), times a large D to make them nearly exact."""
    moved = shift(probability, -np.asarray(displacement), order=5, mode="grid-wrap")
    ones = np.rint(trials * moved).astype(np.int32)
    size = probability.shape
    remainders = np.zeros((size[0], 2, -(-size[1] // 16)), np.float32)
    return Sums(ones, np.full(size, trials, np.int32), remainders, trials)


@pytest.mark.parametrize("displacement", [(0.3, 0.0), (0.0, -0.3), (0.3, 0.3), (-0.2, 0.1)])
@pytest.mark.parametrize("sigma", [1.0, 2.0])
def test_a_shift_of_a_part_of_a_pixel_is_recovered(displacement, sigma):
    probability = gaussian_filter(texture((96, 112)), 1, mode="wrap")
    template = Template(probability.astype(np.float32), np.full((96, 112), 10**6, np.int32))
    equations = normal_equations(expected_sums(probability, 10**6, displacement), template, sigma)
    information, right = (
        values[:, 1:-1, 1:-1].sum(axis=(1, 2))
        for values in (equations.information, equations.right)
    )
    matrix = [[information[0], information[1]], [information[1], information[2]]]
    np.testing.assert_allclose(np.linalg.solve(matrix, right), displacement, atol=0.02)


def test_remainders_explain_the_shift_that_rounding_causes():
    probability = gaussian_filter(texture((96, 112)), 1, mode="wrap")
    template = Template(probability.astype(np.float32), np.full((96, 112), 10**6, np.int32))
    sums = expected_sums(probability, 10**4, (0.3, -0.2))
    before = normal_equations(sums, template, 1.0).right
    sums.remainders[:] = np.float32([0.3, -0.2])[:, None] * sums.frames
    after = normal_equations(sums, template, 1.0).right
    assert abs(after[:, 1:-1, 1:-1]).max() < 0.1 * abs(before[:, 1:-1, 1:-1]).max()


def test_the_equations_are_derivatives_of_the_log_likelihood():
    """With Gaussian noise, it is -½ Σ w (G N - D p(x + e))² / D for the displacement e."""
    size, trials, sigma = (80, 96), 50, 1.0
    probability = texture(size)
    moved = shift(probability, (0.1, -0.2), order=5, mode="grid-wrap")
    ones = np.random.default_rng(9).binomial(trials, moved).astype(np.int32)
    counts = np.full(size, trials, np.int32)
    template = Template(probability.astype(np.float32), 8 * counts)
    sums = Sums(ones, counts, np.zeros((80, 2, 6), np.float32), trials)
    found = normal_equations(sums, template, sigma)
    filtered, blurred = (
        gaussian_filter(image, sigma, truncate=3.0) for image in (probability, ones.astype(float))
    )
    # The block may be brighter than the template as a whole.
    blurred /= reference.brightness(ones, counts, filtered)
    variance = filtered * (1 - filtered) * (1 + 0.35 / 8)

    def log_likelihoods(displacement, blurred):
        """Return the log-likelihood of each tile that does not touch the border."""
        moved = shift(filtered, -np.asarray(displacement), order=5)
        squares = (blurred - trials * moved) ** 2 / (trials * variance)
        shares = reference.shares_of_rows(size, sigma)[:, None]
        return reference.sum_tiles(-0.5 * shares * squares)[1:-1, 1:-1]

    step = 1e-2
    for axis in (0, 1):
        ahead = step * np.eye(2)[axis]
        slope = (log_likelihoods(ahead, blurred) - log_likelihoods(-ahead, blurred)) / (2 * step)
        right = found.right[axis, 1:-1, 1:-1]
        np.testing.assert_allclose(right, slope, atol=0.01 * abs(slope).max())
        # A is the curvature at the expected counts.
        curvature = -2 * log_likelihoods(ahead, trials * filtered) / step**2
        information = found.information[2 * axis, 1:-1, 1:-1]
        np.testing.assert_allclose(information, curvature, rtol=0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ones": np.zeros((5, 21), np.int32)}, "numbers of ones: expected \\(5, 20\\)"),
        ({"trials": np.zeros((4, 20), np.int32)}, "numbers of trials: expected \\(5, 20\\)"),
        ({"ones": np.full((5, 20), -1, np.int32)}, "numbers of ones: expected 0 to that of trials"),
        ({"ones": np.full((5, 20), 4, np.int32)}, r"got \(4, 3\) \(ones, trials\)"),
        ({"remainders": np.zeros((5, 2, 3), np.float32)}, "remainders: expected \\(5, 2, 2\\)"),
        ({"remainders": np.full((5, 2, 2), np.nan, np.float32)}, "remainders: expected finite"),
        ({"probability": np.zeros((5, 20), np.float32)}, "numbers above 0 and below 1, got 0"),
        ({"probability": np.full((5, 20), np.nan, np.float32)}, "below 1, got NaN"),
        ({"probability": np.full((6, 20), 0.5, np.float32)}, "trials of the template"),
        ({"probability": np.zeros((5, 0), np.float32)}, "size: expected at least one pixel"),
        ({"of_template": np.full((5, 20), -1, np.int32)}, "trials of the template: expected at le"),
        ({"sigma": 0.0}, "width of the filter: expected above 0 and at most 100, got 0"),
        ({"sigma": np.nan}, "width of the filter"),
        ({"sigma": 101.0}, "width of the filter"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(changes, message):
    parts = {
        "ones": np.zeros((5, 20), np.int32),
        "trials": np.full((5, 20), 3, np.int32),
        "remainders": np.zeros((5, 2, 2), np.float32),
        "probability": np.full((5, 20), 0.5, np.float32),
        "of_template": np.ones((5, 20), np.int32),
        "sigma": 1.0,
        **changes,
    }
    sums = Sums(parts["ones"], parts["trials"], parts["remainders"], 3)
    template = Template(parts["probability"], parts["of_template"])
    with pytest.raises(ValueError, match=message):
        normal_equations(sums, template, parts["sigma"])


def test_the_filtered_template_is_computed_once():
    template = random_template(np.random.default_rng(10), (20, 20))
    assert template.filtered(1.0) is template.filtered(1.0)
    assert template.filtered(1.0) is not template.filtered(2.0)


@pytest.mark.parametrize("sigma", [1.0, 2.0, 4.0])
def test_the_rows_that_are_compared_stand_for_all(sigma):
    rng = np.random.default_rng(11)
    probability = texture((256, 272)).astype(np.float32)
    template = Template(probability, np.full((256, 272), 10**6, np.int32))
    moved = shift(probability.astype(float), (0.2, -0.3), order=5, mode="grid-wrap")
    trials = np.full((256, 272), 50, np.int32)
    remainders = np.zeros((256, 2, 17), np.float32)
    sums = Sums(rng.binomial(trials, moved).astype(np.int32), trials, remainders, 50)
    few = normal_equations(sums, template, sigma)
    every = reference.normal_equations(sums, probability, template.trials, sigma, every=True)
    for found, expected in zip((few.information, few.right), every, strict=True):
        total, of_all = found.sum(axis=(1, 2)), expected.sum(axis=(1, 2))
        np.testing.assert_allclose(total, of_all, atol=0.05 * abs(of_all).max())


def test_templates_are_smooth_and_undo_the_mean_remainder():
    probability = texture((64, 80))
    sums = expected_sums(probability, 200, (0, 0.4))
    plain = make_template(sums, None)
    sums.remainders[:, 1] = 0.4 * sums.frames
    corrected = make_template(sums, None)
    inner = (slice(8, -8), slice(8, -8))
    errors = [((each.probability - probability)[inner] ** 2).mean() for each in (plain, corrected)]
    assert errors[1] < 0.2 * errors[0]
    assert uniform_filter(abs(corrected.probability - probability), 5).max() < 0.1
    assert corrected.trials is sums.trials


def test_blurred_templates_have_no_noise_and_undo_the_mean_remainder():
    truth = 0.3 + 0.1 * np.sin(np.arange(96) / 8) * np.ones((64, 1))
    rng = np.random.default_rng(0)
    trials = np.full(truth.shape, 60, np.int32)
    trials[20:30, 20:30] = 0
    moved = 0.3 + 0.1 * np.sin((np.arange(96) + 0.3) / 8) * np.ones((64, 1))
    remainders = np.zeros((64, 2, 6), np.float32)
    remainders[:, 1] = 0.3 * 60
    sums = Sums(rng.binomial(trials, moved).astype(np.int32), trials, remainders, 60)
    found = make_blurred_template(sums, None).probability
    error = (found - truth)[:, 8:-8]
    assert np.sqrt((error**2).mean()) < 0.018
    assert abs(error.mean()) < 0.002


def test_most_templates_come_from_a_network_of_their_own():
    sums = random_sums(np.random.default_rng(0), (40, 50), masked=False)
    own, small = (Network.load(FOLDER / f"{name}.safetensors") for name in ("templates", "small"))
    assert fingerprint_network(template_network()) == fingerprint_network(own)
    template = make_template(sums, None).probability
    np.testing.assert_array_equal(template, make_template(sums, None, "templates").probability)
    assert abs(template - make_template(sums, None, "small").probability).max() > 1e-3
    assert [layer.channels for layer in own.layers] == [layer.channels for layer in small.layers]
