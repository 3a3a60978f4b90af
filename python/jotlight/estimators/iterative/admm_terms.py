"""The terms of ADMM's objective. Each has a copy x of A c, a scaled multiplier, and a penalty ρ.

All arrays are those of a stack of images, which do not affect each other.
"""

import abc

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.sensing.bits.values import flatten
from jotlight.sensing.data.stacks import dots, each_image, image_means, select
from jotlight.sensing.likelihood.operators import differences
from jotlight.sensing.likelihood.problem import Problem

_RELAXATION = 1.7
"""The over-relaxation. Eckstein and Bertsekas (1992) recommend 1.5 to 1.8."""


class SplittingTerm(abc.ABC):
    """A term f(A c) of the objective, split into f(x) and the penalty ½ ρ ‖A c - x + dual‖².

    Parameters
    ----------
    penalty : ndarray of float64, shape (N,)
        ρ > 0 of each image of a stack.
    x : ndarray of float64, shape (N, ...)
        The copy of A c.
    dual : ndarray of float64
        The scaled multiplier y/ρ, of the shape of x.
    """

    def __init__(self, penalty: Array, x: Array, dual: Array) -> None:
        self.penalty, self.x, self.dual = penalty, x, dual
        self._adjoint_of_x = self.adjoint(x)
        self._adjoint_of_dual = self.adjoint(dual)

    @abc.abstractmethod
    def adjoint(self, array: Array) -> Array:
        """Return Aᵀ of an array of the shape of x."""

    @abc.abstractmethod
    def update_split(self, image: Array) -> Array:
        """Update x and the multiplier and return ‖A c - x‖² in units of intensity, (N,)."""

    def update(self, image: Array) -> tuple[Array, Array]:
        """Update the term and return its squared primal residuals, (N,), and dual residuals."""
        primal = self.update_split(image)
        previous, self._adjoint_of_x = self._adjoint_of_x, self.adjoint(self.x)
        self._adjoint_of_dual = self.adjoint(self.dual)
        change = self._adjoint_of_x - previous
        change *= each_image(self.penalty, change)
        return primal, change

    def right_hand_side(self) -> Array:
        """Return ρ Aᵀ(x - dual), this term's part of the normal equations for c."""
        right = self._adjoint_of_x - self._adjoint_of_dual
        right *= each_image(self.penalty, right)
        return right

    def squared_force(self) -> Array:
        """Return ‖Aᵀ y‖² of the multiplier y = ρ dual, (N,)."""
        return self.penalty**2 * dots(self._adjoint_of_dual, self._adjoint_of_dual)

    def rescale(self, factor: Array) -> None:
        """Multiply ρ of each image by a factor, (N,), and leave the multiplier y as it is."""
        self.penalty = self.penalty * factor
        # Not in place: both arrays may be the same.
        self.dual = self.dual / each_image(factor, self.dual)
        self._adjoint_of_dual = self._adjoint_of_dual / each_image(factor, self._adjoint_of_dual)

    def select(self, images: npt.NDArray[np.bool_]) -> None:
        """Keep only the images of a mask (N,)."""
        self.penalty, self.x, self.dual = (
            select(each, images) for each in (self.penalty, self.x, self.dual)
        )
        self._adjoint_of_x = select(self._adjoint_of_x, images)
        self._adjoint_of_dual = select(self._adjoint_of_dual, images)


class DataTerm(SplittingTerm):
    """The term -ℓ(s) of the light s = A c. The light of the intensity S limits s."""

    def __init__(self, problem: Problem, penalty: Array, gain: float, image: Array) -> None:
        self._operator, self._likelihood = problem.operator, problem.likelihood
        self._gain = gain
        brightest = np.full(self._operator.input_shape, problem.max_intensity)
        self.max_light = float(np.max(self._operator.forward(brightest)))
        light = self._operator.forward(image)
        # At the solution, ρ dual is the gradient of -ℓ. With this multiplier, a start near the
        # solution stays near it. For cells with ones but nearly no light the gradient is unbounded,
        # so it is clipped.
        gradient, _ = self._likelihood.gradient_and_curvature(light)
        inside = (light > 0) & (light < self.max_light)
        bound = each_image(image_means(light), light)
        dual = np.where(inside, np.clip(-gradient / each_image(penalty, light), -bound, bound), 0.0)
        # The updates overwrite x, which may be the image itself.
        super().__init__(penalty, light.copy(), dual)

    def adjoint(self, array: Array) -> Array:
        """Return Aᵀ of light on the cells."""
        return self._operator.adjoint(array)

    def update_split(self, image: Array) -> Array:
        """Solve the problem of each cell and return ‖A c - x‖² in units of intensity, (N,)."""
        light = self._operator.forward(image)
        step = self.penalty, _RELAXATION
        return (
            self._likelihood.admm_update(step, self.max_light, light, self.x, self.dual)
            / self._gain**2
        )

    def select(self, images: npt.NDArray[np.bool_]) -> None:
        """Keep only the images of a mask (N,)."""
        super().select(images)
        self._likelihood = self._likelihood.select(images)


class VariationTerm(SplittingTerm):
    """The term λ TV of images (N, H, W), or of signals as images of one row.

    `weight` is λ: a number, or a map of the shape of the images.
    """

    def __init__(
        self,
        weight: float | Array,
        norm: str,
        penalty: Array,
        image: Array,
        threads: int | None,
    ) -> None:
        self._weight = weight
        self._isotropic, self._threads = norm == "isotropic", threads
        self._shape = image.shape[1:]
        self._rows = self._shape if image.ndim == 3 else (1, *self._shape)
        self._differences = differences(self._rows, threads=threads)
        planes = self._differences.forward(image.reshape(-1, *self._rows))
        # The first multiplier is the part of each difference that shrinkage removes.
        shrunk = planes.copy()
        thresholds = np.broadcast_to(weight / each_image(penalty, image), image.shape)
        thresholds = np.ascontiguousarray(thresholds).reshape(-1)
        engine.shrink(shrunk, thresholds, self._isotropic, threads)
        super().__init__(penalty, planes, planes - shrunk)

    def adjoint(self, array: Array) -> Array:
        """Return Dᵀ of differences."""
        return self._differences.adjoint(array).reshape(-1, *self._shape)

    def update_split(self, image: Array) -> Array:
        """Shrink the differences and return ‖D c - x‖², (N,)."""
        return np.array(
            engine.total_variation_admm_update(
                (self.penalty, _RELAXATION),
                flatten(self._weight),
                self._isotropic,
                image.reshape(-1, *self._rows),
                self.x,
                self.dual,
                self._threads,
            )
        )

    def select(self, images: npt.NDArray[np.bool_]) -> None:
        """Keep only the images of a mask (N,)."""
        super().select(images)
        if isinstance(self._weight, np.ndarray):
            self._weight = select(self._weight, images)


class BoxTerm(SplittingTerm):
    """The constraint 0 ≤ c ≤ S. It is required where the bounds of the light do not imply it."""

    def __init__(self, max_intensity: float, penalty: Array, image: Array) -> None:
        self._max_intensity = max_intensity
        super().__init__(penalty, image.copy(), np.zeros_like(image))

    def adjoint(self, array: Array) -> Array:
        """Return the image itself."""
        return array

    def update_split(self, image: Array) -> Array:
        """Clip the image to [0, S] and return ‖c - x‖², (N,)."""
        point = _RELAXATION * image + (1 - _RELAXATION) * self.x + self.dual
        self.x = np.clip(point, 0, self._max_intensity)
        self.dual = point - self.x
        difference = image - self.x
        return dots(difference, difference)
