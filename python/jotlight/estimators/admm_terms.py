"""The terms of ADMM's objective. Each has a copy x of A c, a scaled multiplier, and a penalty ρ."""

import abc

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.estimators.tv import check_map
from jotlight.sensing.likelihood import Array, Problem
from jotlight.sensing.operators import differences, dot

_RELAXATION = 1.7
"""The over-relaxation. Eckstein and Bertsekas (1992) recommend 1.5 to 1.8."""


class SplittingTerm(abc.ABC):
    """A term f(A c) of the objective, split into f(x) and the penalty ½ ρ ‖A c - x + dual‖².

    Parameters
    ----------
    penalty : float
        ρ > 0.
    x : ndarray of float64
        The copy of A c.
    dual : ndarray of float64
        The scaled multiplier y/ρ, of the shape of x.
    """

    def __init__(self, penalty: float, x: Array, dual: Array) -> None:
        self.penalty, self.x, self.dual = penalty, x, dual
        self._adjoint_of_x = self.adjoint(x)
        self._adjoint_of_dual = self.adjoint(dual)

    @abc.abstractmethod
    def adjoint(self, array: Array) -> Array:
        """Return Aᵀ of an array of the shape of x."""

    @abc.abstractmethod
    def update_split(self, image: Array) -> float:
        """Update x and the multiplier and return ‖A c - x‖² in units of intensity."""

    def update(self, image: Array) -> tuple[float, Array]:
        """Update the term and return its squared primal residual and its dual residual."""
        primal = self.update_split(image)
        previous, self._adjoint_of_x = self._adjoint_of_x, self.adjoint(self.x)
        self._adjoint_of_dual = self.adjoint(self.dual)
        return primal, self.penalty * (self._adjoint_of_x - previous)

    def right_hand_side(self) -> Array:
        """Return ρ Aᵀ(x - dual), this term's part of the normal equations for c."""
        return self.penalty * (self._adjoint_of_x - self._adjoint_of_dual)

    def multiplier_force(self) -> Array:
        """Return Aᵀ y of the multiplier y = ρ dual."""
        return self.penalty * self._adjoint_of_dual

    def rescale(self, factor: float) -> None:
        """Multiply ρ by `factor` and leave the multiplier y as it is."""
        self.penalty *= factor
        self.dual /= factor
        self._adjoint_of_dual /= factor


class DataTerm(SplittingTerm):
    """The term -ℓ(s) of the light s = A c. The light of the intensity S limits s."""

    def __init__(self, problem: Problem, penalty: float, gain: float, image: Array) -> None:
        self._operator, self._likelihood = problem.operator, problem.likelihood
        self._gain = gain
        brightest = self._operator.forward(np.full(image.shape, problem.max_intensity))
        self.max_light = float(np.max(brightest))
        light = self._operator.forward(image)
        # At the solution, ρ dual is the gradient of -ℓ. With this multiplier, a start near the
        # solution stays near it. For cells with ones but nearly no light the gradient is unbounded,
        # so it is clipped.
        gradient, _ = self._likelihood.gradient_and_curvature(light)
        inside = (light > 0) & (light < self.max_light)
        bound = float(light.mean())
        dual = np.where(inside, np.clip(-gradient / penalty, -bound, bound), 0.0)
        super().__init__(penalty, light, dual)

    def adjoint(self, array: Array) -> Array:
        """Return Aᵀ of light on the cells."""
        return self._operator.adjoint(array)

    def update_split(self, image: Array) -> float:
        """Solve the problem of each cell and return ‖A c - x‖² in units of intensity."""
        light = self._operator.forward(image).reshape(-1)
        return (
            self._likelihood.admm_update(
                (self.penalty, _RELAXATION), self.max_light, light, self.x, self.dual
            )
            / self._gain**2
        )


class VariationTerm(SplittingTerm):
    """The term λ TV of an image (H, W), or of a signal as an image of one row."""

    def __init__(
        self,
        weight: npt.NDArray[np.floating],
        norm: str,
        penalty: float,
        image: Array,
        threads: int | None,
    ) -> None:
        self._weight = check_map("weight", weight, image.shape)
        self._isotropic, self._threads = norm == "isotropic", threads
        self._shape = image.shape
        self._rows = image.shape if image.ndim == 2 else (1, *image.shape)
        self._differences = differences(self._rows, threads=threads)
        planes = self._differences.forward(image.reshape(self._rows))
        # The first multiplier is the part of each difference that shrinkage removes.
        shrunk = planes.copy()
        engine.shrink(shrunk, self._weight / penalty, self._isotropic, threads)
        super().__init__(penalty, planes, planes - shrunk)

    def adjoint(self, array: Array) -> Array:
        """Return Dᵀ of differences."""
        return self._differences.adjoint(array).reshape(self._shape)

    def update_split(self, image: Array) -> float:
        """Shrink the differences and return ‖D c - x‖²."""
        return engine.total_variation_admm_update(
            (self.penalty, _RELAXATION),
            self._weight,
            self._isotropic,
            image.reshape(self._rows),
            self.x,
            self.dual,
            self._threads,
        )


class BoxTerm(SplittingTerm):
    """The constraint 0 ≤ c ≤ S. It is required where the bounds of the light do not imply it."""

    def __init__(self, max_intensity: float, penalty: float, image: Array) -> None:
        self._max_intensity = max_intensity
        super().__init__(penalty, image.copy(), np.zeros_like(image))

    def adjoint(self, array: Array) -> Array:
        """Return the image itself."""
        return array

    def update_split(self, image: Array) -> float:
        """Clip the image to [0, S] and return ‖c - x‖²."""
        point = _RELAXATION * image + (1 - _RELAXATION) * self.x + self.dual
        self.x = np.clip(point, 0, self._max_intensity)
        self.dual = point - self.x
        difference = image - self.x
        return dot(difference, difference)
