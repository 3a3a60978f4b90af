"""Shrinkage: linear coefficients vanish if they are noise, and stay if they are clear."""

import numpy as np
import pytest

from jotlight.motion.displacements.shrinkage import (
    LINEAR,
    TRANSLATION,
    information_of_linear,
    shrink_field,
    shrinkage_factor,
    translation_of,
)
from jotlight.motion.tiles import affine_basis

SHAPE = 5, 7
BASIS = affine_basis(SHAPE)


def field_of(coefficients):
    return (np.reshape(coefficients, (2, 3)) @ BASIS.T).reshape(2, *SHAPE)


def coefficients_of(field):
    return (field.reshape(2, -1) @ np.linalg.pinv(BASIS).T).ravel()


@pytest.fixture
def information():
    root = np.random.default_rng(0).normal(size=(6, 6)) + 3 * np.eye(6)
    return root @ root.T


def test_the_marginal_information_is_that_of_the_inverse(information):
    marginal, effect = information_of_linear(information)
    covariance = np.linalg.inv(information)
    np.testing.assert_allclose(np.linalg.inv(marginal), covariance[np.ix_(LINEAR, LINEAR)])
    # The best translation for other linear coefficients minimizes the quadratic form.
    change = np.array([0.3, -0.2, 0.1, 0.4])
    whole = np.zeros(6)
    whole[LINEAR] = change
    whole[TRANSLATION] = -effect @ change
    np.testing.assert_allclose((information @ whole)[TRANSLATION], 0, atol=1e-9)


def test_clear_coefficients_stay_and_a_clear_translation_too(information):
    coefficients = np.array([1.0, 2, -1, 0.5, 1, -2])
    found = coefficients_of(shrink_field(field_of(coefficients), 1e6 * information))
    np.testing.assert_allclose(found, coefficients, rtol=1e-4)


def test_linear_coefficients_that_are_noise_vanish(information):
    coefficients = np.array([5.0, 0.01, -0.01, 3.0, 0.02, 0.0])
    found = coefficients_of(shrink_field(field_of(coefficients), information))
    np.testing.assert_allclose(found[LINEAR], 0, atol=1e-9)
    _, effect = information_of_linear(information)
    expected = coefficients[TRANSLATION] + effect @ coefficients[LINEAR]
    np.testing.assert_allclose(found[TRANSLATION], expected)


def test_the_best_translation_minimizes_the_quadratic_form(information):
    coefficients = np.array([1.0, 2, -1, 0.5, 1, -2])
    found = coefficients_of(translation_of(field_of(coefficients), information))
    np.testing.assert_allclose(found[LINEAR], 0, atol=1e-9)
    gradient = information @ (found - coefficients)
    np.testing.assert_allclose(gradient[TRANSLATION], 0, atol=1e-9)


def test_shrinking_is_better_than_the_estimate_for_any_truth(information):
    """James and Stein (1961): the total error is smaller, whatever the truth is."""
    rng = np.random.default_rng(1)
    marginal, _ = information_of_linear(information)
    for size in (0.0, 1.0, 5.0):
        truth = np.linalg.solve(np.linalg.cholesky(marginal).T, size * np.array([1, -1, 0.5, 0.2]))
        noise = rng.multivariate_normal(np.zeros(4), np.linalg.inv(marginal), 4000)
        estimates = truth + noise
        chi_squared = np.einsum("ni,ij,nj->n", estimates, marginal, estimates)
        shrunk = estimates * [[shrinkage_factor(value, 4)] for value in chi_squared]
        losses = [
            np.einsum("ni,ij,nj->n", each - truth, marginal, each - truth).mean()
            for each in (shrunk, estimates)
        ]
        assert losses[0] < losses[1] * (0.6 if size == 0 else 1.02)


def test_no_information_means_no_linear_coefficients():
    found = shrink_field(field_of([1.0, 2, 3, 4, 5, 6]), np.zeros((6, 6)))
    np.testing.assert_allclose(coefficients_of(found)[LINEAR], 0, atol=1e-9)
