"""The prior of deviations, against dense matrices and integrals."""

import dataclasses

import numpy as np
import pytest

from jotlight.motion.displacements.deformation_prior import (
    _BENDING,
    _DEVIATION,
    _OFFSET,
    DeformationPrior,
    Measurement,
    degrees_of_freedom,
    gain_of_deviations,
    solve_deviations,
    with_likely_sizes,
)
from jotlight.motion.displacements.track import Track
from moving import blocks_of, record


def prior_of(frames=16, shape=(48, 64)):
    _, bits = record("static", frames, shape=shape)
    return DeformationPrior.of_track(Track.still(blocks_of(bits)))


def matrix_of(prior):
    """Return the matrix of the deviations of all coefficients."""
    units = np.eye(np.prod(prior.shape)).reshape(-1, *prior.shape)
    return np.stack([prior.deviations(unit).ravel() for unit in units], axis=1)


def measured(deviations, rng, scale=1.0):
    """Return a measurement of deviations with its noise, and the dense information."""
    number, _, rows, columns = deviations.shape
    roots = scale**0.5 * rng.normal(size=(number, rows, columns, 2, 2))
    matrices = roots @ roots.swapaxes(-1, -2)
    parts = [matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]]
    noise = np.einsum("nrcij,nrcj->nirc", roots, rng.normal(size=(number, rows, columns, 2)))
    right = np.einsum("nrcij,njrc->nirc", matrices, deviations) + noise
    dense = np.zeros((*deviations.shape, *deviations.shape))
    for block, row, column in np.ndindex(number, rows, columns):
        dense[block, :, row, column, block, :, row, column] = matrices[block, row, column]
    size = deviations.size
    return Measurement(np.stack(parts, axis=1), right), dense.reshape(size, size)


def log_evidence(prior, measurement, dense):
    """Return the log-likelihood of a prior: b is Gaussian with covariance A + A C A."""
    matrix = matrix_of(prior)
    covariance = dense + dense @ matrix @ matrix.T @ dense
    right = measurement.right.ravel()
    _, log_determinant = np.linalg.slogdet(covariance)
    return -(right @ np.linalg.solve(covariance, right) + log_determinant) / 2


def test_the_covariance_in_time_is_that_of_a_velocity_with_a_random_walk():
    prior = prior_of()
    times = (np.arange(16) - 8) / 16  # 16 blocks of a frame
    covariance = prior.in_time @ prior.in_time.T
    grid = (np.arange(4000) + 0.5) / 4000
    for first, second in [(0, 0), (1, 5), (3, 12), (9, 15), (15, 15), (8, 11)]:
        one, two = times[first], times[second]
        walk = np.maximum(abs(one) - grid, 0) * np.maximum(abs(two) - grid, 0)
        bending = walk.mean() if one * two > 0 else 0.0
        expected = one * two + _BENDING * bending + _OFFSET
        # Small modes are left out.
        assert covariance[first, second] == pytest.approx(expected, abs=1e-3)


def test_the_mean_variance_of_a_tile_is_that_of_time():
    prior = prior_of()
    variances = (matrix_of(prior) ** 2).sum(axis=1).reshape(16, 2, 3, 4).mean(axis=(1, 2, 3))
    expected = _DEVIATION**2 * (prior.in_time**2).sum(axis=1)
    np.testing.assert_allclose(variances, expected)


def test_coefficients_are_pulled_back_by_the_adjoint():
    rng, prior = np.random.default_rng(0), prior_of()
    coefficients = rng.normal(size=prior.shape)
    deviations = rng.normal(size=(16, 2, 3, 4))
    products = (
        (prior.deviations(coefficients) * deviations).sum(),
        (coefficients * prior.pull_back(deviations)).sum(),
    )
    assert products[0] == pytest.approx(products[1])


def test_nothing_is_displaced_at_the_reference_time():
    rng, prior = np.random.default_rng(0), prior_of()
    coefficients = rng.normal(size=prior.shape)
    displacements = prior.displacements(coefficients)
    changes = displacements - prior.deviations(coefficients)
    np.testing.assert_allclose(displacements[8], 0, atol=0.01)  # the block of frame 8
    np.testing.assert_allclose(changes, np.broadcast_to(changes[0], changes.shape), atol=1e-9)


def test_coefficients_solve_the_dense_equations():
    rng, prior = np.random.default_rng(0), prior_of(shape=(32, 48))
    measurement, dense = measured(rng.normal(size=(16, 2, 2, 3)), rng)
    matrix = matrix_of(prior)
    normal = matrix.T @ dense @ matrix + np.eye(matrix.shape[1])
    expected = np.linalg.solve(normal, matrix.T @ measurement.right.ravel())
    found = solve_deviations(prior, measurement, rng.normal(size=prior.shape))
    np.testing.assert_allclose(matrix @ found.ravel(), matrix @ expected, atol=0.02)


def test_degrees_of_freedom_are_about_a_trace():
    rng, prior = np.random.default_rng(0), prior_of(shape=(64, 80))
    measurement, dense = measured(np.zeros((16, 2, 4, 5)), rng, scale=0.01)
    matrix = matrix_of(prior)
    information = matrix.T @ dense @ matrix
    hat = information @ np.linalg.inv(information + np.eye(len(information)))
    assert degrees_of_freedom(prior, measurement) == pytest.approx(np.trace(hat), rel=0.15)


@pytest.mark.parametrize("size", [0.0, 0.05, 3.0])
def test_the_bits_decide_how_much_a_scene_deforms(size):
    rng, prior = np.random.default_rng(1), prior_of(shape=(64, 64))
    true = dataclasses.replace(prior, sizes=size * prior.sizes)
    deviations = true.deviations(rng.normal(size=prior.shape))
    measurement, dense = measured(deviations, rng)
    before = solve_deviations(prior, measurement, np.zeros(prior.shape))
    likely, coefficients = with_likely_sizes(prior, measurement, before)
    evidence = [log_evidence(each, measurement, dense) for each in (prior, likely)]
    assert evidence[1] > evidence[0] + 1
    errors = [
        np.mean((each.deviations(found) - deviations) ** 2)
        for each, found in ((prior, before), (likely, coefficients))
    ]
    assert errors[1] < (1.02 if size > 1 else 0.5) * errors[0]


def test_independent_fields_have_the_stated_deviation():
    prior = DeformationPrior.of_fields(2, (5, 6), 3.0)
    matrix = matrix_of(prior)
    covariance = matrix @ matrix.T
    assert np.diag(covariance).mean() == pytest.approx(9)
    fields = covariance.reshape(2, 2, 30, 2, 2, 30)
    for first, second in np.ndindex(4, 4):
        block = fields[first // 2, first % 2, :, second // 2, second % 2]
        assert (abs(block).max() > 1) == (first == second)


def test_deviations_gain_what_dense_matrices_state_and_noise_gains_the_degrees_of_freedom():
    rng, prior = np.random.default_rng(0), DeformationPrior.of_fields(2, (6, 8), 2.0)
    matrix, gains = matrix_of(prior), []
    for number in range(20):
        measurement, dense = measured(np.zeros((2, 2, 6, 8)), rng, 0.3)
        right = matrix.T @ measurement.right.ravel()
        posterior = matrix.T @ dense @ matrix + np.eye(len(right))
        gain = gain_of_deviations(prior, measurement)
        if number == 0:
            assert gain == pytest.approx(right @ np.linalg.solve(posterior, right), rel=1e-3)
        gains.append(gain / (len(right) - np.trace(np.linalg.inv(posterior))))
    assert np.mean(gains) == pytest.approx(1, abs=0.1)
