"""Measures of how close an estimate is to the truth.

:func:`psnr` and :func:`snr` return ratios in dB, and :func:`ssim` the structural similarity.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from jotlight.checks import positive_number, refuse_masked, require_intensities, to_array
from jotlight.errors import warn
from jotlight.interrupts import interruptible
from jotlight.layout import Layout
from jotlight.sensing.parameters.intensity_scale import gray_levels

__all__ = ["WINDOW", "psnr", "snr", "ssim"]


def __dir__() -> list[str]:
    return __all__


WINDOW = 11
"""Side of the window of SSIM, in pixels."""


def psnr(
    estimate: npt.ArrayLike, truth: npt.ArrayLike, *, data_range: float | None = None
) -> float:
    """Return the peak signal-to-noise ratio in dB, 10 log10(R² / mean((ĉ - c)²)).

    It is infinite for equal images.

    Parameters
    ----------
    estimate, truth : array_like of float, shape (H, W) or with more axes
        ĉ and c, images of the same shape.
    data_range : float, optional
        R: the largest possible intensity, above 0. Default: 1.

    Raises
    ------
    TypeError, ValueError
        When the images are not plain arrays of floats, are empty, or have different shapes, or the
        range is not a finite number above 0.

    Warns
    -----
    JotlightWarning
        When the range is not stated, and the true image looks like gray levels of 8 or 16 bits.

    Examples
    --------
    >>> round(psnr([[0.5]], [[0.6]]), 9)
    20.0
    """
    a, b = _pair(estimate, truth)
    peak = _checked_range(data_range, b)
    return _decibel(peak**2, np.mean((a - b) ** 2))


def snr(estimate: npt.ArrayLike, truth: npt.ArrayLike) -> float:
    """Return the signal-to-noise ratio in dB, 10 log10(‖c‖² / ‖ĉ - c‖²).

    It is infinite for equal images.

    Parameters
    ----------
    estimate, truth : array_like of float, shape (H, W) or with more axes
        ĉ and c, images of the same shape.

    Raises
    ------
    TypeError, ValueError
        When the images are not plain arrays of floats, are empty, or have different shapes.

    Examples
    --------
    >>> round(snr([[0.9, 1.1]], [[1.0, 1.0]]), 9)
    20.0
    """
    a, b = _pair(estimate, truth)
    return _decibel(np.sum(b**2), np.sum((a - b) ** 2))


def ssim(
    estimate: npt.ArrayLike,
    truth: npt.ArrayLike,
    *,
    data_range: float | None = None,
    channel_axis: int | None = None,
) -> float:
    """Return the structural similarity of Wang et al. (2004), at most 1.

    The window and the constants are those of the authors: a Gaussian of standard deviation 1.5,
    truncated to 11 x 11 pixels, and K1 = 0.01 and K2 = 0.03. The covariance is the biased estimate.
    scikit-image computes the index. For stacks and color images, the result is the mean over all
    images and channels.

    Parameters
    ----------
    estimate, truth : array_like of float, shape (..., H, W)
        ĉ and c, images of the same shape, with at least 11 x 11 pixels.
    data_range : float, optional
        R: the largest possible intensity, above 0. Default: 1.
    channel_axis : int, optional
        The axis of color channels. Default: none.

    Raises
    ------
    TypeError, ValueError
        When the images are not plain arrays of floats, are too small, have different shapes, or
        look like color without a channel axis, or the range is not a finite number above 0.

    Warns
    -----
    JotlightWarning
        When the range is not stated, and the true image looks like gray levels of 8 or 16 bits.

    Examples
    --------
    >>> image = np.linspace(0, 1, 256).reshape(16, 16)
    >>> ssim(image, image)
    1.0
    """
    from skimage.metrics import structural_similarity

    a, b = _pair(estimate, truth)
    peak = _checked_range(data_range, b)
    layout = Layout.of("estimate", a, channel_axis)
    a, b = layout.split(a), layout.split(b)
    if min(a.shape[1:]) < WINDOW:
        raise ValueError(f"ssim: expected at least {WINDOW} x {WINDOW} pixels, got {a.shape[1:]}")
    of_each = [
        interruptible(structural_similarity)(
            *pair,
            data_range=peak,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
        )
        for pair in zip(a, b, strict=True)
    ]
    return float(np.mean(of_each))


def ssim_or_none(
    estimate: npt.NDArray[np.floating],
    truth: npt.NDArray[np.floating],
    channel_axis: int | None,
) -> float | None:
    """Return the structural similarity, or None for images smaller than its window.

    Examples
    --------
    >>> ssim_or_none(np.ones((16, 16, 3)), np.ones((16, 16, 3)), -1)
    1.0
    >>> ssim_or_none(np.ones((10, 16)), np.ones((10, 16)), None)
    """
    if min(Layout(channel_axis=channel_axis).moved(truth).shape[-2:]) < WINDOW:
        return None
    return ssim(estimate, truth, data_range=1.0, channel_axis=channel_axis)


def _checked_range(data_range: float | None, truth: npt.NDArray[np.float64]) -> float:
    """Return the range R. Warn about gray levels if it is not stated."""
    if data_range is not None:
        return positive_number("data_range", data_range)
    found = gray_levels([truth], 1.0)
    if found is not None:
        warn(
            f"data_range: the largest possible intensity is 1 by default, but truth has values up "
            f"to {found.highest:.4g}; pass data_range={found.level} for gray levels, or 1.0"
        )
    return 1.0


def _pair(
    estimate: npt.ArrayLike, truth: npt.ArrayLike
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    pair: list[npt.NDArray[np.float64]] = []
    for name, image in (("estimate", estimate), ("truth", truth)):
        advice = "pass the data of a part without masked pixels, such as image.data[:64, :64]"
        refuse_masked(name, image, advice)
        array = to_array(name, image)
        require_intensities(name, array)
        if array.ndim < 2 or array.size == 0:
            raise ValueError(f"{name}: expected shape (H, W) or more axes, got {array.shape}")
        pair.append(array.astype(np.float64))
    if pair[0].shape != pair[1].shape:
        raise ValueError(
            f"estimate and truth: expected the same shape, got {pair[0].shape} and {pair[1].shape}"
        )
    return pair[0], pair[1]


def _decibel(signal: np.floating | float, noise: np.floating | float) -> float:
    if noise == 0:
        return float("inf")
    return float(10 * np.log10(signal / noise)) if signal > 0 else float("-inf")
