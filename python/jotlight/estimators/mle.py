"""Maximum likelihood in closed form for the box kernel: equation (5), for any threshold."""

from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.sensing.bits import Bits
from jotlight.sensing.pixel_counts import (
    Channel,
    Data,
    Estimate,
    PixelCounts,
    count_pixels,
    map_channels,
    prepare_data,
    warn_about_smooth_kernel,
)
from jotlight.sensing.sensor import Sensor
from jotlight.sensing.values import flatten

_ROWS_PER_CHUNK = 64
"""Number of rows of pixels that the engine solves before Python can handle Ctrl-C."""


def mle(
    data: Data,
    sensor: Sensor | None = None,
    *,
    trials: npt.ArrayLike | None = None,
    threads: int | None = None,
) -> Estimate:
    """Return the most likely intensity of each pixel, given only its own bits.

    It is ``ĉ = (K/α)(P⁻¹(q, L/n) - d)/η``, clipped to [0, S]. L of the pixel's n valid bits are 1.

    Parameters
    ----------
    data : Bits, Merged, or array_like of int
        Bits, merged counts, or an image of counts L of shape (H, W) or (H, W, C), in [0, K].
    sensor : Sensor, optional
        The sensor that recorded the data. Default: the one that bits or merged counts carry. A
        smooth kernel is treated as the box kernel.
    trials : float or array_like of float, optional
        The number of binary readings behind each pixel of counts, 0 or more: a number, or a map of
        their shape. Default: the sensor's K.
    threads : int, optional
        The number of threads. Default: all cores.

    Returns
    -------
    ndarray of float32, shape (H, W) or (H, W, C)
        Intensities in [0, S].

    Raises
    ------
    TypeError, ValueError
        When data, sensor, and trials do not fit together, or a count is above its trials.

    Warns
    -----
    JotlightWarning
        When pixels without a valid bit were filled from their neighbors, and when the kernel is
        smooth.

    Notes
    -----
    Paper, equation (5), which is for q = 1 without dark counts. Where the jots of one pixel differ
    in efficiency or dark counts, no closed form exists. The likelihood equation of each pixel is
    then solved numerically, to machine precision. This requires bits.

    Examples
    --------
    >>> counts = np.array([[0, 4, 8]])
    >>> mle(counts, Sensor(frames=8)).round(4).tolist()
    [[0.0, 0.6930999755859375, 1.0]]
    """
    data, sensor = prepare_data(data, sensor, trials)
    warn_about_smooth_kernel(sensor)

    def estimate_channel(data: Channel) -> Estimate:
        pixels = count_pixels(data, sensor, threads)
        out = np.empty(pixels.counts.shape, np.float32)
        if pixels.varies_within_pixels:
            _solve_jots(require_bits(data), pixels, out, threads)
        else:
            engine.mle_from_counts(
                sensor.pixel_response(),
                flatten(pixels.counts),
                flatten(pixels.trials),
                (flatten(pixels.efficiency), flatten(pixels.dark_counts)),
                out.reshape(-1),
                threads,
            )
        return inpaint_dead_pixels(out, pixels.dead_pixels)

    return map_channels(estimate_channel, data)


def require_bits(
    data: Channel,
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


def _solve_jots(bits: Bits, pixels: PixelCounts, out: Estimate, threads: int | None) -> None:
    """Write the solution of each pixel's likelihood equation to `out`, for unequal jots."""
    sensor, mask = pixels.sensor, pixels.sensor.mask
    ones = bits.counts(1, threads=threads)
    for start in range(0, len(out), _ROWS_PER_CHUNK):
        rows = slice(start, start + _ROWS_PER_CHUNK)
        jots = slice(rows.start * sensor.oversampling, rows.stop * sensor.oversampling)
        engine.mle_from_jots(
            sensor.pixel_response(),
            ones[jots].ravel(),
            (_jot_rows(sensor.efficiency, jots), _jot_rows(sensor.dark_counts, jots)),
            None if mask is None else mask[jots].ravel(),
            sensor.frames,
            sensor.oversampling,
            out.shape[1],
            out[rows].reshape(-1),
            threads,
        )


def _jot_rows(value: float | npt.NDArray[np.float32], jots: slice) -> Any:
    """Return rows of a map over the jots for the engine, or the number for all jots."""
    return value[jots].astype(np.float64).ravel() if isinstance(value, np.ndarray) else value
