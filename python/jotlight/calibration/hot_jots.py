"""Hot jots in a capture of a scene, for sensors without a dark capture."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.checks import as_counts, real_number, shown, whole_number
from jotlight.interrupts import interruptible
from jotlight.layout import image_channels
from jotlight.progress import Progress, check_progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.channels import last_channel_axis
from jotlight.sensing.bits.counting import check_mask
from jotlight.sensing.parameters.binomial import upper_limit
from jotlight.sensing.parameters.reading_groups import require_plain_bits
from jotlight.sensing.parameters.response import (
    detection_probability,
    inverse_detection_probability,
)
from jotlight.sensing.sensor import Sensor

FALSE_POSITIVE_RATE = 1e-6
"""Default maximum probability that a jot is called hot which is not."""

EXCESS = 4.0
"""Multiple of the light of its neighbors that no jot has without being hot.

A lens spreads a star over several jots. With a Gaussian spread of σ = 0.65 jots or more (a full
width of 1.5), two of the neighbors of each jot have a quarter of its light or more.
"""

MIN_EXCESS = 1.5
"""The same multiple where all neighbors have the same light."""

EXPONENT = 3
"""Exponent of the contrast of the 24 nearest jots. Its power is the multiple between the limits.

A star that is a fraction a brighter than the sky at its peak is at least 0.3 a brighter at two of
its neighbors. With this exponent, their contrast explains the star.
"""


def check_false_positive_rate(rate: float) -> None:
    """Raise ValueError unless a false-positive rate is a number above 0 and up to 0.01.

    Examples
    --------
    >>> check_false_positive_rate(1e-6)
    """
    if not 0 < real_number(rate) <= 0.01:
        raise ValueError(f"false_positive_rate: expected a number in (0, 0.01], got {shown(rate)}")


def find_hot_jots(
    data: Bits | npt.ArrayLike,
    *,
    trials: int | None = None,
    threshold: int | None = None,
    mask: npt.NDArray[np.bool_] | None = None,
    false_positive_rate: float = FALSE_POSITIVE_RATE,
    channel_axis: int | None = None,
    threads: int | None = None,
    progress: Progress = False,
) -> npt.NDArray[np.bool_]:
    """Return the jots that detect far more than their neighborhood explains.

    A jot is called hot if its rate of detections is more than c times that of its neighbors, in
    two respects. First, it exceeds c times the mean of its 8 neighbors, with statistical certainty.
    Second, its measured rate exceeds c times that of the second brightest neighbor, which spares
    thin lines and stars. The factor c is 1.5 where the 24 nearest jots have equal light, and up to
    4 where they differ. So weak hot jots in bright parts of the scene, and clusters of three or
    more of them, are not found: a dark capture and :func:`jotlight.calibrate` find them all. Light
    that falls on a single jot, and the sharp end of a line that is one jot wide, look hot.

    Parameters
    ----------
    data : Bits (T, H, W), or array_like of int, shape (H, W)
        Bits, or counts of single jots. A jot of color data is hot if it is in one of the channels.
    trials : int, optional
        Number of binary readings behind each count. Required for counts.
    threshold : int, optional
        q: the number of photons that make a jot report 1. Default: that of the bits' sensor, or 1.
    mask : ndarray of bool, shape (H, W), optional
        True marks dead jots, which are not compared. Default: those of the bits' sensor.
    false_positive_rate : float
        Maximum probability that a jot is called hot whose rate is at most c times the mean of its
        neighbors.
    channel_axis : int, optional
        Axis of counts that holds color channels. Default: none.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

    Returns
    -------
    ndarray of bool, shape (H, W)
        True for hot jots. It has the form of the ``mask`` of a :class:`jotlight.Sensor`.

    Raises
    ------
    TypeError, ValueError
        When the data have another shape, or a number is missing or out of range.

    Notes
    -----
    The mean of the neighbors has an upper confidence limit of Clopper and Pearson with half of the
    false-positive rate. The count of the jot then has a binomial tail probability, which must be
    below the other half. Both are exact, whatever the rates of the neighbors are.

    Examples
    --------
    >>> rates = np.full((32, 32), 0.02)
    >>> rates[5, 7] = 0.5
    >>> bits = jl.Bits.from_array(np.random.default_rng(0).random((200, 32, 32)) < rates)
    >>> np.argwhere(find_hot_jots(bits)).tolist()
    [[5, 7]]
    """
    check_false_positive_rate(false_positive_rate)
    check_progress(progress)
    if isinstance(data, Bits):
        counts, number = data.counts(1, threads=threads, progress=progress), len(data)
        if isinstance(data.sensor, Sensor):
            if threshold is None:
                require_plain_bits(data.sensor)
            threshold = data.sensor.threshold if threshold is None else threshold
            mask = data.sensor.mask if mask is None else mask
        channel_axis = last_channel_axis(counts)
    else:
        if trials is None:
            raise TypeError("trials: expected the number of binary readings behind each count")
        counts, number = as_counts(data), whole_number("trials", trials, 1)
    if counts.max() > number:
        raise ValueError(f"counts: expected at most {number} trials, got {counts.max()}")
    channels = image_channels("counts", counts, channel_axis)
    size = channels.shape[1:]
    check_mask(mask, size)
    valid = np.ones(size, bool) if mask is None else ~mask
    hot = np.zeros(size, bool)
    for channel in channels:
        hot |= _find(channel, valid, number, threshold or 1, false_positive_rate)
    return hot


def hot_jots_unknown_reason(data: object, sensor: Sensor) -> str | None:
    """Return why hot jots cannot be searched in data of a sensor, or None if they can.

    Parameters
    ----------
    data : Bits, or other data
        The capture. All data but bits are counts of the sensor's pixels, or readings of them.
    sensor : Sensor
        The sensor.

    Examples
    --------
    >>> hot_jots_unknown_reason(None, jl.Sensor(frames=4)) is None
    True
    >>> hot_jots_unknown_reason(None, jl.Sensor(bit_depth=4)).partition(";")[0]
    'expected single bits, got readings of 4 bits'
    """
    mask = "pass the known hot jots with mask= (--mask)"
    if np.ndim(sensor.threshold):
        return (
            "expected one threshold, because the ones of jots with different thresholds cannot be "
            f"compared, got several; {mask}"
        )
    if sensor.mosaic is not None:
        return (
            "expected a gray sensor, because jots with different filters cannot be compared, got "
            f"the mosaic {sensor.mosaic!r}; `jotlight calibrate` with a dark capture finds hot jots"
        )
    if sensor.bit_depth > 1:
        return f"expected single bits, got readings of {sensor.bit_depth} bits; {mask}"
    side = sensor.oversampling
    if side > 1 and not isinstance(data, Bits):
        return (
            "expected bits, or counts of single jots, but these are counts of pixels of "
            f"{side} x {side} jots"
        )
    return None


def hot_jots_of(
    counts: npt.NDArray[np.integer], trials: int, sensor: Sensor
) -> npt.NDArray[np.bool_]:
    """Return the hot jots of a sensor (H, W), which see counts (H, W) or (H, W, C) of its jots.

    :func:`hot_jots_unknown_reason` has to be None.

    Examples
    --------
    >>> counts = np.full((32, 32), 40)
    >>> counts[5, 7] = 1000
    >>> np.argwhere(hot_jots_of(counts, 2000, jl.Sensor(frames=2000))).tolist()
    [[5, 7]]
    """
    return find_hot_jots(
        counts,
        trials=trials,
        threshold=sensor.threshold,
        mask=sensor.mask,
        channel_axis=last_channel_axis(counts),
    )


def fewest_trials(counts: npt.ArrayLike, trials: int, *, threshold: int = 1) -> int:
    """Return the number of trials from which :func:`find_hot_jots` can find hot jots.

    It holds for the median brightness of counts, where neighbors have different light. With fewer
    trials, a jot that always reports 1 may do so by chance. Where all jots report 1, no number
    suffices, and the result is the largest int32.

    Examples
    --------
    >>> fewest_trials(np.full((8, 8), 8), 64), fewest_trials(np.full((8, 8), 32), 64)
    (17, 225)
    """
    light = _light(np.atleast_1d(np.median(as_counts(counts)).astype(np.int32)), trials, threshold)
    explained = float(detection_probability(threshold, EXCESS * light)[0])
    most = np.iinfo(np.int32).max
    if explained == 0:
        return 1
    limit = np.log(FALSE_POSITIVE_RATE / 2) / np.log(explained) if explained < 1 else most
    return int(np.ceil(min(limit, most)))


@interruptible
def _find(
    counts: npt.NDArray[np.int32],
    valid: npt.NDArray[np.bool_],
    trials: int,
    threshold: int,
    rate: float,
) -> npt.NDArray[np.bool_]:
    """Return the hot jots of one channel."""
    from scipy.special import bdtrc

    padded = np.pad(np.where(valid, counts, -1), 1, constant_values=-1)
    neighbors = _neighbors(padded, 1)
    total = np.maximum(neighbors, 0).sum(0).astype(np.float64)
    readings = (neighbors >= 0).sum(0) * float(trials)
    # A line that ends at the edge of the image continues outside.
    mirrored = np.pad(padded[1:-1, 1:-1], 2, mode="reflect")
    second = np.partition(_neighbors(mirrored[1:-1, 1:-1], 1), -2, axis=0)[-2]
    # Few jots can be hot. The other steps take longer.
    candidates = valid & (counts > second) & (readings > 0)
    factor = _largest_excess(_neighbors(mirrored, 2, candidates), trials, threshold)
    light = _light(counts[candidates], trials, threshold)
    brighter = light > factor * _light(np.maximum(second[candidates], 0), trials, threshold)
    candidates[candidates] = brighter
    factor = factor[brighter]
    ones, total, readings = counts[candidates], total[candidates], readings[candidates]
    saturated = total >= readings
    limit, complement = upper_limit(total, readings - total, rate / 2)
    highest = inverse_detection_probability(threshold, limit, complement)
    explained = np.asarray(detection_probability(threshold, factor * highest))
    tail = bdtrc(ones - 1.0, trials, np.where(saturated, 1.0, explained))
    hot = np.zeros(counts.shape, bool)
    hot[candidates] = tail <= rate / 2
    return hot


def _largest_excess(neighbors: npt.NDArray[np.int32], trials: int, threshold: int) -> Array:
    """Return the multiple of its neighbors' light that a jot may have, from 24 neighbors (24, n).

    Where the light changes little from jot to jot, it does not change much at one of them.
    """
    known = np.where(neighbors < 0, np.median(neighbors, axis=0).astype(np.int32), neighbors)
    ordered = np.partition(known, (1, -2), axis=0)
    low, high = (_light(np.maximum(each, 0), trials, threshold) for each in ordered[[1, -2]])
    contrast = np.divide(high, low, out=np.full(low.shape, EXCESS), where=low > 0)
    return np.asarray(np.clip(contrast**EXPONENT, MIN_EXCESS, EXCESS))


def _neighbors(
    padded: npt.NDArray[np.int32], radius: int, wanted: npt.NDArray[np.bool_] | None = None
) -> npt.NDArray[np.int32]:
    """Return the counts of the neighbors of all jots (n, H, W), or of the wanted ones."""
    height, width = (length - 2 * radius for length in padded.shape)
    side = range(2 * radius + 1)
    places = [(row, column) for row in side for column in side if (row, column) != (radius, radius)]
    views = [padded[row : row + height, col : col + width] for row, col in places]
    return np.stack(views if wanted is None else [view[wanted] for view in views])


def _light(counts: npt.NDArray[np.int32], trials: int, threshold: int) -> Array:
    """Return the most likely detected photons per frame. A count of all trials is half less."""
    fractions = np.minimum(counts, trials - 0.5) / trials
    return np.asarray(inverse_detection_probability(threshold, fractions, 1 - fractions))
