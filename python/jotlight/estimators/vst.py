"""Variance stabilization of counts: equations (6) and (7), and the exact unbiased inverse.

After :func:`anscombe` the noise of a count is close to normal with standard deviation
:data:`NOISE`, unless nearly all bits are equal, or K is below 4. Any denoiser for white
Gaussian noise then applies.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.checks import check_threads, to_array
from jotlight.parameter_names import check_choice
from jotlight.sensing.bits.values import flatten, number_or_map, numbers_from_zero

__all__ = ["INVERSES", "NOISE", "anscombe", "inverse_anscombe"]


def __dir__() -> list[str]:
    return __all__


NOISE = 0.5
"""The standard deviation of the noise after :func:`anscombe`.

It is smaller where nearly all bits are 0 or nearly all are 1. At K = 16, it is 0.48 where 12 % of
the bits are 1, and 0.34 where 3 % are. For K below 4, it is smaller everywhere: where half of the
bits are 1, it is 0.37 for K = 1, 0.46 for K = 2, and 0.49 for K = 3.
"""

INVERSES = ("exact", "algebraic")
"""The names of the inverses in :func:`inverse_anscombe`."""

_MAX_LEVELS = 32
"""The maximum number of values of K in a map for which each has a table of its own."""

_LEVELS_PER_OCTAVE = 4
"""The number of tables per doubling of K for other maps. The error is below 10⁻⁴ K."""

_SMALL_LEVELS = 8
"""Each whole K up to this one has a table of its own, because their inverses differ most."""

_MIN_TRIALS = 1e-3
"""The smallest K whose range of T is divided by its width, which is 0 for no trials."""


def anscombe(
    counts: npt.ArrayLike, trials: npt.ArrayLike, *, threads: int | None = None
) -> npt.NDArray[np.float32]:
    """Return the stabilized counts T(L), where L of K bits are 1: equation (6).

    Parameters
    ----------
    counts : array_like, any shape
        L in [0, K].
    trials : float or array_like of float
        K, 0 or more: a number, or a map of the shape of the counts.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float32
        T, of the same shape.

    Raises
    ------
    ValueError
        For counts outside of [0, K], and for trials that are not numbers or of another shape.

    Examples
    --------
    >>> anscombe([0, 8, 16], 16).round(2)
    array([0.61, 3.19, 5.77], dtype=float32)
    """
    values = np.asarray(to_array("counts", counts), np.float32)
    checked = number_or_map("trials", numbers_from_zero("trials", trials), values.shape)
    if values.size and not (values.min() >= 0 and _is_at_most(values, checked)):
        raise ValueError(
            f"counts: expected 0 to the number of trials, got {values.min()} to {values.max()} "
            f"with up to {np.max(checked):g} trials"
        )
    return _apply(engine.anscombe, values, checked, threads)


def inverse_anscombe(
    z: npt.ArrayLike,
    trials: npt.ArrayLike,
    *,
    inverse: str = "exact",
    threads: int | None = None,
) -> npt.NDArray[np.float32]:
    """Return the counts in [0, K] of denoised values z: the inverse of :func:`anscombe`.

    Parameters
    ----------
    z : array_like, any shape
        Denoised results of :func:`anscombe`.
    trials : float or array_like of float
        K, 0 or more: a number, or a map of the shape of z.
    inverse : {"exact", "algebraic"}
        The exact unbiased inverse maps E[T(L)], L ~ Binomial(K, p), back to K p. The algebraic
        inverse is equation (7), the inverse function of T. It is biased where K is small.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float32
        Counts in [0, K], of the same shape.

    Raises
    ------
    ValueError
        For an unknown inverse, for NaN, and for trials that are not numbers or of another shape.

    Notes
    -----
    Makitalo and Foi (2011) define the exact inverse for Poisson counts. This is the same definition
    for binomial counts. Where K is not whole, or a map has many values, the exact inverse is
    interpolated between those of whole numbers.

    Unlike in the paper, the result of equation (7) is clipped to [0, K].

    Examples
    --------
    >>> inverse_anscombe(anscombe([0, 8, 16], 16), 16, inverse="algebraic").round(3).tolist()
    [0.0, 8.0, 16.0]
    """
    check_choice("inverse", inverse, INVERSES)
    values = np.asarray(to_array("z", z), np.float32)
    if np.isnan(values).any():
        raise ValueError("z: expected numbers, got NaN")
    checked = number_or_map("trials", numbers_from_zero("trials", trials), values.shape)
    if inverse == "algebraic":
        return _apply(engine.inverse_anscombe_algebraic, values, checked, threads)
    if not isinstance(checked, np.ndarray) and checked >= 1 and checked == int(checked):
        return _apply(engine.inverse_anscombe_exact, values, int(checked), threads)
    return _invert_exactly(values, np.broadcast_to(checked, values.shape), threads)


def _invert_exactly(
    values: npt.NDArray[np.float32], trials: npt.NDArray[np.float64], threads: int | None
) -> npt.NDArray[np.float32]:
    """Return the exact inverse, interpolated in 1/√K between levels of K.

    It is interpolated at the same position in [T(0), T(K)], where the inverses have their kinks.
    """
    levels = _exact_levels(trials)
    roots = 1 / np.sqrt(np.maximum(trials, 1))
    places = np.interp(-roots, -1 / np.sqrt(levels), np.arange(len(levels)))
    low, width = _angles(np.maximum(trials, _MIN_TRIALS))
    positions = (values / np.sqrt(trials + 0.5) - low) / width
    fraction = np.zeros(values.shape)
    for index, level in enumerate(levels):
        weight = 1 - abs(places - index)
        near = weight > 0
        if near.any():
            low, width = _angles(level)
            z = np.asarray((low + width * positions[near]) * np.sqrt(level + 0.5), np.float32)
            counts = _apply(engine.inverse_anscombe_exact, z, int(level), threads)
            fraction[near] += weight[near] * counts / level
    return np.asarray(fraction * trials, np.float32)


def _angles(trials: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], ...]:
    """Return the angle of T(0), which is T/√(K + 1/2), and the angle from there to T(K)."""
    low = np.arcsin(np.sqrt(0.375 / (trials + 0.75)))
    return low, np.pi / 2 - 2 * low


def _exact_levels(trials: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return whole numbers: those of a map with few values, or enough to interpolate between."""
    values = np.unique(np.maximum(trials, 1))
    if len(values) <= _MAX_LEVELS and (values == np.floor(values)).all():
        return values
    low, high = np.floor(values[0]), np.ceil(values[-1])
    small = np.arange(low, min(high, _SMALL_LEVELS) + 1)
    low = max(low, _SMALL_LEVELS)
    if high <= low:
        return small
    steps = math.ceil(math.log2(high / low) * _LEVELS_PER_OCTAVE)
    large = np.round(low * (high / low) ** np.linspace(0, 1, steps + 1))
    return np.unique(np.concatenate([small, large]))


def _is_at_most(values: npt.NDArray[np.float32], trials: float | npt.NDArray[np.float64]) -> bool:
    """Return whether no count exceeds its trials, up to the rounding to float32."""
    if isinstance(trials, np.ndarray):
        return bool((values <= trials.astype(np.float32)).all())
    return bool(values.max() <= np.float32(trials))


def _apply(
    function: Callable[..., None],
    values: npt.NDArray[np.float32],
    trials: float | npt.NDArray[np.float64],
    threads: int | None,
) -> npt.NDArray[np.float32]:
    check_threads(threads)
    out = np.empty(values.shape, np.float32)
    function(values.reshape(-1), flatten(trials), out.reshape(-1), threads)
    return out
