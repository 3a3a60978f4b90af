"""Denoisers for the stabilised counts, whose noise has a standard deviation of 1/2.

Each takes and gives an image (H, W) of float32 and is a thin cover over a library. Strengths were
chosen on the BSDS training images at K = 16 (``python benchmarks/studies/denoisers.py``).
"""

import contextvars
import functools
import queue
import threading
from collections.abc import Callable
from typing import ParamSpec

import numpy as np
import numpy.typing as npt

from jotlight.errors import MissingExtraError
from jotlight.estimators.vst import NOISE

Image = npt.NDArray[np.float32]
Denoiser = Callable[[Image], npt.ArrayLike]
P = ParamSpec("P")


def _stoppable(denoise: Callable[P, Image]) -> Callable[P, Image]:
    """Let Ctrl-C end the wait for a library that does not look for it; the library works on."""

    @functools.wraps(denoise)
    def run(*arguments: P.args, **options: P.kwargs) -> Image:
        context = contextvars.copy_context()
        outcome: queue.SimpleQueue[Image | BaseException] = queue.SimpleQueue()

        def work() -> None:
            try:
                outcome.put(context.run(denoise, *arguments, **options))
            except BaseException as error:
                outcome.put(error)

        # As a daemon it does not hold up the end of the program.
        threading.Thread(target=work, daemon=True).start()
        while True:
            try:
                result = outcome.get(timeout=0.1)
            except queue.Empty:
                continue
            if isinstance(result, BaseException):
                raise result
            return result

    return run


@_stoppable
def gaussian(image: Image, sigma: float = 1.5) -> Image:
    """Smooth by a Gaussian of standard deviation `sigma` in pixels (SciPy)."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(image, sigma, mode="reflect"), np.float32)


def tv(image: Image, weight: float = 0.5) -> Image:
    """Minimise total variation by Chambolle's method (scikit-image)."""
    from skimage.restoration import denoise_tv_chambolle

    return np.asarray(denoise_tv_chambolle(image, weight=weight, max_num_iter=200), np.float32)


@_stoppable
def nlm(image: Image, strength: float = 0.7) -> Image:
    """Average over similar patches: non-local means (scikit-image).

    `strength` is the cut-off h in units of the noise's standard deviation.
    """
    from skimage.restoration import denoise_nl_means

    denoised = denoise_nl_means(
        image,
        patch_size=5,
        patch_distance=6,
        h=strength * NOISE,
        sigma=NOISE,
        fast_mode=True,
    )
    # scikit-image drops a height or width of 1.
    return np.asarray(denoised, np.float32).reshape(image.shape)


@_stoppable
def bm3d(image: Image) -> Image:
    """Block matching and collaborative filtering, by its authors' package.

    Raises
    ------
    MissingExtraError
        When the package is not installed. Its licence allows non-commercial use only.
    """
    try:
        from bm3d import bm3d as authors_bm3d
    except ImportError as error:
        raise MissingExtraError(
            "the denoiser 'bm3d' needs its authors' package: pip install 'jotlight[bm3d]'. "
            "Its licence allows non-commercial use only; 'tv' and 'nlm' need no extra package"
        ) from error
    # The package refuses images smaller than its blocks of 8 x 8, and one of just that size
    # crashes it.
    height, width = image.shape
    whole = np.pad(image, ((0, max(0, 16 - height)), (0, max(0, 16 - width))), mode="symmetric")
    denoised = authors_bm3d(whole, sigma_psd=NOISE)
    return np.asarray(denoised[:height, :width], np.float32)


DENOISERS: dict[str, Callable[[Image], Image]] = {
    "gaussian": gaussian,
    "tv": tv,
    "nlm": nlm,
    "bm3d": bm3d,
}
"""The denoisers by name."""


def resolve_denoiser(denoiser: str | Denoiser) -> Denoiser:
    """A denoiser by its name, or the callable itself.

    Raises
    ------
    ValueError, TypeError
        For an unknown name and for what cannot be called.
    """
    if isinstance(denoiser, str):
        if denoiser not in DENOISERS:
            raise ValueError(
                f"denoiser: expected one of {', '.join(DENOISERS)} or a callable, got {denoiser!r}"
            )
        return DENOISERS[denoiser]
    if not callable(denoiser):
        raise TypeError(f"denoiser: expected a name or a callable, got {denoiser!r}")
    return denoiser
