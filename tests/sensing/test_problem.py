"""The problem of maximizing the likelihood: what it refuses."""

import numpy as np
import pytest

import jotlight as jl


def test_an_operator_whose_light_does_not_fit_the_bits_is_refused():
    with pytest.raises(ValueError, match=r"operator: .* bits' shape \(4,\), got \(5,\)"):
        jl.Problem(jl.operators.spread((5,)), jl.Likelihood([0, 1, 1, 0]))


def test_a_problem_without_any_bit_is_refused():
    light = jl.operators.scaling((4,), 1.0)
    with pytest.raises(ValueError, match="at least one cell with a bit"):
        jl.Problem(light, jl.Likelihood(np.zeros(4, int), 0))
