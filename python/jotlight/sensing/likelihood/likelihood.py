"""The likelihood of bits, for any threshold."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.arrays import HasReadOnlyArrays, frozen
from jotlight.checks import check_threads, to_array, type_of, whole_number_in_range
from jotlight.errors import plural
from jotlight.sensing.bits.values import (
    as_doubles,
    checked_trials,
    extent,
    flatten,
    number_or_map,
    numbers_from_zero,
    numbers_of_ones,
)
from jotlight.sensing.data.stacks import select


class Likelihood(HasReadOnlyArrays):
    """ℓ(s) = Σ L log P(q, η s + d) + (n - L) log(1 - P(q, η s + d)), a function of the light s.

    A cell is a jot, or a pixel whose jots all receive the same light. The light of a cell is its
    expected number of photons per bit.

    Parameters
    ----------
    ones : array_like of int, any shape
        L: the number of ones of each cell.
    trials : float or array_like of float
        n: the number of bits of each cell, a number or a map, 0 or more; 0 for a dead cell. It may
        be a real number, such as a mean.
    threshold : int
        q: the minimum number of photons for which a bit is 1.
    efficiency : float or array_like of float
        η in (0, 1]: the fraction of each cell's light that is detected, a number or a map.
    dark_counts : float or array_like of float
        d: the expected detections of each cell per bit without light, a number or a map.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Raises
    ------
    TypeError, ValueError
        When the arrays do not fit together, or a number of ones is below 0 or above n.

    Notes
    -----
    Paper, equation (4). ℓ is concave. The logarithms and derivatives are accurate to eleven digits
    for η s from 1e-12 to 1e4, and to nine digits for q above 10,000. At η s + d = 0 the value is
    -inf if a bit is 1.

    Examples
    --------
    >>> likelihood = jl.Likelihood([3, 0], trials=4)
    >>> round(likelihood.value([1.0, 0.5]), 6)  # 3 log(1 - 1/e) - 1 - 4/2
    -4.376025
    >>> gradient, curvature = likelihood.gradient_and_curvature([1.0, 0.5])
    >>> gradient.round(6).tolist(), curvature.round(6).tolist()
    ([0.74593, -4.0], [2.762021, 0.0])
    """

    def __init__(
        self,
        ones: npt.ArrayLike,
        trials: float | npt.ArrayLike = 1,
        *,
        threshold: int = 1,
        efficiency: float | npt.ArrayLike = 1.0,
        dark_counts: float | npt.ArrayLike = 0.0,
        threads: int | None = None,
    ) -> None:
        self.ones = frozen(numbers_of_ones(ones))
        self.shape = self.ones.shape
        if self.ones.size == 0:
            raise ValueError(f"ones: expected at least one cell, got shape {self.shape}")
        self.trials = _frozen(checked_trials(trials, self.ones))
        dark = numbers_from_zero("dark_counts", dark_counts)
        self.dark_counts = _frozen(number_or_map("dark_counts", dark, self.shape))
        fraction = to_array("efficiency", efficiency)
        if fraction.dtype.kind not in "iuf" or not ((fraction > 0) & (fraction <= 1)).all():
            raise ValueError(f"efficiency: expected numbers in (0, 1], got {efficiency!r}")
        self.efficiency = _frozen(number_or_map("efficiency", as_doubles(fraction), self.shape))
        self.threshold = whole_number_in_range("threshold", threshold, 1, 65535)
        check_threads(threads)
        self._threads = threads

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.shape)) or "1"
        size = f"{size} {plural(self.ones.size, 'cell')}"
        trials = f"{extent(self.trials)} {plural(float(np.max(self.trials)), 'trial')}"
        return f"<Likelihood: {size}, {trials}, threshold {self.threshold}>"

    @property
    def threads(self) -> int | None:
        """The number of threads, or None for the number of cores."""
        return self._threads

    def value(self, light: npt.ArrayLike) -> float:
        """Return ℓ(s) in nats, summed over all cells.

        `light` is a number or an array of the cells' shape, 0 or more, here and in other methods.
        Others raise TypeError or ValueError.
        """
        flat = self._light(light).reshape(1, -1)
        return engine.log_likelihood(self.engine_argument(), flat, self._threads)[0]

    def values(self, light: npt.ArrayLike) -> Array:
        """Return ℓ(s) of each image of a stack, (N,), whose cells have the shape (N, ...).

        Raises
        ------
        ValueError
            When there is a single cell.

        Examples
        --------
        >>> jl.Likelihood([[1, 0], [2, 2]], trials=4).values(0.1).round(3).tolist()
        [-3.052, -9.809]
        """
        if not self.shape:
            raise ValueError("ones: expected cells of a stack, (N, ...), got a single cell")
        each = self._light(light).reshape(self.shape[0], -1)
        return np.array(engine.log_likelihood(self.engine_argument(), each, self._threads))

    def stacked(self) -> Likelihood:
        """Return the likelihood of a stack of this one image, (1, ...)."""
        return self._with_cells(lambda cells: cells[None])

    def select(self, images: npt.NDArray[np.bool_]) -> Likelihood:
        """Return the likelihood of the images of a stack that a mask (N,) marks."""
        return self._with_cells(lambda cells: select(cells, images))

    def gradient_and_curvature(self, light: npt.ArrayLike) -> tuple[Array, Array]:
        """Return the gradient ∂ℓ/∂s and the curvature -∂²ℓ/∂s² ≥ 0 of each cell."""
        flat = self._light(light).reshape(-1)
        gradient, curvature = np.empty(flat.size), np.empty(flat.size)
        engine.likelihood_gradient_and_curvature(
            self.engine_argument(), flat, gradient, curvature, self._threads
        )
        return gradient.reshape(self.shape), curvature.reshape(self.shape)

    def information(self, light: npt.ArrayLike) -> Array:
        """Return the Fisher information n (η P')² / (P (1 - P)) of each cell about its light.

        It is the expectation of the curvature. Its inverse is the Cramér-Rao bound: the smallest
        variance of an unbiased estimate.

        Examples
        --------
        >>> jl.Likelihood([1], trials=16).information(1.0).round(4).tolist()  # 16 / (e - 1)
        [9.3116]
        """
        flat = self._light(light).reshape(-1)
        information = np.empty(flat.size)
        engine.likelihood_information(self.engine_argument(), flat, information, self._threads)
        return information.reshape(self.shape)

    def proximal(self, point: npt.ArrayLike, penalty: float, *, max_light: float) -> Array:
        """Return the x in [0, `max_light`] that minimizes -ℓ(x) + ½ `penalty` ‖x - point‖².

        Parameters
        ----------
        point : array_like of float
            The point to stay close to, a number or an array of the cells' shape.
        penalty : float
            The weight of the distance, above 0.
        max_light : float
            The upper bound of x.

        Raises
        ------
        ValueError
            When an argument is out of range or has the wrong shape.

        Examples
        --------
        >>> jl.Likelihood([2], trials=4).proximal([0.5], 1e9, max_light=2.0).round(6).tolist()
        [0.5]
        """
        if not 0 < penalty < np.inf or not 0 < max_light < np.inf:
            raise ValueError(
                "penalty and max_light: expected finite numbers above 0, "
                f"got {penalty} and {max_light}"
            )
        # The search starts at the point, and the engine overwrites its copy with the result.
        start = np.ravel(self._broadcast("point", point))
        if np.isnan(start).any():
            raise ValueError("point: expected numbers, got NaN")
        found = start.copy()
        engine.likelihood_proximal(
            self.engine_argument(), penalty, max_light, start, found, self._threads
        )
        return found.reshape(self.shape)

    def admm_update(
        self, step: tuple[Array, float], max_light: float, light: Array, x: Array, dual: Array
    ) -> Array:
        """Return ‖light - x‖² of each image after a step of ADMM, which updates `x` and `dual`.

        Parameters
        ----------
        step : tuple (array of float64 of shape (N,), float)
            The penalty ρ of each image, and the relaxation, all above 0.
        max_light : float
            The upper bound of `x`, 0 to 1e300. The lower one is 0.
        light : ndarray of float64, shape (N, ...)
            The light of the cells of N images.
        x, dual : ndarray of float64, shape (N, ...), in C order
            The copy of the light that the likelihood determines, and the scaled dual variable.

        Raises
        ------
        ValueError
            When a number is out of range, or an array has another shape.
        """
        cells = (self.shape[0], -1)
        arrays = light.reshape(cells), x.reshape(cells), dual.reshape(cells)
        own = self.engine_argument()
        return np.array(engine.likelihood_admm_update(own, step, max_light, *arrays, self._threads))

    def _with_cells(self, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> Likelihood:
        """Return a copy, with a changed array of cells in each of its maps."""
        other = copy.copy(self)
        for name in ("ones", "trials", "dark_counts", "efficiency"):
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                setattr(other, name, np.ascontiguousarray(change(value)))
        other.shape = other.ones.shape
        return other

    def _light(self, light: npt.ArrayLike) -> Array:
        array = self._broadcast("light", light)
        if not array.min() >= 0:
            raise ValueError(f"light: expected 0 or more, got {array.min()}")
        return array

    def _broadcast(self, name: str, values: npt.ArrayLike) -> Array:
        array = to_array(name, values)
        if array.dtype.kind not in "iuf":
            raise TypeError(f"{name}: expected real numbers, got {type_of(values, array)}")
        if array.shape not in ((), self.shape):
            raise ValueError(
                f"{name}: expected a number, or an array of shape {self.shape}, got {array.shape}"
            )
        return as_doubles(np.broadcast_to(array, self.shape))

    def engine_argument(self) -> tuple[int, Any, Any, Any, Any]:
        """Return (q, L, n, η, d), as the engine expects them."""
        return (
            self.threshold,
            flatten(self.ones),
            flatten(self.trials),
            flatten(self.efficiency),
            flatten(self.dark_counts),
        )


def _frozen(value: float | Array) -> float | Array:
    """Return a number, or a map that the caller cannot change."""
    return frozen(value) if isinstance(value, np.ndarray) else value
