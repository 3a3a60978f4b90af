"""Variance stabilisation of counts: equations (6) and (7), and the exact unbiased inverse.

After :func:`stabilise` the noise of a count is close to normal with standard deviation
:data:`NOISE`, whatever the light, so that any denoiser for white Gaussian noise can be used.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.chunks import pixel_chunks

NOISE = 0.5
"""Standard deviation of the noise after :func:`stabilise`."""

INVERSES = ("exact", "algebraic")
"""The inverses of :func:`invert`."""


def anscombe(
    counts: npt.ArrayLike, bits_per_pixel: int, *, threads: int | None = None
) -> npt.NDArray[np.float32]:
    """T of counts out of K bits: equation (6).

    Parameters
    ----------
    counts : array_like, any shape
        In [0, K].
    bits_per_pixel : int
        K.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    ndarray of float32
        Of the same shape.

    Examples
    --------
    >>> anscombe([0, 8, 16], 16).round(2)
    array([0.61, 3.19, 5.77], dtype=float32)
    """
    values = np.asarray(counts, np.float32)
    if values.size and not (values.min() >= 0 and values.max() <= bits_per_pixel):
        raise ValueError(
            f"counts: expected 0 to {bits_per_pixel}, got {values.min()} to {values.max()}"
        )
    return _apply(engine.anscombe, values, bits_per_pixel, threads)


def inverse_anscombe(
    z: npt.ArrayLike,
    bits_per_pixel: int,
    *,
    inverse: str = "exact",
    threads: int | None = None,
) -> npt.NDArray[np.float32]:
    """Counts in [0, K] for denoised values z.

    Parameters
    ----------
    z : array_like, any shape
        What :func:`stabilise` gave, after denoising.
    bits_per_pixel : int
        K.
    inverse : {"exact", "algebraic"}
        The exact unbiased inverse maps E[T(L)], L ~ Binomial(K, p), back to K p. The algebraic one
        is equation (7), the inverse function of T; it is biased where K is small.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    ndarray of float32
        Of the same shape.

    Notes
    -----
    The exact inverse is that of Makitalo and Foi (2011), there for Poisson counts, by the same
    definition for binomial ones.

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
    return _apply(function, values, bits_per_pixel, threads)


def _apply(
    function: Callable[..., None],
    values: npt.NDArray[np.float32],
    bits_per_pixel: int,
    threads: int | None,
) -> npt.NDArray[np.float32]:
    out = np.empty(values.shape, np.float32)
    flat, result = values.reshape(-1), out.reshape(-1)
    # Larger parts than elsewhere: the exact inverse makes its table anew for each.
    for part in pixel_chunks(flat.size, 1 << 22):
        function(flat[part], bits_per_pixel, result[part], threads)
    return out
