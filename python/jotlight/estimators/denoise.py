"""Denoisers for stabilized counts, whose noise has a standard deviation of 1/2.

:func:`gaussian`, :func:`tv`, :func:`nlm`, and :func:`bm3d` map an image (H, W), or each of a stack
(..., H, W), to float32 of the same shape. The option `channel_axis` names the axis of color
channels. Integers become floats of the same values. The default strengths were chosen on the BSDS
training images at K = 16 (``python benchmarks/studies/denoiser_strengths.py``).
:func:`jotlight.noniterative` also takes a function of your own.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.checks import number_in_range, positive_number, to_array
from jotlight.errors import needs_module
from jotlight.estimators.vst import NOISE
from jotlight.interrupts import interruptible
from jotlight.layout import Layout
from jotlight.parameter_names import check_choice

__all__ = ["DENOISERS", "bm3d", "gaussian", "nlm", "tv"]


def __dir__() -> list[str]:
    return __all__


_MAX_SIGMA = 1000.0
"""Largest standard deviation of a Gaussian in pixels."""

Denoiser = Callable[[Image], npt.ArrayLike]
"""A function from an image (H, W) with white noise of standard deviation 1/2 to a denoised one."""


def _of_each_image(denoise: Callable[..., Image]) -> Callable[..., Image]:
    """Return a denoiser of stacks and colors, which calls `denoise` for each image (H, W).

    Its signature and its docstring include the parameter `channel_axis`.
    """

    @functools.wraps(denoise)
    def denoise_all(
        image: npt.ArrayLike, *args: Any, channel_axis: int | None = None, **kwargs: Any
    ) -> Image:
        values = to_array("image", image)
        if values.dtype.kind not in "biuf":
            raise ValueError(f"image: expected numbers, got {values.dtype}")
        layout = Layout.of("image", values, channel_axis)
        images = layout.split(values).astype(np.float32)
        return layout.arrange(np.stack([denoise(each, *args, **kwargs) for each in images]))

    signature = inspect.signature(denoise)
    kind = inspect.Parameter.KEYWORD_ONLY
    axis = inspect.Parameter("channel_axis", kind, default=None, annotation=int | None)
    parameters = [*signature.parameters.values(), axis]
    denoise_all.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return denoise_all


@_of_each_image
@interruptible
def gaussian(image: Image, sigma: float = 1.5) -> Image:
    """Return the image smoothed by a Gaussian (SciPy).

    Parameters
    ----------
    image : array_like, shape (H, W) or (..., H, W)
        Stabilized counts, or other numbers.
    sigma : float
        The standard deviation in pixels, from 0 to 1000.
    channel_axis : int, optional
        The axis of color channels. Default: none, and axes before the last two are those of a
        stack.

    Examples
    --------
    >>> gaussian(np.eye(3, dtype=np.float32), sigma=5.0).round(2)[0].tolist()
    [0.33000001311302185, 0.33000001311302185, 0.33000001311302185]
    """
    from scipy.ndimage import gaussian_filter

    sigma = number_in_range("sigma", sigma, 0, _MAX_SIGMA)
    return np.asarray(gaussian_filter(image, sigma, mode="reflect"), np.float32)


@_of_each_image
def tv(image: Image, weight: float = 0.45) -> Image:
    """Return the image denoised by total variation, with Chambolle's method (scikit-image).

    Parameters
    ----------
    image : array_like, shape (H, W) or (..., H, W)
        Stabilized counts, or other numbers.
    weight : float
        The strength of the smoothing, above 0.
    channel_axis : int, optional
        The axis of color channels. Default: none, and axes before the last two are those of a
        stack.

    Raises
    ------
    ValueError
        When the strength is not above 0, or `image` is not an image.

    Examples
    --------
    >>> noisy = np.random.default_rng(0).normal(3, NOISE, (32, 32)).astype(np.float32)
    >>> bool(tv(noisy).std() < 0.2 * noisy.std())
    True
    """
    from skimage.restoration import denoise_tv_chambolle

    weight = positive_number("weight", weight)
    # With its usual eps, it may stop after a few iterations, up to 2.8 dB before its solution.
    found = denoise_tv_chambolle(image, weight=weight, eps=0, max_num_iter=200)
    return np.asarray(found, np.float32)


@_of_each_image
@interruptible
def nlm(image: Image, strength: float = 0.7) -> Image:
    """Return the image denoised by non-local means, averages of similar patches (scikit-image).

    Parameters
    ----------
    image : array_like, shape (H, W) or (..., H, W)
        Stabilized counts, or other numbers.
    strength : float
        The filter parameter h in units of the noise's standard deviation, above 0.
    channel_axis : int, optional
        The axis of color channels. Default: none, and axes before the last two are those of a
        stack.

    Raises
    ------
    ValueError
        When the strength is not above 0, or `image` is not an image.

    Examples
    --------
    >>> noisy = np.random.default_rng(0).normal(3, NOISE, (32, 32)).astype(np.float32)
    >>> bool(nlm(noisy).std() < 0.5 * noisy.std())
    True
    """
    from skimage.restoration import denoise_nl_means

    strength = positive_number("strength", strength)
    denoised = denoise_nl_means(
        image,
        patch_size=5,
        patch_distance=6,
        h=strength * NOISE,
        sigma=NOISE,
        fast_mode=True,
    )
    # scikit-image drops dimensions of size 1.
    return np.asarray(denoised, np.float32).reshape(image.shape)


@_of_each_image
@interruptible
def bm3d(image: Image) -> Image:
    """Return the image denoised by block matching and 3D filtering, with its authors' package.

    Parameters
    ----------
    image : array_like, shape (H, W) or (..., H, W)
        Stabilized counts, or other numbers.
    channel_axis : int, optional
        The axis of color channels. Default: none, and axes before the last two are those of a
        stack.

    Raises
    ------
    MissingExtraError
        When the package is not installed. Its license permits non-commercial use only.
    """
    with needs_module(
        "bm3d",
        "the denoiser 'bm3d' needs its authors' package: pip install 'jotlight[bm3d]'. "
        "Its license permits non-commercial use only; 'tv' and 'nlm' need no extra package",
    ):
        from bm3d import bm3d as authors_bm3d
    # The package refuses images smaller than its blocks of 8 x 8, and crashes on 8 x 8 itself.
    height, width = image.shape
    padded = np.pad(image, ((0, max(0, 16 - height)), (0, max(0, 16 - width))), mode="symmetric")
    denoised = authors_bm3d(padded, sigma_psd=NOISE)
    return np.asarray(denoised[:height, :width], np.float32)


DENOISERS: dict[str, Callable[[Image], Image]] = {
    "gaussian": gaussian,
    "tv": tv,
    "nlm": nlm,
    "bm3d": bm3d,
}
"""The denoisers by their names. The method of a name is in `jotlight.evaluation.methods`."""


def resolve_denoiser(denoiser: str | Denoiser) -> Denoiser:
    """Return the denoiser of a name, or the callable itself.

    Raises
    ------
    ValueError, TypeError
        For an unknown name, and for an object that is not callable.

    Examples
    --------
    >>> resolve_denoiser("nlm") is nlm
    True
    """
    if isinstance(denoiser, str):
        check_choice("denoiser", denoiser, DENOISERS, " or a callable")
        return DENOISERS[denoiser]
    if not callable(denoiser):
        raise TypeError(f"denoiser: expected a name or a callable, got {denoiser!r}")
    return denoiser
