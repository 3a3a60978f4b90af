"""Maximum likelihood in closed form: equation (5), for any threshold."""

from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.chunks import pixel_chunks, take_pixels
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.sensing.bits import Bits
from jotlight.sensing.pixel_counts import (
    PixelCounts,
    count_pixels,
    map_channels,
    warn_about_smooth_kernel,
)
from jotlight.sensing.sensor import Sensor

_ROWS = 64
"""Rows of pixels whose likelihood equations are solved between two looks at Ctrl-C."""


def mle(
    data: Bits | npt.ArrayLike, sensor: Sensor, *, threads: int | None = None
) -> npt.NDArray[np.float32]:
    """Estimate each pixel by itself: the intensity that makes its bits most likely.

    ``ĉ = (K/α)(P⁻¹(q, L/n) - d)/η`` clipped to [0, S], with L ones among the pixel's n valid bits.

    Parameters
    ----------
    data : Bits or array_like of int
        Bits, or an image of counts L of shape (H, W) or (H, W, C).
    sensor : Sensor
        With the box kernel. Bits of a smooth kernel are taken as if their kernel were the box.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    ndarray of float32, shape (H, W) or (H, W, C)
        Intensities in [0, S].

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit, or a count is above K.

    Warns
    -----
    JotlightWarning
        When pixels without a valid jot were filled from their neighbours, and when the kernel is
        smooth.

    Notes
    -----
    Paper, equation (5), there for q = 1 without dark counts. Where the jots of one pixel differ in
    their efficiency or dark counts there is no closed form; the scalar likelihood equation of each
    pixel is then solved to rounding, which takes bits.

    Examples
    --------
    >>> counts = np.array([[0, 4, 8]])
    >>> mle(counts, Sensor(frames=8)).round(4).tolist()
    [[0.0, 0.6930999755859375, 1.0]]
    """
    warn_about_smooth_kernel(sensor)

    def one_channel(data: Bits | npt.NDArray[np.int32]) -> npt.NDArray[np.float32]:
        seen = count_pixels(data, sensor, threads)
        out = np.empty(seen.counts.shape, np.float32)
        if seen.varies_within_pixels:
            _jot_by_jot(data, seen, out, threads)
        else:
            for part in pixel_chunks(out.size):
                engine.mle_from_counts(
                    sensor.pixel_response(),
                    take_pixels(seen.counts, part),
                    take_pixels(seen.trials, part),
                    (take_pixels(seen.efficiency, part), take_pixels(seen.dark_counts, part)),
                    take_pixels(out, part),
                    threads,
                )
        return inpaint_dead_pixels(out, seen.dead_pixels)

    return map_channels(one_channel, data)


def _jot_by_jot(
    data: Bits | npt.NDArray[np.int32],
    seen: PixelCounts,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None:
    sensor = seen.sensor
    if not isinstance(data, Bits):
        raise ValueError(
            "counts: where jots of one pixel differ in their efficiency or dark counts the bits "
            "are needed, since a count does not tell which jots fired"
        )
    mask = sensor.mask
    ones = data.counts(1, threads=threads)
    # Some rows at a time, so that Ctrl-C need not wait for all of them.
    for start in range(0, len(out), _ROWS):
        jots = slice(start * sensor.oversampling, (start + _ROWS) * sensor.oversampling)
        engine.mle_from_jots(
            sensor.pixel_response(),
            ones[jots].ravel(),
            (_rows(sensor.efficiency, jots), _rows(sensor.dark_counts, jots)),
            None if mask is None else mask[jots].ravel(),
            sensor.frames,
            sensor.oversampling,
            out.shape[1],
            out[start : start + _ROWS].reshape(-1),
            threads,
        )


def _rows(value: float | npt.NDArray[np.float32], jots: slice) -> Any:
    """Some rows of a map over the jots, as the engine takes them, or the number for all of them."""
    return value[jots].astype(np.float64).ravel() if isinstance(value, np.ndarray) else value
