"""First-order optimizers, and all optimizers by name."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

import numpy as np

from jotlight.array_types import Array
from jotlight.checks import positive_number, real_number, shown
from jotlight.networks.network import Network
from jotlight.parameter_names import check_choice
from jotlight.training.cost import Cost
from jotlight.training.gauss_newton import GaussNewton
from jotlight.training.optimizer_protocol import Optimizer, State, Step
from jotlight.training.parameters import split_vector

_FILTER_RANGE = 0.2
"""Range of a tap, as a fraction of the sum of its filter. It scales Adam's steps."""


@dataclasses.dataclass(frozen=True)
class ProjectedGradient:
    """The paper's projected gradient descent, a ← proj(a - μ∇ε(a)), equation (13).

    Parameters
    ----------
    learning_rate : float
        μ. The paper uses 5e-6 for images of 32 × 32 pixels. It uses 5e-8 for 481 × 321, because ε
        is a sum over pixels.
    """

    learning_rate: float = 5e-6
    steps: ClassVar[int] = 10_000
    pixels: ClassVar[int] = 2**17
    advice: ClassVar[str] = "lower its learning_rate"

    def __post_init__(self) -> None:
        rate = positive_number("learning_rate", self.learning_rate)
        object.__setattr__(self, "learning_rate", rate)

    def take_step(self, cost: Cost, vector: Array, state: State) -> Step:
        """Return a step against the gradient, projected onto 𝒜."""
        loss, gradient = cost.gradient(vector)
        return Step(cost.project(vector - self.learning_rate * gradient), {}, loss, gradient)


@dataclasses.dataclass(frozen=True)
class Adam:
    """Projected Adam with a learning rate that falls to 0.

    Parameters
    ----------
    learning_rate : float
        Size of the first steps, as a fraction of the range of a coefficient or tap.
    betas : (float, float)
        Decay rates of the mean gradient and of its mean square, in [0, 1).

    Notes
    -----
    D. P. Kingma and J. Ba, "Adam: a method for stochastic optimization", ICLR 2015.

    Differs from that paper: the learning rate falls along half a cosine, it is scaled by the range
    of each parameter, and each step ends with the projection onto 𝒜.
    """

    learning_rate: float = 0.01
    betas: tuple[float, float] = (0.9, 0.999)
    steps: ClassVar[int] = 2000
    pixels: ClassVar[int] = 2**17
    advice: ClassVar[str] = "lower its learning_rate"

    def __post_init__(self) -> None:
        rate = positive_number("learning_rate", self.learning_rate)
        object.__setattr__(self, "learning_rate", rate)
        each = self.betas if np.iterable(self.betas) else ()
        betas = tuple(float(real_number(beta)) for beta in each)
        if len(betas) != 2 or not all(0 <= beta < 1 for beta in betas):
            raise ValueError(f"betas: expected two numbers in [0, 1), got {shown(self.betas)}")
        object.__setattr__(self, "betas", betas)

    def take_step(self, cost: Cost, vector: Array, state: State) -> Step:
        """Return a step against the mean gradient divided by its root mean square."""
        loss, gradient = cost.gradient(vector)
        zero = np.zeros_like(vector)
        mean_decay, square_decay = self.betas
        last = state if cost.step else {"mean": zero, "square": zero}
        mean = mean_decay * last["mean"] + (1 - mean_decay) * gradient
        square = square_decay * last["square"] + (1 - square_decay) * gradient**2
        taken = cost.step + 1
        unbiased = mean / (1 - mean_decay**taken)
        root_mean_square = np.sqrt(square / (1 - square_decay**taken))
        decay = 0.5 * (1 + math.cos(math.pi * cost.step / cost.steps))
        # A parameter whose gradient was always 0 does not change.
        direction = np.divide(unbiased, root_mean_square, out=zero, where=root_mean_square > 0)
        step = self.learning_rate * decay * _parameter_ranges(cost.network) * direction
        return Step(cost.project(vector - step), {"mean": mean, "square": square}, loss, gradient)


def _parameter_ranges(network: Network) -> Array:
    """Return the range of each parameter; that of coefficients is the next splines' domain."""
    ranges = np.empty(sum(layer.parameter_count for layer in network.layers))
    for index, (filters, coefficients) in enumerate(split_vector(network, ranges)):
        filters[...] = _FILTER_RANGE
        if index + 1 < len(network.layers):
            following = network.layers[index + 1]
            coefficients[...] = following.spacing * (following.spline_coefficients.shape[1] - 3)
        else:
            coefficients[...] = network.sensor.max_intensity
    return ranges


OPTIMIZERS: dict[str, type[ProjectedGradient | Adam | GaussNewton]] = {
    "gauss-newton": GaussNewton,
    "adam": Adam,
    "projected-gradient": ProjectedGradient,
}
"""Optimizers by name, the default first."""


def find_optimizer(optimizer: str | Optimizer) -> Optimizer:
    """Return an optimizer by name with default settings, or the optimizer itself.

    Raises
    ------
    TypeError, ValueError
        For an unknown name, or an object that is not an optimizer.

    Examples
    --------
    >>> find_optimizer("adam")
    Adam(learning_rate=0.01, betas=(0.9, 0.999))
    """
    if isinstance(optimizer, str):
        check_choice("optimizer", optimizer, OPTIMIZERS)
        return OPTIMIZERS[optimizer]()
    if isinstance(optimizer, type) or not hasattr(optimizer, "take_step"):
        raise TypeError(
            f"optimizer: expected one of {', '.join(OPTIMIZERS)} or an object with take_step, such "
            f"as jotlight.training.Adam(), got {optimizer!r}"
        )
    return optimizer
