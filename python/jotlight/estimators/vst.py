"""Variance stabilization of counts: equations (6) and (7), and the exact unbiased inverse.

After :func:`anscombe` the noise of a count is close to normal with standard deviation
:data:`NOISE` at any intensity. Any denoiser for white Gaussian noise then applies.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine

NOISE = 0.5
"""The standard deviation of the noise after :func:`anscombe`."""

INVERSES = ("exact", "algebraic")
"""The names of the inverses in :func:`inverse_anscombe`."""


def anscombe(
    counts: npt.ArrayLike, trials: int, *, threads: int | None = None
) -> npt.NDArray[np.float32]:
    """Return the stabilized counts T(L), where L of K bits are 1: equation (6).

    Parameters
    ----------
    counts : array_like, any shape
        L in [0, K].
    trials : int
        K.
    threads : int, optional
        The number of threads. Default: all cores.

    Returns
    -------
    ndarray of float32
        T, of the same shape.

    Raises
    ------
    ValueError
        For counts outside of [0, K].

    Examples
    --------
    >>> anscombe([0, 8, 16], 16).round(2)
    array([0.61, 3.19, 5.77], dtype=float32)
    """
    values = np.asarray(counts, np.float32)
    if values.size and not (values.min() >= 0 and values.max() <= trials):
        raise ValueError(f"counts: expected 0 to {trials}, got {values.min()} to {values.max()}")
    return _apply(engine.anscombe, values, trials, threads)


def inverse_anscombe(
    z: npt.ArrayLike,
    trials: int,
    *,
    inverse: str = "exact",
    threads: int | None = None,
) -> npt.NDArray[np.float32]:
    """Return the counts in [0, K] of denoised values z: the inverse of :func:`anscombe`.

    Parameters
    ----------
    z : array_like, any shape
        Denoised results of :func:`anscombe`.
    trials : int
        K.
    inverse : {"exact", "algebraic"}
        The exact unbiased inverse maps E[T(L)], L ~ Binomial(K, p), back to K p. The algebraic
        inverse is equation (7), the inverse function of T. It is biased where K is small.
    threads : int, optional
        The number of threads. Default: all cores.

    Returns
    -------
    ndarray of float32
        Counts in [0, K], of the same shape.

    Raises
    ------
    ValueError
        For an unknown inverse, and for NaN.

    Notes
    -----
    Makitalo and Foi (2011) define the exact inverse for Poisson counts. This is the same definition
    for binomial counts.

    Unlike in the paper, the result of equation (7) is clipped to [0, K].

    Examples
    --------
    >>> inverse_anscombe(anscombe([0, 8, 16], 16), 16, inverse="algebraic").round(3).tolist()
    [0.0, 8.0, 16.0]
    """
    if inverse not in INVERSES:
        raise ValueError(f"inverse: expected one of {', '.join(INVERSES)}, got {inverse!r}")
    values = np.asarray(z, np.float32)
    if np.isnan(values).any():
        raise ValueError("z: expected numbers, got NaN")
    function = (
        engine.inverse_anscombe_exact if inverse == "exact" else engine.inverse_anscombe_algebraic
    )
    return _apply(function, values, trials, threads)


def _apply(
    function: Callable[..., None],
    values: npt.NDArray[np.float32],
    trials: int,
    threads: int | None,
) -> npt.NDArray[np.float32]:
    out = np.empty(values.shape, np.float32)
    function(values.reshape(-1), trials, out.reshape(-1), threads)
    return out
