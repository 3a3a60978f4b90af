"""The problem of maximizing the likelihood of bits: equation (4)."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import positive_number
from jotlight.sensing.data.stacks import are_all, each_image, image_sums
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.likelihood.operators import Operator
from jotlight.sensing.parameters.response import (
    detection_density,
    detection_probability,
    inverse_detection_probability,
)

_BISECTIONS = 30
"""Number of bisections of the logarithm of a constant intensity."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """Maximize ℓ(A c) over images c in [0, S]: equation (4).

    Parameters
    ----------
    operator : Operator
        A, which maps the image to the light of the likelihood's cells. No entry of A is negative.
        :func:`jotlight.sensing.likelihood.operators.spread` returns the operator of a sensor, and
        :class:`jotlight.sensing.likelihood.operators.Operator` makes one of your own two functions.
    likelihood : Likelihood
        ℓ, the likelihood of the cells' bits; or that of a stack of N images, with the cells of each
        along its first axis.
    max_intensity : float
        S: the largest intensity.

    Raises
    ------
    TypeError
        For a matrix, and other objects that are no `Operator`.
    ValueError
        When the operator's output does not have the shape of the likelihood's cells, or no cell
        has a bit.

    Examples
    --------
    A signal on a line of jots, 6 per pixel, with a cubic kernel:

    >>> light = jl.operators.spread((20,), oversampling=6, kernel="cubic", gain=6.0)
    >>> ramp = np.linspace(0.2, 0.8, 20)
    >>> probability = -np.expm1(-light.forward(ramp))
    >>> ones = np.random.default_rng(0).binomial(100, probability)
    >>> estimate = jl.mle_iterative(jl.Problem(light, jl.Likelihood(ones, trials=100)))
    >>> estimate.shape, bool(abs(estimate - ramp).max() < 0.3)
    ((20,), True)
    """

    operator: Operator
    likelihood: Likelihood
    max_intensity: float = 1.0

    def __post_init__(self) -> None:
        _require_operator(self.operator)
        if self.operator.output_shape not in (self.likelihood.shape, self.likelihood.shape[1:]):
            raise ValueError(
                f"operator: expected light of the bits' shape {self.likelihood.shape}, "
                f"got {self.operator.output_shape}"
            )
        trials = np.asarray(self.likelihood.trials)
        axes = tuple(range(int(self.is_stack), trials.ndim))
        if not trials.max(axis=axes).all():
            raise ValueError("trials: expected at least one cell with a bit, got none")
        largest = positive_number("max_intensity", self.max_intensity)
        object.__setattr__(self, "max_intensity", largest)

    @property
    def is_stack(self) -> bool:
        """Whether the problem consists of those of N images."""
        return self.operator.output_shape != self.likelihood.shape

    def stacked(self) -> Problem:
        """Return the problem as one of a stack."""
        if self.is_stack:
            return self
        return dataclasses.replace(self, likelihood=self.likelihood.stacked())

    def select(self, images: npt.NDArray[np.bool_]) -> Problem:
        """Return the problem of the images of a stack that a mask (N,) marks."""
        if are_all(images):
            return self
        return dataclasses.replace(self, likelihood=self.likelihood.select(images))

    def constant_estimates(self) -> Array:
        """Return the intensity of the constant image that best explains the total number of ones.

        There is one for each image of a stack, (N,). It is at most 0.9 S, and at least its own
        standard error or 0.001 S, whichever is smaller, so that iterative methods can start from
        it.
        """
        cells = self.stacked().likelihood
        trials = np.broadcast_to(np.asarray(cells.trials, np.float64), cells.shape)
        total = image_sums(trials)
        # The number of zeros may be a real number below 1, which the fraction of ones hides.
        fraction = image_sums(cells.ones) / total
        rest = image_sums(trials - cells.ones) / total
        rate = inverse_detection_probability(cells.threshold, fraction, rest)
        dark = image_sums(trials * cells.dark_counts) / total
        light = self.operator.forward(np.ones(self.operator.input_shape))
        light = image_sums(trials * (cells.efficiency * light)) / total
        p, q = ((each * total + 0.5) / (total + 1) for each in (fraction, rest))
        slope = detection_density(
            cells.threshold, inverse_detection_probability(cells.threshold, p, q)
        )
        with np.errstate(divide="ignore"):
            error = np.sqrt(p * q / total) / (slope * light)
        low, high = np.minimum(error, 1e-3 * self.max_intensity), 0.9 * self.max_intensity
        if any(isinstance(each, np.ndarray) for each in (cells.efficiency, cells.dark_counts)):
            return self._match_totals(low, high)
        return np.asarray(np.clip((rate - dark) / light, low, high))

    def _match_totals(self, low: Array, high: float) -> Array:
        """Return the constant intensities in [low, high] at which the ones are expected, (N,)."""
        cells = self.stacked().likelihood
        light = cells.efficiency * self.operator.forward(np.ones(self.operator.input_shape))
        ones, below = image_sums(cells.ones), low
        above = np.full(low.shape, high)
        for _ in range(_BISECTIONS):
            middle = np.sqrt(below) * np.sqrt(above)
            rate = each_image(middle, cells.ones) * light + cells.dark_counts
            expected = image_sums(cells.trials * detection_probability(cells.threshold, rate))
            below = np.where(expected < ones, middle, below)
            above = np.where(expected < ones, above, middle)
        return np.asarray(below)

    def intensity_scales(self) -> Array:
        """Return the scale of the intensities of each image, (N,), to which tolerances refer.

        It is ten times the constant estimate, but at most S.

        Examples
        --------
        >>> operator = jl.operators.scaling((2, 2), 1.0)
        >>> dim = jl.Problem(operator, jl.Likelihood(np.full((2, 2), 10), trials=10**6), 1.0)
        >>> dim.intensity_scales().round(6).tolist()
        [0.0001]
        """
        return np.minimum(10 * self.constant_estimates(), self.max_intensity)

    def log_likelihood(self, image: npt.ArrayLike) -> float:
        """Return ℓ(A c) in nats, summed over all cells."""
        return self.likelihood.value(self.operator.forward(np.asarray(image, np.float64)))


def _require_operator(operator: object) -> None:
    """Raise TypeError for anything but an operator, with how to make one of it.

    Examples
    --------
    >>> _require_operator(np.eye(3))
    Traceback (most recent call last):
      ...
    TypeError: operator: expected a jotlight.operators.Operator, got ndarray; a matrix A is ...
    """
    if isinstance(operator, Operator):
        return
    if hasattr(operator, "forward"):
        advice = "pass jotlight.operators.Operator(own.forward, own.adjoint, input_shape, "
        advice += "output_shape)"
    elif hasattr(operator, "matvec"):
        advice = (
            "a LinearOperator A of SciPy, whose vectors are raveled images, is "
            "jotlight.operators.Operator(lambda x: A.matvec(x.ravel()).reshape(output_shape), "
            "lambda y: A.rmatvec(y.ravel()).reshape(input_shape), input_shape, output_shape)"
        )
    else:
        advice = (
            "a matrix A is jotlight.operators.Operator(lambda x: A @ x, lambda y: A.T @ y, "
            "(A.shape[1],), (A.shape[0],))"
        )
    kind = type(operator).__name__
    raise TypeError(f"operator: expected a jotlight.operators.Operator, got {kind}; {advice}")
