"""A projected Gauss-Newton method: few large steps, for networks with few parameters."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np

from jotlight.array_types import Array
from jotlight.checks import positive_number
from jotlight.interrupts import interruptible
from jotlight.networks.network import Network
from jotlight.training.cost import Cost
from jotlight.training.optimizer_protocol import State, Step

_LINE_SEARCH_SIZES = 7
"""Number of step sizes in the line search: 1, 1/2, 1/4, and so on."""

_MIN_DAMPING = 1e-2
"""Smallest damping. With less, splines fit the noise where examples are rare."""

_MAX_PARAMETERS = 4096
"""Largest number N of parameters. The engine holds 16 matrices of N² entries at once."""

_MATRIX_DECAY = 0.7
"""Weight of the previous steps in the running mean of the matrix."""

_PENALTY = 0.03
"""Penalty ρ of the inner ADMM, as a fraction of the mean curvature of a filter bank or spline."""

_MAX_ROUNDS = 1000
"""Maximum number of iterations of the inner ADMM."""

_TOLERANCE = 1e-4
"""Residual that ends the inner ADMM, as a fraction of the step."""


@dataclasses.dataclass(frozen=True)
class GaussNewton:
    """A projected Levenberg-Marquardt method: each step minimizes a quadratic model inside 𝒜.

    The model consists of the cost's gradient, of the matrix JᵀJ of the normal equations averaged
    over steps, and of a damping term. If a full step lowers the cost on its own examples, the
    damping falls. Otherwise, a line search halves the step until the cost falls. In the last two
    thirds of a run, the steps shrink as 1/n, which averages the noise of all batches.

    The matrix has one row per parameter: some hundreds for two layers. Networks with thousands of
    parameters need :class:`Adam`.

    Parameters
    ----------
    damping : float
        Initial weight of the damping term, as a fraction of the mean curvature.

    Notes
    -----
    J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition, 2006, chapter 10. The
    damping of spline coefficients acts on their second differences. So a coefficient that no
    example determines, such as one between two counts, follows its neighbors.
    """

    damping: float = 0.1
    steps: ClassVar[int] = 30
    pixels: ClassVar[int] = 2**20
    advice: ClassVar[str] = "raise its damping, or use more patches per step"

    def __post_init__(self) -> None:
        object.__setattr__(self, "damping", positive_number("damping", self.damping))

    def take_step(self, cost: Cost, vector: Array, state: State) -> Step:
        """Return a step toward the model's minimum, of length 0 if no length lowers the cost."""
        if vector.size > _MAX_PARAMETERS:
            raise ValueError(
                f"optimizer: expected at most {_MAX_PARAMETERS} parameters for Gauss-Newton, and "
                f"this network has {vector.size}; use adam"
            )
        loss, gradient, matrix = cost.normal_equations(vector)
        if not (np.isfinite(loss) and np.isfinite(gradient).all() and np.isfinite(matrix).all()):
            return Step(vector, state, loss, np.full_like(gradient, np.nan))
        full_steps = max(1, cost.steps // 3)
        weight = 1 / (1 + max(0, cost.step - full_steps))
        if cost.step:
            matrix = _MATRIX_DECAY * state["matrix"] + (1 - _MATRIX_DECAY) * matrix
        damping = float(state["damping"]) if cost.step else self.damping
        model = matrix / weight + damping * _damping_matrix(cost.network, matrix)
        direction = constrained_minimum(model, gradient, vector, cost) - vector
        # 𝒜 is convex, so it contains the results of all shorter steps.
        sizes = 0.5 ** np.arange(_LINE_SEARCH_SIZES)
        size = next((x for x in sizes if cost.value(vector + x * direction) < loss), 0.0)
        if size == 1:
            damping = max(damping / 3, _MIN_DAMPING)
        elif size < 0.2:
            damping *= 4
        state = {"matrix": matrix, "damping": np.array(damping)}
        return Step(vector + size * direction, state, loss, gradient)


def constrained_minimum(matrix: Array, gradient: Array, start: Array, cost: Cost) -> Array:
    """Return approximately the point a of 𝒜 that minimizes g·(a - a0) + ½ (a - a0)ᵀ M (a - a0).

    The method is ADMM with one penalty per filter bank and per spline. It converges to this point
    if 𝒜 bounds each filter bank and each spline separately.
    """
    from scipy.linalg import cho_factor, cho_solve

    penalty = np.empty_like(start)
    for group, _ in _parameter_groups(cost.network):
        penalty[group] = _PENALTY * _mean_curvature(matrix, group)
    factor = interruptible(cho_factor)(matrix + np.diag(penalty))
    target = matrix @ start - gradient
    inside, dual = start, np.zeros_like(start)
    for _ in range(_MAX_ROUNDS):
        free = cho_solve(factor, target + penalty * (inside - dual))
        previous, inside = inside, cost.project(free + dual)
        dual += free - inside
        residual = np.sum(penalty * (np.abs(free - inside) + np.abs(inside - previous)) ** 2)
        step = (_TOLERANCE * (inside - start)) ** 2
        if residual <= np.sum(penalty * (step + (1e-9 * start) ** 2)):
            break
    return inside


def _parameter_groups(network: Network) -> list[tuple[slice, bool]]:
    """Return the slice of each filter bank and spline in the vector, and whether it is a spline."""
    groups = []
    start = 0
    for layer in network.layers:
        rows, number = layer.spline_coefficients.shape
        for size, is_spline in [(layer.filters.size, False), *[(number, True)] * rows]:
            groups.append((slice(start, start + size), is_spline))
            start += size
    return groups


def _damping_matrix(network: Network, matrix: Array) -> Array:
    """Return the damping term: the norm of taps and the roughness of splines, times curvature."""
    damping = np.zeros_like(matrix)
    for group, is_spline in _parameter_groups(network):
        size = group.stop - group.start
        block = np.eye(size)
        if is_spline:
            second_differences = np.diff(np.eye(size), 2, axis=0)
            block = 1e-6 * block + second_differences.T @ second_differences
        damping[group, group] = _mean_curvature(matrix, group) * block
    return damping


def _mean_curvature(matrix: Array, group: slice) -> float:
    mean = float(np.trace(matrix[group, group])) / (group.stop - group.start)
    return float(max(mean, 1e-12))
