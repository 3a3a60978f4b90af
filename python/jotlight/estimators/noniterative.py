"""The non-iterative method: stabilize, denoise, invert (paper, section 2.2.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.checks import to_array
from jotlight.estimators import vst
from jotlight.estimators.denoise import Denoiser, resolve_denoiser
from jotlight.estimators.inverse_response import (
    equivalent_counts,
    intensity_from_probability,
    warn_about_smooth_kernel,
)
from jotlight.estimators.readings.generalized_anscombe import (
    Denoise,
    denoise_readings,
    is_saturated,
)
from jotlight.estimators.readings.merge_near import Merging, merge_different_jots
from jotlight.estimators.trial_levels import count_local_trials, interpolate_levels
from jotlight.parameter_names import check_choice
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import Data, GrayImages, gray_images, prepare_data
from jotlight.sensing.data.stacks import each_image
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.parameters.reading_groups import refuse_different_readings
from jotlight.sensing.sensor import Sensor


def noniterative(
    data: Data,
    sensor: Sensor | None = None,
    *,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    denoiser: str | Denoiser = "tv",
    inverse: str = "exact",
    out: npt.NDArray[np.float32] | None = None,
    threads: int | None = None,
) -> Image:
    """Return the estimate of the non-iterative method, which denoises variance-stabilized counts.

    Parameters
    ----------
    data : Bits, Merged, list of them, or array_like of int
        Bits, merged counts, or counts L of shape (..., H, W).
    sensor : Sensor, optional
        The sensor that recorded the data. Default: the one that bits or merged counts carry. A
        smooth kernel is treated as the box kernel.
    trials : float or array_like of float, optional
        The number of binary readings behind each pixel of counts, 0 or more: a number, or a map of
        their shape. Default: the sensor's K.
    channel_axis : int, optional
        The axis of counts that holds color channels. Default: none, and axes before the last two
        are those of a stack.
    denoiser : str or callable
        A name in `jotlight.denoise.DENOISERS`, such as "tv" or "nlm", or a callable. A callable
        takes an image (H, W) of float32 with white noise of standard deviation 1/2
        (:data:`jotlight.estimators.vst.NOISE`), less where nearly all bits are equal, and returns
        one of the same shape.
    inverse : {"exact", "algebraic"}
        See :func:`jotlight.estimators.vst.inverse_anscombe`.
    out : ndarray of float32, optional
        An array of the shape of the result to write to and return. Default: a new one.
    threads : int, optional
        The number of threads of the engine; the denoiser has its own. Default: the number of
        cores.

    Returns
    -------
    ndarray of float32
        Intensities in [0, S], of the shape of the counts. Estimates of color bits are (H, W, C).

    Raises
    ------
    TypeError, ValueError
        When data, sensor, trials, and `out` do not fit together, for an unknown denoiser or
        inverse, and when the denoiser returns another shape, NaN, or infinity.
    MissingExtraError
        For "bm3d" when its package is not installed.

    Warns
    -----
    JotlightWarning
        When pixels without a valid bit were inpainted from their neighbors, and when the kernel is
        smooth.

    Notes
    -----
    Some pixels have dead jots, or an efficiency or dark counts other than the median. Their counts
    are first replaced by the counts that K valid bits of jots with the median values would show.
    Here K is the harmonic mean of the trials in the neighborhood of a pixel. Where it varies much,
    the method runs at several K, whose ratios are at most 2, and pixels between two of them are
    interpolated.

    For readings of several bits, the method uses the generalized Anscombe transform and its exact
    inverse (:mod:`jotlight.estimators.readings.generalized_anscombe`). If at least 15 % of them are
    the largest one, or if pixels differ, it uses equivalent counts near local averages instead
    (:class:`jotlight.estimators.readings.merge_near.Merging`).

    The engine computes all images of a stack together. The denoisers are functions of libraries,
    which run on one image at a time.

    Examples
    --------
    >>> counts = np.full((8, 8), 8)
    >>> jl.noniterative(counts, jl.Sensor(frames=16), denoiser=lambda z: z)[0, 0].round(3)
    np.float32(0.693)
    """
    resolve_denoiser(denoiser)  # check it first
    check_choice("inverse", inverse, vst.INVERSES)

    data, sensor = prepare_data(data, sensor, trials, channel_axis, may_differ=True)
    warn_about_smooth_kernel(sensor)

    images = gray_images(data)
    output = output_of(images, sensor, out)

    def run(z: Image) -> Image:
        return _run_denoiser(denoiser, z)

    if sensor.has_plain_bits:
        return output.finish(_denoise_counts(images, sensor, run, inverse, threads))
    refuse_different_readings(sensor)
    for place, one in zip(output.images, images.data, strict=True):
        joint = joint_likelihood(one, sensor, threads)
        if not joint.uniform or is_saturated(joint):
            merged = Merging(joint).near_neighbors()
            counts = gray_images(merged)
            place[:] = _denoise_counts(counts, merged.sensor, run, inverse, threads)[0]
        else:
            place[:] = denoise_readings(joint, run, inverse, threads)
    return output.finish(output.images)


def _denoise_counts(
    images: GrayImages, sensor: Sensor, denoise: Denoise, inverse: str, threads: int | None
) -> Image:
    """Return the estimates of bits or counts, (N, H, W)."""
    images, sensor = merge_different_jots(images, sensor, threads)
    pixels = images.count(sensor, threads)
    own_trials = count_local_trials(pixels, threads)
    largest = np.ceil([np.max(each) for each in own_trials])
    counts = equivalent_counts(pixels, reference_jot(sensor), largest, threads)

    def probability_at(level: int, places: list[int]) -> Image:
        factor = each_image(np.asarray(level / largest[places], np.float32), counts)
        own = np.minimum(counts[places] * factor, np.float32(level))
        denoised = denoise(vst.anscombe(own, level, threads=threads))
        inverted = vst.inverse_anscombe(denoised, level, inverse=inverse, threads=threads)
        return np.asarray(inverted / np.float32(level))

    probability = interpolate_levels(probability_at, own_trials, counts.shape[1:])
    return intensity_from_probability(probability, sensor, threads)


def _run_denoiser(denoiser: str | Denoiser, z: Image) -> Image:
    """Return the denoised images (N, H, W). A function of the caller takes one at a time."""
    run = resolve_denoiser(denoiser)
    results: Any = run(z) if isinstance(denoiser, str) else [run(each) for each in z]
    denoised = [np.asarray(to_array("denoiser", each), np.float32) for each in results]
    for each in denoised:
        if each.shape != z.shape[1:] or not np.isfinite(each).all():
            raise ValueError(
                f"denoiser: expected a finite image of shape {z.shape[1:]}, got shape {each.shape}"
                + ("" if each.shape != z.shape[1:] else " with NaN or infinity")
            )
    return np.stack(denoised)
