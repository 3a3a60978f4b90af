"""Operators of users, and the check that an adjoint is that of the forward operator."""

from types import SimpleNamespace

import numpy as np
import pytest

from jotlight.sensing.likelihood.operators import Operator, check_adjoint, scaling, spread

RANDOM = np.random.default_rng(0)
MATRIX = RANDOM.standard_normal((6, 4))


def matrix_operator(back, forward=lambda x: MATRIX @ x):
    return Operator(forward, back, (4,), (6,))


def test_a_user_can_make_an_operator_of_a_matrix():
    operator = matrix_operator(lambda y: MATRIX.T @ y)
    assert check_adjoint(operator) < 1e-14
    weights = RANDOM.random(6)
    expected = MATRIX.T @ np.diag(weights) @ MATRIX
    normal = np.transpose([operator.normal(weights, x) for x in np.eye(4)])
    np.testing.assert_allclose(normal, expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(
    "back",
    [
        lambda y: 2 * MATRIX.T @ y,
        lambda y: -(MATRIX.T @ y),
        lambda y: np.roll(MATRIX.T @ y, 1),
        lambda y: MATRIX.T @ y + 1e-6,
        lambda y: np.linalg.pinv(MATRIX) @ y,
        lambda _: np.zeros(4),
    ],
    ids=["factor", "sign", "shifted", "constant", "inverse", "nothing"],
)
def test_a_wrong_adjoint_is_found(back):
    with pytest.raises(ValueError, match=r"adjoint: expected .* above tol = 1e-10"):
        check_adjoint(matrix_operator(back))


def test_a_wrong_pixel_at_the_border_is_found():
    right = spread((40, 40), 2, "cubic")

    def back(light):
        image = right.adjoint(light)
        image[0, 0] *= 1.001
        return image

    wrong = Operator(right.forward, back, right.input_shape, right.output_shape)
    with pytest.raises(ValueError, match="adjoint: expected"):
        check_adjoint(wrong)


def test_a_small_mistake_is_within_a_large_tolerance():
    nearly = matrix_operator(lambda y: (1 + 1e-6) * MATRIX.T @ y)
    assert 0 < check_adjoint(nearly, tol=1e-5) < 1e-6
    with pytest.raises(ValueError, match="above tol"):
        check_adjoint(nearly)


def test_equal_seeds_find_equal_errors_and_more_draws_find_no_smaller_one():
    nearly = matrix_operator(lambda y: (1 + 1e-6) * MATRIX.T @ y)
    once, again, more = (check_adjoint(nearly, rng=3, draws=draws, tol=1) for draws in (2, 2, 20))
    assert once == again <= more


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_infinite_outputs_and_nan_are_found(bad):
    with pytest.raises(ValueError, match=r"adjoint: .* \(4,\) with NaN or infinity"):
        check_adjoint(matrix_operator(lambda y: np.where(np.arange(4) == 2, bad, MATRIX.T @ y)))
    with pytest.raises(ValueError, match=r"forward: .* \(6,\) with NaN or infinity"):
        check_adjoint(matrix_operator(lambda y: MATRIX.T @ y, lambda x: bad * (MATRIX @ x)))


def test_an_output_of_another_shape_is_refused():
    with pytest.raises(
        ValueError, match=r"the output of forward: expected shape \(6,\), got \(5,\)"
    ):
        matrix_operator(lambda y: MATRIX.T @ y, lambda x: (MATRIX @ x)[1:]).forward(np.ones(4))
    with pytest.raises(ValueError, match=r"the output of adjoint: .* \(4,\), got \(4, 1\)"):
        check_adjoint(matrix_operator(lambda y: (MATRIX.T @ y)[:, None]))


@pytest.mark.parametrize(("forward", "back"), [((6, 1), (4,)), ((6,), (3,)), ((), (4,))])
def test_the_output_shapes_of_any_object_are_checked(forward, back):
    foreign = SimpleNamespace(
        forward=lambda _: np.ones(forward),
        adjoint=lambda _: np.ones(back),
        input_shape=(4,),
        output_shape=(6,),
    )
    with pytest.raises(ValueError, match="expected a finite array of shape"):
        check_adjoint(foreign)


def test_an_operator_of_zeros_has_an_adjoint_of_zeros():
    assert check_adjoint(Operator(lambda _: np.zeros(3), lambda _: np.zeros(2), (2,), (3,))) == 0


def test_a_check_without_draws_is_refused():
    with pytest.raises(ValueError, match="draws: expected 1 or more, got 0"):
        check_adjoint(scaling((2,), 1.0), draws=0)
