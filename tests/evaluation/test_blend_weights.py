"""The weights under whose blend the bits are most likely."""

import itertools

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.blend_weights import blend_weights, minimize_on_simplex


def simplex(steps):
    """Return all weights of three methods that are multiples of 1 / steps."""
    grid = itertools.product(range(steps + 1), repeat=2)
    return np.array([(a, b, steps - a - b) for a, b in grid if a + b <= steps]) / steps


@pytest.mark.parametrize("seed", range(20))
def test_the_minimum_on_the_simplex_is_at_most_that_on_a_grid(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, rng.integers(1, 4)))
    hessian, linear = root @ root.T, rng.normal(size=3)

    def value(w):
        return np.einsum("...i,ij,...j", w, hessian, w) / 2 + w @ linear

    found = minimize_on_simplex(hessian, linear)
    assert found.min() >= 0
    assert found.sum() == pytest.approx(1)
    best = value(simplex(100)).min()
    assert best - 1e-3 <= value(found) <= best + 1e-12


@pytest.mark.parametrize(("threshold", "noise"), [(1, 0.05), (1, 0.5), (2, 0.05)])
def test_the_weights_are_at_least_as_likely_as_any_on_a_grid(threshold, noise):
    rng = np.random.default_rng(threshold)
    light = rng.uniform(0.1, 1, 500)
    probability = jl.Sensor(threshold=threshold).probability(light[None])[0]
    likelihood = jl.Likelihood(rng.binomial(40, probability), 40, threshold=threshold)
    lights = np.abs(light * (1 + noise * np.array([[1], [2], [3]]) * rng.normal(size=(3, 500))))
    weights = blend_weights(likelihood, lights, 1e-6)
    assert weights.min() >= 0
    assert weights.sum() == pytest.approx(1)
    best = max(likelihood.value(np.maximum(w @ lights, 1e-6)) for w in simplex(40))
    assert likelihood.value(np.maximum(weights @ lights, 1e-6)) >= best - 1e-3


def test_equal_methods_and_no_held_out_bits_are_valid():
    lights = np.ones((3, 4))
    for likelihood in (jl.Likelihood(np.ones(4, int), 2), jl.Likelihood(np.zeros(4, int), 0)):
        weights = blend_weights(likelihood, lights)
        assert weights.min() >= 0
        assert weights.sum() == pytest.approx(1)
