"""The objective of ADMM, split into terms, and the penalties that keep their residuals alike.

All arrays are those of a stack of images, which do not affect each other.
"""

import functools
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.estimators.iterative.admm_terms import BoxTerm, DataTerm, SplittingTerm, VariationTerm
from jotlight.estimators.iterative.linear_solver import NormalEquations
from jotlight.sensing.data.stacks import dots, each_image, image_means, select
from jotlight.sensing.likelihood.operators import Scaling
from jotlight.sensing.likelihood.problem import Problem

INITIAL_PENALTY = 6.0
"""The initial penalty of the differences, in units of the weight over the mean intensity."""

_JOT_PENALTY = 3.0
"""The initial penalty of the light in units of the information, where the cells are jots."""

BALANCE_INTERVAL = 10
"""Iterations between two adjustments of the penalties."""

BALANCE = 0.1
"""The weight of the dual residual: the run ends at a primal one of tol and a dual one of 10 tol."""

_BALANCE_DAMPING = 0.8
"""The factor by which each adjustment of the penalties weakens the next, so that they end."""

_DARK = 1e-3
"""The minimum intensity that the primal residual is relative to, as a fraction of the scale of an
image."""

_MIN_FORCE = 0.1
"""The minimum force that the dual residual is relative to, as a fraction of the stiffness."""

_CG_TOLERANCE = 1e-6
"""The relative residual of the linear step, unless 0.01 `tol` is smaller."""


class Splitting:
    """The images of a stack that are not finished, and the terms of their objectives.

    Parameters
    ----------
    problem : Problem
        The likelihood of the light, and the operator A.
    weight : float or ndarray of float64
        λ: a number, or a map of the shape of the images.
    norm : {"isotropic", "anisotropic"}
        The norm of the differences.
    start : ndarray of float64, optional
        The first images. Default: constant ones.
    tol : float
        The tolerance of the residuals, which that of the linear step follows.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """

    def __init__(
        self,
        problem: Problem,
        weight: float | Array,
        norm: str,
        start: Array | None,
        tol: float,
        threads: int | None,
    ) -> None:
        self._operator, self._max_intensity = problem.operator, problem.max_intensity
        level, self._scale = problem.constant_estimates(), problem.intensity_scales()
        image = start
        if image is None:
            image = np.empty((len(level), *self._operator.input_shape))
            image[:] = each_image(level, image)
        self._image = image
        self._exponent = np.ones(len(image))
        """The power of the next adjustment of the penalties, (N,)."""
        self._equations = NormalEquations(self._operator, min(_CG_TOLERANCE, 0.01 * tol), threads)
        gain, information = self._equations.gain, _mean_information(problem, level)
        # The information approximates the stiffness of the likelihood, which scales the penalties.
        self._stiffness = information * gain**2
        mean_weight = image_means(weight) if isinstance(weight, np.ndarray) else weight
        smoothness = np.maximum(INITIAL_PENALTY * mean_weight / level, 1e-2 * self._stiffness)
        are_pixels = isinstance(self._operator, Scaling)
        penalty = information if are_pixels else _JOT_PENALTY * information
        variation = VariationTerm(weight, norm, smoothness, image, threads)
        self._data = DataTerm(problem, penalty, gain, image)
        self._terms: list[SplittingTerm] = [self._data, variation]
        if not are_pixels:
            self._terms.append(BoxTerm(self._max_intensity, 0.1 * self._stiffness, image))

    @property
    def max_light(self) -> float:
        """The largest light of a cell at the intensity S."""
        return self._data.max_light

    def step(self) -> tuple[Array, Array]:
        """Update the images and all terms. Return the relative primal and dual residuals, (N,)."""
        right = _sum(term.right_hand_side() for term in self._terms)
        penalties = [term.penalty for term in self._terms]
        image = self._image = self._equations.solve(right, penalties, self._image)
        distances, changes = zip(*(term.update(image) for term in self._terms), strict=True)
        size, change = dots(image, image), _sum(changes)
        # Dark images have a small norm, so it is bounded from below.
        dark = _DARK * self._scale
        primal = _relative(_sum(distances), size + image[0].size * dark**2)
        # Without a prior the multipliers vanish, and the stiffness of the likelihood is the scale.
        min_force = _MIN_FORCE * self._stiffness
        forces = _sum(term.squared_force() for term in self._terms) + min_force**2 * size
        return primal, _relative(dots(change, change), forces)

    def estimates(self) -> Array:
        """Return the images in [0, S], (N, H, W)."""
        if isinstance(self._operator, Scaling):
            return np.clip(self._data.x / self._operator.factor, 0, self._max_intensity)
        return self._terms[-1].x

    def select(self, images: npt.NDArray[np.bool_]) -> None:
        """Keep only the images of a mask (N,)."""
        self._image, self._scale, self._stiffness, self._exponent = (
            select(each, images)
            for each in (self._image, self._scale, self._stiffness, self._exponent)
        )
        for term in self._terms:
            term.select(images)

    def balance(self, iteration: int, primal: Array, dual: Array) -> None:
        """Adjust the penalties where one residual is much larger, in every 10th iteration."""
        if iteration % BALANCE_INTERVAL:
            return
        known = (primal > 0) & (dual > 0)
        factor = np.sqrt(np.where(known, primal, 1) / np.where(known, BALANCE * dual, 1))
        unbalanced = known & ~((factor > 0.5) & (factor < 2))
        if unbalanced.any():
            change = np.clip(factor, 0.25, 4.0) ** self._exponent
            for term in self._terms:
                term.rescale(np.where(unbalanced, change, 1.0))
        self._exponent = np.where(unbalanced, self._exponent * _BALANCE_DAMPING, self._exponent)


def _mean_information(problem: Problem, level: Array) -> Array:
    """Return the mean Fisher information of a cell about its light, at constant intensities."""
    light_of_ones = problem.operator.forward(np.ones(problem.operator.input_shape))
    light = each_image(level, problem.likelihood.ones) * light_of_ones
    information = image_means(problem.likelihood.information(light))
    # Near saturation the information vanishes, so it is bounded from below.
    trials = np.broadcast_to(problem.likelihood.trials, light.shape)
    return np.maximum(information, 1e-9 * image_means(trials) / image_means(light) ** 2)


def _relative(norm_squared: Array, scale_squared: Array) -> Array:
    known = scale_squared > 0
    ratio = np.sqrt(norm_squared / np.where(known, scale_squared, 1))
    return np.where(known, ratio, norm_squared > 0)


def _sum(arrays: Iterable[Array]) -> Array:
    return functools.reduce(np.add, arrays)
