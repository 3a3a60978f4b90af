"""Maximum likelihood in closed form for the box kernel: equation (5), for any threshold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.chunks import frame_chunks
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.estimators.inverse_response import warn_about_smooth_kernel
from jotlight.estimators.readings.joint_mle import joint_mle
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.counting import count_ones
from jotlight.sensing.bits.values import flatten
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import Data, GrayData, gray_images, prepare_data
from jotlight.sensing.sensor import Sensor

_MAX_JOTS = 1 << 24
"""Maximum number of jots that the engine solves in one call."""


def mle(
    data: Data,
    sensor: Sensor | None = None,
    *,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    out: npt.NDArray[np.float32] | None = None,
    threads: int | None = None,
) -> Image:
    """Return the most likely intensity of each pixel, given only its own bits.

    It is ``ĉ = (K/α)(P⁻¹(q, L/n) - d)/η``, clipped to [0, S]. L of the pixel's n valid bits are 1.

    Parameters
    ----------
    data : Bits, Merged, list of them, or array_like of int
        Bits, merged counts, or counts L of shape (..., H, W), in [0, K].
    sensor : Sensor, optional
        The sensor that recorded the data. Default: the one that bits or merged counts carry. A
        smooth kernel is treated as the box kernel.
    trials : float or array_like of float, optional
        The number of binary readings behind each pixel of counts, 0 or more: a number, or a map of
        their shape. Default: the sensor's K.
    channel_axis : int, optional
        The axis of counts that holds color channels. Default: none, and axes before the last two
        are those of a stack.
    out : ndarray of float32, optional
        An array of the shape of the result to write to and return. Default: a new one.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float32
        Intensities in [0, S], of the shape of the counts. Estimates of color bits are (H, W, C).

    Raises
    ------
    TypeError, ValueError
        When data, sensor, trials, and `out` do not fit together, or a count is above its trials.

    Warns
    -----
    JotlightWarning
        When pixels without a valid bit were inpainted from their neighbors, and when the kernel is
        smooth.

    Notes
    -----
    Paper, equation (5), which is for q = 1 without dark counts. Where the jots of one pixel differ
    in efficiency or dark counts, no closed form exists. The likelihood equation of each pixel is
    then solved numerically, to machine precision. This requires bits. So does a sensor whose
    readings differ in their gain or threshold; the joint likelihood of all readings of a pixel is
    then maximized by Newton's method (:func:`jotlight.estimators.readings.joint_mle.maximize`).

    Examples
    --------
    >>> counts = np.array([[0, 4, 8]])
    >>> jl.mle(counts, jl.Sensor(frames=8)).round(4).tolist()
    [[0.0, 0.6930999755859375, 1.0]]
    """
    data, sensor = prepare_data(data, sensor, trials, channel_axis, may_differ=True)
    warn_about_smooth_kernel(sensor)
    images = gray_images(data)
    output = output_of(images, sensor, out)
    if not sensor.has_plain_bits:
        return output.finish(joint_mle(images, sensor, threads))
    pixels = images.count(sensor, threads)
    estimate = output.images
    if pixels.varies_within_pixels:
        _solve_jots([require_bits(image) for image in images.data], sensor, estimate, threads)
    else:
        engine.mle_from_counts(
            sensor.pixel_response(),
            flatten(pixels.counts),
            flatten(pixels.trials),
            (flatten(pixels.efficiency), flatten(pixels.dark_counts)),
            estimate.reshape(-1),
            threads,
        )
    return output.finish(inpaint_dead_pixels(estimate, pixels.dead_pixels))


def require_bits(
    data: GrayData,
    reason: str = "jots of one pixel differ in their efficiency or dark counts",
) -> Bits:
    """Return the data, which must be bits because of `reason`.

    Raises
    ------
    ValueError
        For counts, which do not say which jots of a pixel were 1.

    Examples
    --------
    >>> require_bits(np.ones((2, 2), np.int32))
    Traceback (most recent call last):
        ...
    ValueError: counts: expected bits, because jots of one pixel differ in their efficiency or \
dark counts, and a count does not say which jots reported 1
    """
    if not isinstance(data, Bits):
        raise ValueError(
            f"counts: expected bits, because {reason}, and a count does not say which jots "
            "reported 1"
        )
    return data


def _solve_jots(bits: Sequence[Bits], sensor: Sensor, out: Image, threads: int | None) -> None:
    """Write the solutions of the pixels' likelihood equations to `out` (N, H, W)."""
    _, height, width = out.shape
    number = max(1, _MAX_JOTS // (height * width * sensor.oversampling**2))
    if number < len(bits):
        for start in range(0, len(bits), number):
            part = slice(start, start + number)
            _solve_jots(bits[part], sensor, out[part], threads)
        return
    mask, number = sensor.mask, len(bits)
    ones = count_ones(bits, 1, threads=threads)
    # The engine takes the maps in double precision. Chunks of rows limit their memory.
    row_size = number * width * sensor.oversampling**2
    for _, rows in frame_chunks(1, height, row_size, _MAX_JOTS):
        jots = slice(rows.start * sensor.oversampling, rows.stop * sensor.oversampling)
        estimate = np.empty((number, len(rows) * width), np.float32)
        engine.mle_from_jots(
            sensor.pixel_response(),
            np.ascontiguousarray(ones[:, jots]).reshape(number, -1),
            (_jot_rows(sensor.efficiency, jots), _jot_rows(sensor.dark_counts, jots)),
            None if mask is None else mask[jots].ravel(),
            sensor.frames,
            sensor.oversampling,
            width,
            estimate,
            threads,
        )
        out[:, rows.start : rows.stop] = estimate.reshape(number, len(rows), width)


def _jot_rows(value: float | npt.NDArray[np.float32], jots: slice) -> Any:
    """Return rows of a map over the jots for the engine, or the number for all jots."""
    return value[jots].astype(np.float64).ravel() if isinstance(value, np.ndarray) else value
