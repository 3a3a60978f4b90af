"""Ways to walk to the minimum of the cost inside of the set 𝒜."""

import dataclasses
import math
from typing import Any, ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from jotlight.networks.network import Network
from jotlight.training.cost import Cost
from jotlight.training.parameters import Vector, split_vector

_TRIES = 7
"""How often a step is halved at most, less one."""

_LEAST_DAMPING = 1e-2
"""With less, splines follow the noise where the examples say little, and nothing is gained."""

_MOST_PARAMETERS = 4096
"""Their matrix has as many rows and columns, and the engine sums sixteen of them."""

_KEPT = 0.7
"""How much of the mean matrix is kept from step to step."""

_ROUNDS = 1000
"""Of the search inside of one step of :class:`GaussNewton`, at most."""

_EXACT = 1e-4
"""How near that search comes to the minimum, as a share of the step."""

State = dict[str, npt.NDArray[Any]]
"""What an optimizer remembers from step to step; arrays, so that a checkpoint can hold it."""


@dataclasses.dataclass(frozen=True)
class Step:
    """Where a step led, and what was found at its start."""

    vector: Vector
    state: State
    loss: float
    gradient: Vector


class Optimizer(Protocol):
    """What :func:`jotlight.train` needs to know of an optimizer."""

    @property
    def steps(self) -> int:
        """How many steps are enough as a rule."""

    @property
    def pixels(self) -> int:
        """How many pixels a step should see as a rule."""

    @property
    def advice(self) -> str:
        """What to do when the cost grows."""

    def take_step(self, cost: Cost, vector: Vector, state: State) -> Step:
        """Walk on; `state` is empty at first."""


@dataclasses.dataclass(frozen=True)
class ProjectedGradient:
    """The paper's: a ← proj(a - μ∇ε(a)), equation (13).

    Parameters
    ----------
    learning_rate : float
        μ: 5e-6 in the paper for 32 x 32 images, 5e-8 for 481 x 321, since ε is a sum over pixels.
    """

    learning_rate: float = 5e-6
    steps: ClassVar[int] = 10_000
    pixels: ClassVar[int] = 2**17
    advice: ClassVar[str] = "lower its learning_rate"

    def __post_init__(self) -> None:
        _check_positive("learning_rate", self.learning_rate)

    def take_step(self, cost: Cost, vector: Vector, state: State) -> Step:
        """Walk against the gradient."""
        loss, gradient = cost.gradient(vector)
        return Step(cost.project(vector - self.learning_rate * gradient), {}, loss, gradient)


@dataclasses.dataclass(frozen=True)
class Adam:
    """Projected Adam: steps of about one size whatever the gradient's, which shrink to the end.

    Parameters
    ----------
    learning_rate : float
        The first steps' size, as a share of the range of a coefficient, or of a filter's sum.
    betas : (float, float)
        How much of the mean gradient and of its mean square is kept from step to step.

    Notes
    -----
    D. P. Kingma and J. Ba, "Adam: a method for stochastic optimization", ICLR 2015. Here the step
    size falls as half a cosine, and each step ends with the projection on 𝒜.
    """

    learning_rate: float = 0.01
    betas: tuple[float, float] = (0.9, 0.999)
    steps: ClassVar[int] = 2000
    pixels: ClassVar[int] = 2**17
    advice: ClassVar[str] = "lower its learning_rate"

    def __post_init__(self) -> None:
        _check_positive("learning_rate", self.learning_rate)
        if not all(0 <= share < 1 for share in self.betas):
            raise ValueError(f"betas: expected two shares in [0, 1), got {self.betas}")

    def take_step(self, cost: Cost, vector: Vector, state: State) -> Step:
        """Walk against the mean gradient over its root mean square."""
        loss, gradient = cost.gradient(vector)
        zero = np.zeros_like(vector)
        first, second = self.betas
        mean = first * state.get("mean", zero) + (1 - first) * gradient
        square = second * state.get("square", zero) + (1 - second) * gradient**2
        taken = cost.step + 1
        unbiased = mean / (1 - first**taken)
        spread = np.sqrt(square / (1 - second**taken))
        share = 0.5 * (1 + math.cos(math.pi * cost.step / cost.steps))
        # Where a gradient has always been 0 there is nowhere to go.
        direction = np.divide(unbiased, spread, out=zero, where=spread > 0)
        step = self.learning_rate * share * self._ranges(cost.network) * direction
        return Step(cost.project(vector - step), {"mean": mean, "square": square}, loss, gradient)

    @staticmethod
    def _ranges(network: Network) -> Vector:
        """How far each parameter can be expected to go."""
        ranges = np.empty(sum(x.parameter_count for x in network.layers))
        for index, (filters, coefficients) in enumerate(split_vector(network, ranges)):
            filters[...] = 0.2
            if index + 1 < len(network.layers):
                after = network.layers[index + 1]
                coefficients[...] = after.spacing * (after.spline_coefficients.shape[1] - 3)
            else:
                coefficients[...] = network.sensor.max_intensity
        return ranges


@dataclasses.dataclass(frozen=True)
class GaussNewton:
    """Levenberg and Marquardt's: each step minimises a quadratic model of the cost inside of 𝒜.

    The model has the cost's gradient and the normal equations' matrix JᵀJ, averaged over the steps,
    and a damping that shrinks as long as whole steps lower the cost on the step's own examples;
    else the step is halved until it does. In the last two thirds of a run the steps shrink as 1/n,
    which averages the noise of all the batches.

    The matrix has as many rows as there are parameters: some hundred for two layers. For networks
    with many thousands take :class:`Adam`.

    Parameters
    ----------
    damping : float
        The first weight of the damping, as a share of the mean curvature.

    Notes
    -----
    J. Nocedal and S. Wright, "Numerical Optimization", 2nd edition, 2006, chapter 10. The damping
    of spline coefficients is on their second differences, so that what no example touches, as
    between two counts, follows its neighbours.
    """

    damping: float = 0.1
    steps: ClassVar[int] = 30
    pixels: ClassVar[int] = 2**20
    advice: ClassVar[str] = "raise its damping, or give it more patches a step"

    def __post_init__(self) -> None:
        _check_positive("damping", self.damping)

    def take_step(self, cost: Cost, vector: Vector, state: State) -> Step:
        """Minimise the model, and stay where that does not lower the cost on these examples."""
        if vector.size > _MOST_PARAMETERS:
            raise ValueError(
                f"optimizer: Gauss-Newton takes at most {_MOST_PARAMETERS} parameters, and this "
                f"network has {vector.size}; take adam"
            )
        loss, gradient, matrix = cost.normal_equations(vector)
        if not (np.isfinite(loss) and np.isfinite(gradient).all() and np.isfinite(matrix).all()):
            return Step(vector, state, loss, np.full_like(gradient, np.nan))
        full = max(1, cost.steps // 3)
        weight = 1 / (1 + max(0, cost.step - full))
        if state:
            matrix = _KEPT * state["matrix"] + (1 - _KEPT) * matrix
        damping = float(state["damping"]) if state else self.damping
        model = matrix / weight + damping * _damping_of(cost.network, matrix)
        walk = _constrained_minimum(model, gradient, vector, cost) - vector
        # 𝒜 is convex, so what lies between two of its points is in it.
        shares = 0.5 ** np.arange(_TRIES)
        share = next((x for x in shares if cost.value(vector + x * walk) < loss), 0.0)
        if share == 1:
            damping = max(damping / 3, _LEAST_DAMPING)
        elif share < 0.2:
            damping *= 4
        state = {"matrix": matrix, "damping": np.array(damping)}
        return Step(vector + share * walk, state, loss, gradient)


OPTIMIZERS: dict[str, type[ProjectedGradient | Adam | GaussNewton]] = {
    "gauss-newton": GaussNewton,
    "adam": Adam,
    "projected-gradient": ProjectedGradient,
}
"""By name, the default first."""


def _groups(network: Network) -> list[tuple[slice, bool]]:
    """Where each filter bank and each spline stands in the vector, and whether it is a spline."""
    groups = []
    start = 0
    for layer in network.layers:
        rows, number = layer.spline_coefficients.shape
        for size, spline in [(layer.filters.size, False), *[(number, True)] * rows]:
            groups.append((slice(start, start + size), spline))
            start += size
    return groups


def _damping_of(network: Network, matrix: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """A metric on the curvature's scale: of taps their size, of splines mostly their roughness."""
    metric = np.zeros_like(matrix)
    for inside, spline in _groups(network):
        size = inside.stop - inside.start
        block = np.eye(size)
        if spline:
            bends = np.diff(np.eye(size), 2, axis=0)
            block = 1e-6 * block + bends.T @ bends
        metric[inside, inside] = _curvature(matrix, inside) * block
    return metric


def _curvature(matrix: npt.NDArray[np.float64], inside: slice) -> float:
    mean = float(np.trace(matrix[inside, inside])) / (inside.stop - inside.start)
    return float(max(mean, 1e-12))


def _constrained_minimum(
    matrix: npt.NDArray[np.float64], gradient: Vector, start: Vector, cost: Cost
) -> Vector:
    """The point of 𝒜 with the least g·(a - start) + ½ (a - start)ᵀ M (a - start), nearly.

    By the alternating direction method of multipliers: one point minimises, another stays in 𝒜,
    and a pull between them, as strong as the curvature of each part, brings them together.
    """
    from scipy.linalg import cho_factor, cho_solve

    pull = np.empty_like(start)
    for inside, _ in _groups(cost.network):
        pull[inside] = 0.03 * _curvature(matrix, inside)
    factor = cho_factor(matrix + np.diag(pull))
    target = matrix @ start - gradient
    kept, apart = start, np.zeros_like(start)
    for _ in range(_ROUNDS):
        free = cho_solve(factor, target + pull * (kept - apart))
        before, kept = kept, cost.project(free + apart)
        apart += free - kept
        gap = np.sum(pull * (np.abs(free - kept) + np.abs(kept - before)) ** 2)
        if gap <= np.sum(pull * ((_EXACT * (kept - start)) ** 2 + (1e-9 * start) ** 2)):
            break
    return kept


def _check_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name}: expected a number above 0, got {value}")
