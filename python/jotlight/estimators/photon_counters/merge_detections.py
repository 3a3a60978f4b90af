"""Equivalent counts of free-running pixels: the counts of detections with a dead time.

They are those of :mod:`jotlight.estimators.readings.merge_near` and of
:mod:`jotlight.estimators.merge_readings`, for other readings.
"""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Mask
from jotlight.estimators.merge_readings import (
    counts_of_equal_likelihood,
    linear_counts,
    round_ones,
)
from jotlight.estimators.readings.neighbors import averaged_pixels, toward_own, typical_spread
from jotlight.estimators.readings.reference_sensors import MAX_TRIALS
from jotlight.estimators.readings.whole_counts import complete_trials, whole_counts
from jotlight.sensing.bits.values import check_any_valid
from jotlight.sensing.sensor import Sensor

_STEP = 0.03
"""Relative difference of the intensities near which counts are taken. Near each of them, counts
are linear, so that a coarse grid makes no bias."""

_MIN_SHARE = 1e-5
"""Smallest of them, as a share of the largest one, or of the one at which a pixel is blind half of
the time, whichever is dimmer."""


_HALFWAY = 33.0
"""Square of the signal-to-noise ratio of a pixel at which counts are taken halfway between the
average and its most likely intensity. It is lower than for readings, because a single count of a
pixel that is hardly saturated has little bias."""


class Detector(Protocol):
    """What counts near an intensity need of a :class:`jotlight.FreeRunning`."""

    @property
    def dead_time(self) -> float: ...  # noqa: D102
    @property
    def efficiency(self) -> float: ...  # noqa: D102
    @property
    def dark_counts(self) -> float: ...  # noqa: D102
    @property
    def max_count(self) -> int: ...  # noqa: D102
    def mean(self, light: npt.ArrayLike) -> Array: ...  # noqa: D102
    def mle(self, counts: npt.ArrayLike) -> Array: ...  # noqa: D102
    def information(self, light: npt.ArrayLike) -> Array: ...  # noqa: D102
    def score(self, counts: npt.ArrayLike, light: npt.ArrayLike) -> Array: ...  # noqa: D102


def merge_detections(
    pixel: Detector,
    counts: npt.NDArray[np.integer],
    light: float,
    sensor: Sensor,
    *,
    near_neighbors: bool,
) -> tuple[npt.NDArray[np.int32], Array, Mask | None]:
    """Return the ones, the trials, and perhaps the marked pixels of detections, (H, W).

    The trials are those near averages over the neighbors, or at the maximum of each pixel. The
    other parameters are those of :func:`merge_near_neighbors`.
    """
    merge = merge_near_neighbors if near_neighbors else merge_at_maximum
    return merge(pixel, counts, light, sensor)


def merge_at_maximum(
    pixel: Detector, counts: npt.NDArray[np.integer], light: float, sensor: Sensor
) -> tuple[npt.NDArray[np.int32], Array, None]:
    """Return the ones and the trials of detections at the most likely intensity of each pixel.

    The parameters are those of :func:`merge_near_neighbors`. No pixel is marked.

    Examples
    --------
    >>> pixel, sensor = jl.FreeRunning(dead_time=0.25), jl.Sensor(frames=80, gain=20.0)
    >>> ones, trials, _ = merge_at_maximum(pixel, np.array([[2]]), 20.0, sensor)
    >>> round(float(-np.log1p(-ones / trials)[0, 0]) * 80, 2), pixel.mle(2).round(2).tolist()
    (3.63, 3.63)
    """
    # There are few distinct counts. Each needs a sum over all possible counts.
    distinct, places = np.unique(counts, return_inverse=True)
    likely = pixel.mle(distinct) / light
    intensity = np.clip(likely, 0, sensor.max_intensity)
    is_inside = (likely > 0) & (likely < sensor.max_intensity)
    gradient = np.where(is_inside, 0.0, light * pixel.score(distinct, light * intensity))
    information = light**2 * pixel.information(light * intensity)
    slope = pixel.efficiency * sensor.light_per_intensity
    rate = slope * intensity + pixel.dark_counts / sensor.frames
    ends = {"is_dark": distinct == 0, "is_full": distinct == pixel.max_count}
    each = counts_of_equal_likelihood(gradient, information, slope, rate, rate, **ends)
    # As for readings, less than half a one becomes 0 only where darkness is likely enough.
    is_kept = light * pixel.score(distinct, np.zeros(distinct.shape)) * intensity > 1
    rounded = round_ones(*each, keeps_maximum=is_kept)
    is_live = _live_pixels(sensor, counts.shape)
    ones, trials = (np.where(is_live, part[places.reshape(counts.shape)], 0) for part in rounded)
    return ones, trials, None


def merge_near_neighbors(
    pixel: Detector, counts: npt.NDArray[np.integer], light: float, sensor: Sensor
) -> tuple[npt.NDArray[np.int32], Array, Mask]:
    """Return the ones and the trials of detections near averages over the neighbors, (H, W).

    An average is the intensity at which the mean of the counts around a pixel is expected. If all
    of them are saturated, it is the one at which half a detection less is expected. The third array
    marks these pixels, whose counts say only that the light is bright. The higher the
    signal-to-noise ratio of a pixel, the closer the intensity is to its most likely one instead, as
    for readings (decision 53).

    Parameters
    ----------
    pixel : FreeRunning
        The pixels.
    counts : ndarray of int, shape (H, W)
        Their counts, 0 for dead pixels.
    light : float
        Photons per exposure time at intensity 1.
    sensor : Sensor
        The sensor of the trials. The pixels that its mask marks have no trials.

    Examples
    --------
    >>> pixel, sensor = jl.FreeRunning(dead_time=0.25), jl.Sensor(frames=80, gain=20.0)
    >>> counts = pixel.draw(np.full((64, 64), 0.6 * 20), rng=0)
    >>> ones, trials, _ = merge_near_neighbors(pixel, counts, 20.0, sensor)
    >>> round(float(-np.log1p(-ones.sum() / trials.sum()) * 80 / 20), 1)
    0.6
    """
    is_live, levels = _live_pixels(sensor, counts.shape), _levels(pixel, light, sensor)
    known = light**2 * pixel.information(light * levels)
    near, is_saturated = _average(
        counts, is_live, pixel.mean(light * levels), levels, known, pixel.max_count
    )
    own = np.clip(pixel.mle(counts) / light, 0, sensor.max_intensity)
    near = toward_own(near, own, np.interp(near, levels, known), _HALFWAY)
    places = np.rint(np.interp(near, levels, np.arange(levels.size))).astype(np.int64)
    slope = pixel.efficiency * sensor.light_per_intensity
    rate = slope * levels[places] + pixel.dark_counts / sensor.frames
    gradient = light * _scores(pixel, counts, light * levels, places)
    ones, trials = linear_counts(gradient, known[places], slope, rate, rate)
    ones, trials = (np.where(is_live, part, 0.0) for part in (ones, trials))
    ones, trials = complete_trials(ones, trials, rate, is_live)
    whole, trials = whole_counts(np.minimum(ones, MAX_TRIALS), np.minimum(trials, MAX_TRIALS))
    return whole, trials, is_saturated


def _live_pixels(sensor: Sensor, shape: tuple[int, ...]) -> Mask:
    """Return the pixels that the mask of a sensor does not mark, (H, W)."""
    is_live = np.ones(shape, bool) if sensor.mask is None else ~sensor.mask
    check_any_valid(is_live)
    return is_live


def _levels(pixel: Detector, light: float, sensor: Sensor) -> Array:
    """Return the intensities near which counts are taken, in ascending order."""
    largest = sensor.max_intensity
    half = 1 / (pixel.efficiency * light * pixel.dead_time)
    least = _MIN_SHARE * min(largest, half)
    return np.geomspace(least, largest, int(np.log(largest / least) / _STEP) + 2)


def _average(
    counts: npt.NDArray[np.integer],
    is_live: Mask,
    mean: Array,
    levels: Array,
    known: Array,
    max_count: int,
) -> tuple[Array, Mask]:
    """Return the intensity that the counts around each pixel state, and whether all are saturated.

    `mean` and `known` are the mean count and the information at each of the `levels`.
    """
    from scipy.ndimage import gaussian_filter

    typical = np.interp(counts[is_live].mean(), mean, known * levels**2)
    # A count says as much as this number of detections without a dead time.
    spread = typical_spread(typical, typical)
    half = 0.5 / averaged_pixels(spread)
    total, number = (gaussian_filter(part.astype(np.float64), spread) for part in (counts, is_live))
    average = total / np.maximum(number, 1e-9)
    inside = np.clip(average, half, max_count - half)
    return np.asarray(np.interp(inside, mean, levels)), average > max_count - half


def _scores(
    pixel: Detector,
    counts: npt.NDArray[np.integer],
    lights: Array,
    places: npt.NDArray[np.integer],
) -> Array:
    """Return the derivative of log P(N = n) by the light of each pixel, (H, W).

    Pixels with the same count and the same light share one.
    """
    pairs, of_pixels = np.unique(counts * lights.size + places, return_inverse=True)
    each, place = np.divmod(pairs, lights.size)
    return np.asarray(pixel.score(each, lights[place])[of_pixels].reshape(counts.shape))
