"""The weights of estimates under whose blend the bits are most likely."""

import itertools

import numpy as np

from jotlight.array_types import Array
from jotlight.sensing.likelihood.likelihood import Likelihood

_MAX_STEPS = 50
"""Maximum number of Newton steps for the weights."""

_MIN_GAIN = 1e-3
"""Gain of the log-likelihood in nats below which the weights have converged."""


def blend_weights(likelihood: Likelihood, lights: Array, floor: float = 0.0) -> Array:
    """Return the weights, 0 or more with sum 1, under whose blend the bits are most likely.

    Newton's method finds them. Each step minimizes a quadratic function over the simplex.

    Parameters
    ----------
    likelihood : Likelihood
        The likelihood of the bits.
    lights : ndarray of float64, shape (M, N)
        The light of each method at the N cells of the likelihood.
    floor : float
        The smallest light of a blend.

    Examples
    --------
    >>> likelihood = jl.Likelihood(np.full(64, 26), trials=100)  # 0.301 = -log(1 - 0.26)
    >>> blend_weights(likelihood, np.stack([np.full(64, s) for s in (0.2, 0.4)])).round(2)
    array([0.49, 0.51])
    """
    count = len(lights)
    weights = np.full(count, 1 / count)
    # With no bit held out, all blends are equally likely.
    light = np.maximum(weights @ lights, floor)
    value = likelihood.value(light)
    for _ in range(_MAX_STEPS):
        gradient, curvature = likelihood.gradient_and_curvature(light)
        # Relative to the current light, the methods differ little, so this keeps the precision.
        others = lights - light
        slope = others @ gradient
        hessian = (others * curvature) @ others.T
        step = minimize_on_simplex(hessian, -slope) - weights
        for halvings in range(30):
            candidate = weights + 0.5**halvings * step
            light = np.maximum(candidate @ lights, floor)
            new = likelihood.value(light)
            if new > value:
                break
        else:
            break
        weights, gain, value = candidate, new - value, new
        if gain < _MIN_GAIN:
            break
    return weights


def minimize_on_simplex(hessian: Array, linear: Array) -> Array:
    """Return the w ≥ 0 with sum 1 that minimizes ½ wᵀ H w + linearᵀ w, for a few variables.

    The minimum on every face of the simplex is computed, and the best one that lies in it is taken.

    Examples
    --------
    >>> minimize_on_simplex(np.eye(2), np.array([0.0, -0.5]))
    array([0.25, 0.75])
    >>> minimize_on_simplex(np.eye(2), np.array([3.0, 0.0]))
    array([0., 1.])
    """
    count = len(linear)
    best, best_value = np.zeros(count), np.inf
    for size in range(1, count + 1):
        for face in itertools.combinations(range(count), size):
            # The face consists of its first corner plus combinations of its edges.
            corner = np.eye(count)[face[0]]
            edges = np.eye(count)[list(face[1:])] - corner
            # Equal methods make the system singular; least squares finds one of the solutions.
            system = edges @ hessian @ edges.T
            moves = np.linalg.lstsq(system, -edges @ (linear + hessian @ corner))[0]
            # With almost no curvature, the moves are huge or not finite.
            if not ((moves >= 0).all() and moves.sum() <= 1):
                continue
            candidate = corner + moves @ edges
            value = float(candidate @ hessian @ candidate / 2 + linear @ candidate)
            if value < best_value:
                best, best_value = candidate, value
    return best
