"""The non-iterative method: stabilize, denoise, invert (paper, section 2.2.2)."""

import numpy as np
import numpy.typing as npt

from jotlight.estimators import vst
from jotlight.estimators.denoise import Denoiser, resolve_denoiser
from jotlight.estimators.inverse_response import (
    equivalent_counts,
    intensity_from_probability,
)
from jotlight.sensing.bits import Bits
from jotlight.sensing.pixel_counts import (
    Estimate,
    count_pixels,
    map_channels,
    warn_about_smooth_kernel,
)
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor


def noniterative(
    data: Bits | npt.ArrayLike,
    sensor: Sensor,
    *,
    denoiser: str | Denoiser = "tv",
    inverse: str = "exact",
    threads: int | None = None,
) -> Estimate:
    """Return the estimate of the non-iterative method, which denoises variance-stabilized counts.

    Parameters
    ----------
    data : Bits or array_like of int
        Bits, or an image of counts L of shape (H, W) or (H, W, C).
    sensor : Sensor
        The sensor that recorded the data. A smooth kernel is treated as the box kernel.
    denoiser : str or callable
        A name in `jotlight.denoise.DENOISERS` ("tv", "gaussian", "nlm", "bm3d"), or a callable. It
        takes an image (H, W) of float32 with white noise of standard deviation 1/2
        (:data:`jotlight.estimators.vst.NOISE`) and returns one of the same shape.
    inverse : {"exact", "algebraic"}
        See :func:`jotlight.estimators.vst.inverse_anscombe`.
    threads : int, optional
        The number of threads of the engine; the denoiser has its own. Default: all cores.

    Returns
    -------
    ndarray of float32, shape (H, W) or (H, W, C)
        Intensities in [0, S].

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together, for an unknown denoiser or inverse, and when the
        denoiser returns another shape, NaN, or infinity.
    MissingExtraError
        For "bm3d" when its package is not installed.

    Warns
    -----
    JotlightWarning
        When pixels without a valid jot were filled from their neighbors, and when the kernel is
        smooth.

    Notes
    -----
    Some pixels have dead jots, or an efficiency or dark counts other than the median. Their counts
    are first replaced by the counts that K valid bits of jots with the median values would show.
    The noise of these pixels then differs slightly from that of the others.

    Examples
    --------
    >>> counts = np.full((8, 8), 8)
    >>> noniterative(counts, Sensor(frames=16), denoiser=lambda z: z)[0, 0].round(3)
    np.float32(0.693)
    """
    run = resolve_denoiser(denoiser)
    if inverse not in vst.INVERSES:
        raise ValueError(f"inverse: expected one of {', '.join(vst.INVERSES)}, got {inverse!r}")

    warn_about_smooth_kernel(sensor)

    def estimate_channel(data: Bits | npt.NDArray[np.int32]) -> Estimate:
        trials = sensor.trials
        pixels = count_pixels(data, sensor, threads)
        counts = equivalent_counts(pixels, reference_jot(sensor), threads)
        z = vst.anscombe(counts, trials, threads=threads)
        denoised = np.asarray(run(z), np.float32)
        if denoised.shape != z.shape or not np.isfinite(denoised).all():
            raise ValueError(
                f"denoiser: expected a finite image of shape {z.shape}, got shape "
                f"{denoised.shape}" + ("" if denoised.shape != z.shape else " with NaN or infinity")
            )
        counts = vst.inverse_anscombe(denoised, trials, inverse=inverse, threads=threads)
        return intensity_from_probability(counts / np.float32(trials), sensor, threads)

    return map_channels(estimate_channel, data)
