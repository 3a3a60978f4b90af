"""Descent directions of -ℓ for the images of a stack: the gradient, and Newton's direction."""

import copy
from collections.abc import Callable

import numpy as np

from jotlight.array_types import Array, Mask
from jotlight.sensing.data.stacks import are_all, dots, each_image, replace, select
from jotlight.sensing.likelihood.problem import Problem

_MAX_CG_STEPS = 30
"""The maximum number of steps of conjugate gradients in Newton's method."""

_CG_TOLERANCE = 0.3
"""The relative residual at which Newton's equations count as solved. Smaller is not faster."""

_MIN_CURVATURE = 1e-4
"""The fraction of its upper bound below which a direction's curvature is a rounding error."""


class QuadraticModel:
    """The gradient of -ℓ at the images of a stack, the Hessian AᵀWA, and its diagonal bound."""

    def __init__(self, problem: Problem, light: Array, light_of_ones: Array) -> None:
        gradient, self.curvature = problem.likelihood.gradient_and_curvature(light)
        self.max_intensity = problem.max_intensity
        self.operator = problem.operator
        self.gradient = -self.operator.adjoint(gradient)
        # AᵀWA ≤ diag(AᵀWA 1), since A has no negative entries.
        self.bound = self.operator.adjoint(self.curvature * light_of_ones)

    def select(self, images: Mask) -> "QuadraticModel":
        """Return the model of the images of a mask (N,)."""
        if are_all(images):
            return self
        model = copy.copy(self)
        for name in ("curvature", "gradient", "bound"):
            setattr(model, name, getattr(self, name)[images])
        return model

    def scaled_gradient(self) -> Array:
        """Return the gradient divided by the bound of the Hessian, and clipped to [-S, S]."""
        # Without curvature the quotient is infinite, and clipping turns it into a step of length S.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            step = self.gradient / self.bound
        return np.clip(np.nan_to_num(step, nan=0.0), -self.max_intensity, self.max_intensity)

    def hessian_product(self, direction: Array) -> Array:
        """Return AᵀWA `direction`."""
        return self.operator.normal(self.curvature, direction)


Direction = Callable[[QuadraticModel, Mask], Array]
"""A function that returns descent directions of -ℓ for a model and the mask of free pixels."""


def gradient_direction(model: QuadraticModel, free: Mask) -> Array:
    """Return the negative gradient, scaled by the bound of the Hessian."""
    return -model.scaled_gradient()


def _newton_direction(model: QuadraticModel, free: Mask) -> Array:
    """Return the solutions of Newton's equations on the free pixels, by conjugate gradients.

    They stop at a direction without curvature, which scipy.sparse.linalg.cg does not detect.
    """
    descent = -model.scaled_gradient()
    solution = np.zeros_like(descent)
    # The other arrays are those of the images that go on.
    going = np.ones(len(descent), np.bool_)
    residual = np.where(free, -model.gradient, 0.0)
    inverse = np.where(free & (model.bound > 0), 1 / np.maximum(model.bound, 1e-300), 0.0)
    search = preconditioned = inverse * residual
    norm = first_norm = dots(residual, preconditioned)
    part, free_part = model, free
    for _ in range(_MAX_CG_STEPS):
        unfinished = norm > _CG_TOLERANCE**2 * first_norm
        if not unfinished.any():
            break
        product = np.where(free_part, part.hessian_product(search), 0.0)
        curvature = dots(search, product)
        unfinished &= curvature > _MIN_CURVATURE * dots(search, part.bound * search)
        if not unfinished.any():
            break
        if not unfinished.all():
            going[going] = unfinished
            part, free_part = part.select(unfinished), free_part[unfinished]
            residual, inverse, search, product, norm, first_norm, curvature = (
                each[unfinished]
                for each in (residual, inverse, search, product, norm, first_norm, curvature)
            )
        step = norm / curvature
        solution = replace(
            solution, going, select(solution, going) + each_image(step, search) * search
        )
        residual = residual - each_image(step, search) * product
        preconditioned = inverse * residual
        norm, previous_norm = dots(residual, preconditioned), norm
        search = preconditioned + each_image(norm / previous_norm, search) * search
    # If even the first direction has no curvature, the step follows the gradient.
    has_solution = np.any(solution.reshape(len(solution), -1) != 0, axis=1)
    return np.where(free & each_image(has_solution, free), solution, descent)


SOLVERS: dict[str, Direction] = {"newton": _newton_direction, "gradient": gradient_direction}
"""The descent directions by the name of the solver."""
