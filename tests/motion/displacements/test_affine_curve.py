"""Smooth curves of affine motions: the most probable ones under the weights that fit best."""

import numpy as np
import pytest
from scipy.optimize import minimize

from jotlight import _engine as engine
from jotlight.motion.displacements.affine_curve import (
    _MODES,
    covariances_of,
    information_of,
    ratios_of_differences,
    smooth_affine,
)
from jotlight.motion.tiles import affine_basis

NUMBER = 12

TERMS = (slice(0, 2), 3), (slice(2, 4), 1), (slice(2, 4), 3), (slice(4, 6), 1)
"""Modes and orders of their differences: translations, zoom and rotation, and shears."""


def matrices(rng, number=NUMBER):
    roots = rng.normal(size=(number, 6, 6))
    return roots @ roots.swapaxes(1, 2) + 0.1 * np.eye(6)


def dense_matrices(information, weights):
    """Return the information and the squared differences of all values as full matrices."""
    number = len(information)
    full = np.zeros((number, 6, number, 6))
    full[range(number), :, range(number)] = information
    prior = np.zeros_like(full)
    for weight, (modes, order) in zip(weights, TERMS, strict=True):
        differences = np.diff(np.eye(number), order, axis=0)
        for mode in range(6)[modes]:
            prior[:, mode, :, mode] += np.exp(weight) * differences.T @ differences
    size = 6 * number
    return full.reshape(size, size), prior.reshape(size, size)


@pytest.mark.parametrize("seed", range(3))
def test_curves_and_their_costs_are_those_of_full_matrices(seed):
    rng = np.random.default_rng(seed)
    information, estimates = matrices(rng), rng.normal(size=(NUMBER, 6))
    ratios = ratios_of_differences(NUMBER)
    costs, expected = [], []
    for weights in rng.uniform(-4, 4, (3, len(TERMS))):
        cost, curve = engine.cost_of_curve(estimates, information, ratios, weights.tolist())
        full, prior = dense_matrices(information, weights)
        slow = np.linalg.solve(full + prior, full @ estimates.ravel())
        np.testing.assert_allclose(curve.ravel(), slow, atol=1e-4)
        costs.append(cost)
        # The estimates have the covariance of the noise plus that of the curve. The latter is
        # infinite for curves without differences, so it is cut off.
        values, vectors = np.linalg.eigh(prior)
        values = np.where(values > 1e-9 * values.max(), values, 1e-7)
        covariance = np.linalg.inv(full) + vectors / values @ vectors.T
        squared = estimates.ravel() @ np.linalg.solve(covariance, estimates.ravel())
        expected.append(squared + np.linalg.slogdet(covariance)[1])
    np.testing.assert_allclose(np.diff(costs), np.diff(expected), rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("number", [5, 9])
def test_weights_are_those_that_make_the_estimates_most_probable(number):
    """A search in smaller steps finds hardly better weights."""
    rng = np.random.default_rng(number)
    information = 4 * matrices(rng, number)
    estimates = np.cumsum(rng.normal(size=(number, 6)), axis=0)
    ratios = ratios_of_differences(number)

    def cost(weights):
        return engine.cost_of_curve(estimates, information, ratios, list(weights))

    curve = engine.smooth_curve(estimates, information, ratios, None)
    found = minimize(lambda w: cost(np.clip(w, -16, 16))[0], np.zeros(4), method="Nelder-Mead")
    near = np.clip(np.rint(2 * found.x) / 2, -16, 16)
    candidates = [near + 0.5 * np.array(step) for step in np.ndindex(3, 3, 3, 3)]
    curves = [cost(np.clip(each - 0.5, -16, 16)) for each in candidates]
    chosen = min(curves, key=lambda pair: abs(pair[1] - curve).max())
    np.testing.assert_allclose(curve, chosen[1], atol=1e-4)
    assert chosen[0] <= found.fun + 0.5


@pytest.mark.parametrize(
    ("estimates", "information", "ratios", "message"),
    [
        (np.zeros((3, 6)), np.zeros((3, 6, 6)), np.zeros(2), "blocks: expected more than three"),
        (np.zeros((5, 5)), np.zeros((5, 6, 6)), np.zeros(4), "estimates: expected"),
        (np.zeros((5, 6)), np.zeros((5, 6, 5)), np.zeros(4), "information: expected"),
        (np.zeros((5, 6)), np.zeros((5, 6, 6)), np.zeros(5), "ratios: expected"),
        (np.full((5, 6), np.nan), np.zeros((5, 6, 6)), np.zeros(4), "finite numbers"),
        (np.zeros((5, 6)), np.full((5, 6, 6), -1.0), np.zeros(4), "positive matrices"),
    ],
)
def test_bad_input_is_refused(estimates, information, ratios, message):
    with pytest.raises(ValueError, match=message):
        engine.smooth_curve(estimates, information, ratios, None)


def test_the_curve_is_the_same_for_any_number_of_threads():
    rng = np.random.default_rng(0)
    estimates, information = rng.normal(size=(9, 6)), 4 * matrices(rng, 9)
    ratios = ratios_of_differences(9)
    one, *others = (
        engine.smooth_curve(estimates, information, ratios, threads) for threads in (1, 2, 3)
    )
    for other in others:
        np.testing.assert_array_equal(other, one)
    with pytest.raises(ValueError, match="threads: expected at least 1"):
        engine.smooth_curve(estimates, information, ratios, 0)


def test_modes_are_translations_zoom_rotation_and_shears():
    np.testing.assert_allclose(_MODES @ _MODES.T, np.eye(6), atol=1e-12)
    rows, columns = np.indices((5, 5)) - 2.0
    fields = np.einsum("mdk,khw->mdhw", _MODES.reshape(6, 2, 3), [np.ones((5, 5)), rows, columns])
    angle = 1e-6
    turned = np.stack([rows * np.cos(angle) - columns * np.sin(angle) - rows])[0] / angle
    np.testing.assert_allclose(fields[2], np.stack([rows, columns]) / 2**0.5)
    np.testing.assert_allclose(fields[3, 0], turned / 2**0.5, atol=1e-5)
    np.testing.assert_allclose(fields[3, 1], rows / 2**0.5)


@pytest.mark.parametrize("noise", [0.02, 0.5])
def test_curves_have_less_noise_than_their_estimates(noise):
    rng = np.random.default_rng(0)
    time = np.linspace(-1, 1, 24)
    modes = np.zeros((24, 6))
    modes[:, 0] = 10 * np.sin(2 * time)
    modes[:, 1] = 4 * time**2
    modes[:, 3] = 6 * time  # a rotation
    truth = modes @ _MODES
    information = np.broadcast_to(np.eye(6) / noise**2, (24, 6, 6))
    errors = []
    for _ in range(20):
        estimates = truth + noise * rng.normal(size=truth.shape)
        errors.append(smooth_affine(estimates, information) - truth)
    variance = np.square(errors @ _MODES.T).mean(axis=(0, 1)) / noise**2
    assert variance.max() < 0.5
    assert variance[4:].max() < 0.1  # shears that do not change


def test_the_unit_of_the_displacements_does_not_matter():
    rng = np.random.default_rng(1)
    information, estimates = matrices(rng), rng.normal(size=(NUMBER, 6))
    first = smooth_affine(estimates, information)
    np.testing.assert_allclose(
        smooth_affine(1000 * estimates, 1e-6 * information), 1000 * first, rtol=1e-6, atol=1e-6
    )


def test_values_without_information_follow_from_the_others():
    estimates = np.zeros((20, 6))
    estimates[:, 0] = np.arange(20.0) ** 2
    truth = estimates.copy()
    information = np.broadcast_to(100 * np.eye(6), (20, 6, 6)).copy()
    estimates[7], information[7] = 1000, 0
    np.testing.assert_allclose(smooth_affine(estimates, information), truth, atol=0.1)


@pytest.mark.parametrize("number", [1, 2, 4, 5, 40])
def test_bursts_without_information_keep_finite_values(number):
    estimates = np.random.default_rng(2).normal(size=(number, 6))
    curve = smooth_affine(estimates, np.zeros((number, 6, 6)))
    assert curve.shape == (number, 6)
    assert np.isfinite(curve).all()


def test_the_information_of_tiles_is_that_of_random_draws():
    rng = np.random.default_rng(2)
    basis = affine_basis((3, 4))
    root = rng.normal(size=(6, 6))
    covariance = root @ root.T
    draws = rng.multivariate_normal(np.zeros(6), covariance, 100_000).reshape(-1, 2, 3)
    displacements = np.zeros((5, 2, 12))
    found = information_of(np.stack([covariance] * 5), basis, displacements)
    for tile in (0, 7, 11):
        samples = draws @ basis[tile]
        expected = np.cov(samples.T) + 0.05**2 * np.eye(2)
        rows, mixed, columns = found[2, :, tile]
        inverse = np.linalg.inv([[rows, mixed], [mixed, columns]])
        np.testing.assert_allclose(inverse, expected, rtol=0.05, atol=0.03 * expected.max())


def test_curved_paths_are_known_less_well():
    basis = affine_basis((2, 2))
    covariances = np.stack([1e-4 * np.eye(6)] * 7)
    parabola = np.zeros((7, 2, 4)) + 0.5 * np.arange(7.0)[:, None, None] ** 2
    straight, curved = (
        information_of(covariances, basis, displacements)
        for displacements in (0 * parabola, parabola)
    )
    difference = 1 / curved[:, 0] - 1 / straight[:, 0]
    # The second difference is 1, and a quarter of it is the error of linear interpolation.
    np.testing.assert_allclose(difference, 0.25**2, rtol=0.05)


@pytest.mark.slow
def test_smooth_parameters_have_the_variance_of_single_blocks_at_most():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 6)) + 3 * np.eye(6)
    matrices = np.stack([share * root @ root.T for share in np.linspace(0.5, 2, 20)])
    truth = np.linspace(-3, 3, 20)[:, None] ** 2 * rng.normal(size=6)
    errors, deviations = [], []
    for _ in range(50):
        noise = [rng.multivariate_normal(np.zeros(6), np.linalg.inv(each)) for each in matrices]
        smooth, covariances = smooth_affine(truth + noise, matrices), covariances_of(matrices)
        errors.append(smooth - truth)
        deviations.append(np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)))
    scaled = np.square(np.array(errors) / deviations).mean()
    assert 0.02 < scaled < 1
