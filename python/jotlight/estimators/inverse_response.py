"""The inverse response of a pixel: intensities from probabilities, and comparable counts."""

import dataclasses

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array, Image
from jotlight.errors import warn
from jotlight.estimators.alike_jots import DifferentJots, alike_fractions
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.estimators.trial_levels import fill_from_nearest
from jotlight.sensing.bits.values import flatten
from jotlight.sensing.data.pixel_counts import PixelCounts
from jotlight.sensing.likelihood.reference import Jot, reference_jot
from jotlight.sensing.merged import MAX_SILENT_TRIALS
from jotlight.sensing.parameters.maps import constant_or_map
from jotlight.sensing.sensor import KERNELS, Sensor


def equivalent_counts(
    pixels: PixelCounts,
    reference: Jot,
    trials: float | Array,
    threads: int | None,
    pattern: npt.NDArray[np.integer] | None = None,
) -> npt.NDArray[np.float32]:
    """Return the counts of `trials` readings of reference jots that see the same intensities.

    Methods that combine neighboring pixels use these counts, so that dead and hot jots leave no
    pattern. Where jots differ, the counts are those of
    :func:`jotlight.estimators.alike_jots.alike_fractions`.

    Parameters
    ----------
    pixels : PixelCounts
        The counts of a gray image, or of several (N, H, W).
    reference : Jot
        η and d of the reference jot.
    trials : float or ndarray of float64, shape (N,)
        K of the result, above 0: a number, or one for each image.
    threads : int, optional
        The number of threads. Default: the number of cores.
    pattern : ndarray of int, shape (H, W), optional
        The filter of each pixel of a mosaic. Default: none.

    Returns
    -------
    ndarray of float32
        Real numbers in [0, K], of the shape of the counts.

    Warns
    -----
    JotlightWarning
        Once, when pixels without a valid bit were inpainted from their neighbors.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import count_pixels
    >>> pixels = count_pixels(np.array([[2, 4]]), jl.Sensor(frames=8), None)
    >>> equivalent_counts(pixels, (0.5, 0.0), 8, None).round(2)  # half the efficiency, fewer ones
    array([[1.07, 2.34]], dtype=float32)
    """
    own = pixels.trials, pixels.efficiency, pixels.dark_counts
    same = np.unique(trials)
    if pixels.uniform and len(same) == 1 and own == (same[0], *reference):
        return pixels.counts.astype(np.float32)
    if isinstance(pixels.efficiency, np.ndarray) or isinstance(pixels.dark_counts, np.ndarray):
        out = _counts_of_alike_jots(pixels, reference, trials, threads, pattern)
        return inpaint_dead_pixels(_fill_silent_pixels(out, pixels), pixels.dead_pixels)
    out = np.empty(pixels.counts.shape, np.float32)
    images = len(out) if isinstance(trials, np.ndarray) else 1
    engine.equivalent_counts(
        pixels.sensor.pixel_response(),
        np.ascontiguousarray(pixels.counts).reshape(images, -1),
        flatten(pixels.trials),
        (flatten(pixels.efficiency), flatten(pixels.dark_counts)),
        np.atleast_1d(np.asarray(trials, np.float64)),
        reference,
        out.reshape(images, -1),
        threads,
    )
    return inpaint_dead_pixels(_fill_silent_pixels(out, pixels), pixels.dead_pixels)


def _counts_of_alike_jots(
    pixels: PixelCounts,
    reference: Jot,
    trials: float | Array,
    threads: int | None,
    pattern: npt.NDArray[np.integer] | None,
) -> Image:
    """Return the counts of `trials` readings of reference jots, of the shape of the counts."""
    stack = -1, *pixels.counts.shape[-2:]
    counts, own, efficiency, dark_counts = (
        np.broadcast_to(np.asarray(each), pixels.counts.shape).reshape(stack)
        for each in (pixels.counts, pixels.trials, pixels.efficiency, pixels.dark_counts)
    )
    of_jots = DifferentJots(counts, own, efficiency, dark_counts, pixels.sensor.threshold)
    fractions = alike_fractions(of_jots, reference, pattern, threads)
    readings = np.broadcast_to(trials, len(fractions)).reshape(-1, 1, 1)
    return np.asarray(readings * fractions, np.float32).reshape(pixels.counts.shape)


def _fill_silent_pixels(counts: Image, pixels: PixelCounts) -> Image:
    """Return counts whose pixels that say nothing have those of their neighbors.

    With 0 ones of hardly any trial, they would be taken for dark.
    """
    silent = np.asarray(pixels.trials <= MAX_SILENT_TRIALS)
    if not silent.any():
        return counts
    filled = []
    holes = np.broadcast_to(silent, counts.shape).reshape(-1, *counts.shape[-2:])
    for image, own in zip(counts.reshape(holes.shape), holes, strict=True):
        filled.append(image if own.all() else fill_from_nearest(image, ~own))
    return np.stack(filled).reshape(counts.shape)


def equivalent_fractions(
    pixels: PixelCounts, threads: int | None, pattern: npt.NDArray[np.integer] | None = None
) -> npt.NDArray[np.float32]:
    """Return L/K that a reference jot would have in place of each pixel, of the counts' shape.

    Pixels without readings count as one reading that is 0. The caller must fill them, or give them
    no weight. `pattern` is the filter of each pixel of a mosaic.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import count_pixels
    >>> pixels = count_pixels(np.array([[2, 4]]), jl.Sensor(frames=8), None)
    >>> equivalent_fractions(pixels, None).tolist()
    [[0.25, 0.5]]
    """
    some = np.where(pixels.trials == 0, 1.0, pixels.trials)
    alive = dataclasses.replace(pixels, trials=constant_or_map(some))
    return equivalent_counts(alive, reference_jot(pixels.sensor), 1, threads, pattern)


def intensity_from_probability(
    probability: npt.NDArray[np.float32], sensor: Sensor, threads: int | None
) -> npt.NDArray[np.float32]:
    """Return the intensity at which the bits of a pixel are 1 with the given probability.

    The intensity is ``c = (K/α)(P⁻¹(q, p) - d)/η``, clipped to [0, S]: equation (5) with p in place
    of L/K. η and d are those of :func:`jotlight.sensing.likelihood.reference.reference_jot`.

    Parameters
    ----------
    probability : ndarray of float32, any shape
        p in [0, 1].
    sensor : Sensor
        The sensor.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float32
        Intensities in [0, S], of the same shape.

    Examples
    --------
    >>> intensity_from_probability(np.float32([0.0, 0.5, 1.0]), jl.Sensor(), None).round(4)
    array([0.    , 0.6931, 1.    ], dtype=float32)
    """
    reference = reference_jot(sensor)
    out = np.empty(probability.shape, np.float32)
    engine.mle_from_probability(
        sensor.pixel_response(), flatten(probability), reference, out.reshape(-1), threads
    )
    return out


def warn_about_smooth_kernel(sensor: Sensor) -> None:
    """Warn if the kernel is smooth, for methods that assume the box kernel."""
    if sensor.kernel == "box":
        return
    # Decision 2: the center of a kernel can only move by whole jots.
    is_moved = KERNELS.index(sensor.kernel) * sensor.oversampling % 2 == 1
    moved = " and moves it half a jot down and right" if is_moved else ""
    warn(
        f"a {sensor.kernel} kernel spreads the light of a pixel over its neighbors{moved}, which "
        "this method does not model: it assumes the box kernel"
    )
