"""The problem of the gray images of some data and a sensor: equation (4)."""

from typing import Any

import numpy as np

from jotlight.estimators.mle import require_bits
from jotlight.sensing.bits.counting import count_ones
from jotlight.sensing.bits.values import check_any_valid
from jotlight.sensing.data.pixel_counts import GrayImages, PixelCounts, PreparedData, gray_images
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.likelihood.operators import scaling, spread
from jotlight.sensing.likelihood.problem import Problem
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor


def build_problem(data: PreparedData, sensor: Sensor, threads: int | None) -> Problem:
    """Return the problem of a stack of gray images of bits or counts: equation (4).

    With the box kernel the bits of a pixel are exchangeable. Their count is then a sufficient
    statistic, and the cells are the pixels. With a smooth kernel, or where the jots of a pixel
    differ, the cells are the jots. If a pixel is a jot, its count suffices in all cases.

    Parameters
    ----------
    data : Bits of shape (T, H·K̂, W·K̂), Merged or ndarray of int32 (H, W), or GrayImages
        The bits, merged counts, or counts, of one image or several.
    sensor : Sensor
        The sensor that recorded them.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit together, or an image has no pixel with a valid bit.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=2)
    >>> build_problem(np.array([[3, 1]], np.int32), sensor, None).likelihood.shape
    (1, 1, 2)
    """
    images = gray_images(data)
    pixels = images.count(sensor, threads)
    check_any_valid(pixels.trials)
    if sensor.kernel == "box" and not pixels.varies_within_pixels:
        return _pixel_problem(pixels, threads)
    return _jot_problem(images, pixels, sensor, threads)


def _pixel_problem(pixels: PixelCounts, threads: int | None) -> Problem:
    response = pixels.sensor.pixel_response()
    likelihood = Likelihood(
        pixels.counts,
        pixels.trials,
        threshold=response.threshold,
        efficiency=pixels.efficiency,
        dark_counts=pixels.dark_counts,
        threads=threads,
    )
    light = scaling(pixels.counts.shape[1:], response.light_per_intensity)
    return Problem(light, likelihood, response.max_intensity)


def _jot_problem(
    images: GrayImages, pixels: PixelCounts, sensor: Sensor, threads: int | None
) -> Problem:
    if sensor.kernel != "box":
        _refuse_merged(images, sensor)
    ones, trials = _counts_of_jots(images, pixels, sensor, threads)
    light = spread(
        pixels.counts.shape[1:],
        sensor.oversampling,
        sensor.kernel,
        gain=sensor.gain / sensor.frames,
        threads=threads,
    )
    trials, efficiency, dark_counts = (
        np.broadcast_to(value, ones.shape) if isinstance(value, np.ndarray) else value
        for value in (trials, sensor.efficiency, sensor.dark_counts)
    )
    likelihood = Likelihood(
        ones,
        trials,
        threshold=sensor.threshold,
        efficiency=efficiency,
        dark_counts=dark_counts,
        threads=threads,
    )
    return Problem(light, likelihood, sensor.max_intensity)


def _counts_of_jots(
    images: GrayImages, pixels: PixelCounts, sensor: Sensor, threads: int | None
) -> tuple[Any, Any]:
    """Return the number of ones of each jot, (N, H·K̂, W·K̂), and that of its valid bits."""
    if sensor.oversampling == 1:
        return pixels.counts, pixels.trials
    reason = "jots of one pixel differ in their efficiency or dark counts"
    if sensor.kernel != "box":
        reason = f"the light of a {sensor.kernel} kernel differs from jot to jot"
    bits = [require_bits(image, reason) for image in images.data]
    ones = count_ones(bits, 1, mask=sensor.mask, threads=threads)
    if sensor.mask is None:
        return ones, sensor.frames
    return ones, np.where(sensor.mask, 0.0, float(sensor.frames))


def _refuse_merged(images: GrayImages, sensor: Sensor) -> None:
    """Raise ValueError for merged counts of a sensor with a smooth kernel."""
    if any(isinstance(image, Merged) for image in images.data):
        raise ValueError(
            f"kernel: expected 'box', got {sensor.kernel!r}: deconvolution needs plain bits, but "
            "these are merged counts, also made of readings of several bits, with read noise, or "
            'with different gains or thresholds; state kernel="box" (--kernel box) for the mean '
            "light of each pixel"
        )
