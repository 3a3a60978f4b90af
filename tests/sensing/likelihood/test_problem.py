"""The problem of maximizing the likelihood: what it refuses."""

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse import linalg

import jotlight as jl


def test_an_operator_whose_light_does_not_fit_the_bits_is_refused():
    with pytest.raises(ValueError, match=r"operator: .* bits' shape \(4,\), got \(5,\)"):
        jl.Problem(jl.operators.spread((5,)), jl.Likelihood([0, 1, 1, 0]))


class Blur:
    """An operator of the caller that is no Operator."""

    input_shape = output_shape = (4,)

    def forward(self, image):
        return image

    adjoint = forward


@pytest.mark.parametrize(
    ("operator", "advice"),
    [
        (np.eye(4), r"got ndarray; a matrix A is jotlight.operators.Operator\(lambda x: A @ x"),
        (sparse.eye_array(4), "; a matrix A is"),
        (linalg.aslinearoperator(np.eye(4)), "; a LinearOperator A of SciPy, .*A.rmatvec"),
        (Blur(), r"got Blur; pass jotlight.operators.Operator\(own.forward, own.adjoint"),
        (None, "got NoneType"),
    ],
)
def test_other_objects_than_operators_are_refused_with_how_to_wrap_them(operator, advice):
    likelihood = jl.Likelihood([0, 1, 1, 0])
    with pytest.raises(TypeError, match=rf"operator: expected a jotlight\.operators.*{advice}"):
        jl.Problem(operator, likelihood)


def test_the_advice_for_other_objects_works():
    likelihood, matrix, own = jl.Likelihood([0, 1, 1, 0]), np.eye(4), Blur()
    scipy_operator = linalg.aslinearoperator(matrix)
    make = jl.operators.Operator
    each = [
        make(lambda x: matrix @ x, lambda y: matrix.T @ y, (4,), (4,)),
        make(own.forward, own.adjoint, (4,), (4,)),
        make(
            lambda x: scipy_operator.matvec(x.ravel()).reshape((4,)),
            lambda y: scipy_operator.rmatvec(y.ravel()).reshape((4,)),
            (4,),
            (4,),
        ),
    ]
    expected = jl.admm_tv(jl.Problem(jl.operators.scaling((4,), 1.0), likelihood))
    for operator in each:
        found = jl.admm_tv(jl.Problem(operator, likelihood))
        np.testing.assert_allclose(found, expected, atol=1e-2)


def test_a_problem_without_any_bit_is_refused():
    light = jl.operators.scaling((4,), 1.0)
    with pytest.raises(ValueError, match="at least one cell with a bit"):
        jl.Problem(light, jl.Likelihood(np.zeros(4, int), 0))


def test_the_constant_estimate_explains_the_ones_of_jots_that_differ():
    # The cells with the most trials are dark.
    trials = np.where(np.arange(64).reshape(8, 8) % 8, 100.0, 10_000.0)
    dark = np.where(trials > 100, 0.0, 2.5)
    ones = np.round(trials * -np.expm1(-0.02 - dark)).astype(int)
    likelihood = jl.Likelihood(ones, trials, dark_counts=dark)
    problem = jl.Problem(jl.operators.scaling((8, 8), 1.0), likelihood, 5.0)
    assert problem.constant_estimates() == pytest.approx(0.02, rel=0.05)


def test_the_text_of_a_problem_shows_no_functions():
    light = jl.operators.spread((2, 3), oversampling=2, kernel="cubic")
    problem = jl.Problem(light, jl.Likelihood(np.ones((4, 6), int), 8, threshold=2))
    text = repr(problem)
    assert "<Likelihood: 4 x 6 cells, 8 trials, threshold 2>" in text
    assert "kernel='cubic'" in text
    assert "function" not in text
    assert " at 0x" not in text
    assert repr(jl.Likelihood(1)) == "<Likelihood: 1 cell, 1 trial, threshold 1>"
