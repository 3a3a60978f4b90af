"""Fields of displacements from normal equations: exact fields, outliers, and a dense solution."""

import numpy as np
import pytest

from jotlight.motion.regularize import (
    Equations,
    Smoothness,
    fit_affine,
    nearest_affine,
    solve_field,
)
from jotlight.motion.tiles import affine_basis

SHAPE = 8, 10
RNG = np.random.default_rng(0)


def random_information(scale=20.0):
    roots = RNG.normal(size=(2, 3, *SHAPE))
    return scale * np.stack(
        [
            (roots[0] ** 2).sum(axis=0),
            (roots[0] * roots[1]).sum(axis=0),
            (roots[1] ** 2).sum(axis=0),
        ]
    )


def equations_of(errors, information):
    """Return the normal equations whose solution is a field of errors."""
    equations = Equations(information, np.zeros((2, *SHAPE)))
    return Equations(information, equations.times(errors))


def affine_field(parameters):
    return (np.reshape(parameters, (2, 3)) @ affine_basis(SHAPE).T).reshape(2, *SHAPE)


def test_affine_errors_are_found():
    errors = affine_field([1, -0.5, 0.3, 0.2, 0.7, -1])
    found = fit_affine(equations_of(errors, random_information()))
    np.testing.assert_allclose(found, errors, atol=5e-3)


def test_a_moving_object_does_not_change_the_affine_motion():
    errors = affine_field([1, 0, 0, -1, 0, 0])
    with_object = errors.copy()
    with_object[:, 2:5, 3:6] += 8
    found = fit_affine(equations_of(with_object, random_information()))
    np.testing.assert_allclose(found, errors, atol=0.05)
    np.testing.assert_allclose(nearest_affine(with_object), errors, atol=0.1)


def test_tiles_without_texture_follow_their_neighbors():
    information = random_information()
    information[:, 3:6, 4:7] = 0
    errors = affine_field([0.5, 0.4, -0.2, 0, 0.1, 0.3])
    now = np.zeros((2, *SHAPE))
    field = solve_field(equations_of(errors, information), now, now, Smoothness(0, 4))
    np.testing.assert_allclose(field, -errors, atol=0.05)


def test_objects_keep_their_own_motion():
    errors = np.zeros((2, *SHAPE))
    errors[:, 2:6, 3:7] = 5
    now = np.zeros((2, *SHAPE))
    field = solve_field(equations_of(errors, random_information(200)), now, now, Smoothness(0, 10))
    np.testing.assert_allclose(field, -errors, atol=0.2)


def test_without_outlines_the_field_minimizes_the_quadratic_form():
    """With one affine fit and equal weights, a dense solver finds the same field."""
    information, now = random_information(), RNG.normal(size=(2, *SHAPE))
    predicted = RNG.normal(size=(2, *SHAPE))
    equations = Equations(information, RNG.normal(0, 50, (2, *SHAPE)))
    smoothness = Smoothness(to_prediction=5.0, to_affine=1e-9, outline=0.5)
    field = solve_field(equations, now, predicted, smoothness)

    def cost(values):
        u = values.reshape(2, *SHAPE)
        d = now - u
        data = 0.5 * (d * equations.times(d)).sum() - (equations.right * d).sum()
        deviation = u - predicted
        smooth = sum((np.diff(deviation, axis=axis) ** 2).sum() for axis in (1, 2))
        return data + 2.5 * smooth + 0.5e-4 * (deviation**2).sum()

    step = 1e-4
    for index in RNG.choice(field.size, 30, replace=False):
        offset = np.zeros(field.size)
        offset[index] = step
        slope = (cost(field.ravel() + offset) - cost(field.ravel() - offset)) / (2 * step)
        assert slope == pytest.approx(0, abs=1e-4)
