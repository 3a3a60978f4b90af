"""A quadratic cost with a known minimum."""

from types import SimpleNamespace

import numpy as np

import jotlight as jl


def fake_cost(curvature, slope, project, *, step=0, steps=30, size=5):
    """The cost ½ vᵀ M v + g v of one tap and `size` coefficients."""
    network = jl.Network(
        [jl.Layer(np.ones((1, 1, 1, 1)), np.zeros((1, size)), 0.0, 9 / (size - 3))],
        jl.Sensor(oversampling=3),
    )

    def value(vector):
        return 0.5 * vector @ curvature @ vector + slope @ vector

    def gradient(vector):
        return value(vector), curvature @ vector + slope

    return SimpleNamespace(
        network=network,
        step=step,
        steps=steps,
        project=project,
        value=value,
        gradient=gradient,
        normal_equations=lambda vector: (*gradient(vector), curvature),
    )


def quadratic(seed, size=6):
    rng = np.random.default_rng(seed)
    factor = rng.normal(0, 1, (size, size))
    return factor @ factor.T + 0.1 * np.eye(size), 2 * rng.normal(0, 1, size)
