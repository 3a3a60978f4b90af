"""How far the estimate of maximum likelihood may be from the truth, pixel by pixel."""

import dataclasses
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.errors import JotlightWarning
from jotlight.estimators.light_inversion import Inverse, UniqueCounts, light_of, maps_of
from jotlight.estimators.mle import mle
from jotlight.sensing.bits import Bits
from jotlight.sensing.channels import stack_channels
from jotlight.sensing.likelihood import Likelihood
from jotlight.sensing.pixel_counts import (
    PixelCounts,
    count_pixels,
    split_channels,
    warn_about_smooth_kernel,
)
from jotlight.sensing.response import Array
from jotlight.sensing.sensor import Sensor


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """What is known of each pixel's intensity; all arrays are of the picture's shape."""

    standard_error: npt.NDArray[np.float32]
    """Of the estimate, in units of intensity; inf for a dead pixel."""
    low: npt.NDArray[np.float32]
    """Lower end of the interval, in units of intensity."""
    high: npt.NDArray[np.float32]
    """Upper end; S where there is none."""
    unlit: npt.NDArray[np.bool_]
    """No more ones than dark counts explain: the interval reaches down to 0."""
    saturated: npt.NDArray[np.bool_]
    """All valid bits are 1: any more light would look the same."""
    dead: npt.NDArray[np.bool_]
    """No valid bit: nothing is known."""
    confidence_level: float
    """The coverage of the intervals."""

    def flags(self) -> npt.NDArray[np.uint8]:
        """1 for unlit, 2 for saturated and 4 for dead pixels, 0 for others."""
        return np.asarray(1 * self.unlit + 2 * self.saturated + 4 * self.dead, np.uint8)

    def arrays(self, scale: float = 1.0) -> dict[str, npt.NDArray[Any]]:
        """Give standard error, ends of the interval, times `scale`, and flags by name."""
        numbers = {
            name: np.asarray(getattr(self, name) * np.float32(scale))
            for name in ("standard_error", "low", "high")
        }
        return {**numbers, "flags": self.flags()}


def uncertainty(
    data: Bits | npt.ArrayLike,
    sensor: Sensor,
    *,
    confidence_level: float = 0.95,
    threads: int | None = None,
) -> Uncertainty:
    """Standard error and confidence interval of `jotlight.mle` for each pixel.

    Parameters
    ----------
    data : Bits or array_like of int
        Bits, or an image of counts L of shape (H, W) or (H, W, C).
    sensor : Sensor
        As for `jotlight.mle`.
    confidence_level : float
        Coverage of the intervals, from 0.5 to below 1.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    Uncertainty
        Arrays of shape (H, W) or (H, W, C), in units of intensity.

    Raises
    ------
    TypeError, ValueError
        When data and sensor do not fit, or the confidence_level is out of range.

    Warns
    -----
    JotlightWarning
        When the kernel is smooth: the interval then is that of the mean light on the pixel's jots.

    Notes
    -----
    The standard error is ``(K/α) I^(-1/2)``, I the Fisher information of the pixel's bits about the
    light s, at the estimate; where no bit or every bit is 1 it is taken half a count away from
    there, so that it is neither 0 nor infinite. With few bits or near the ends the interval tells
    more.

    The interval is that of Clopper and Pearson for the probability p that a bit is 1, carried to
    intensities by the monotone response P(q, η s + d) and clipped to [0, S]. Its coverage is at
    least `confidence_level` for any number of bits and any true intensity in [0, S]; near 0 and saturation,
    and with few bits, it is well above. Where jots of one pixel differ, p is their mean: the sum
    of different bits varies less than a binomial count (Hoeffding 1956), so the coverage holds and
    the interval is somewhat wider than it need be. It then takes bits, as `jotlight.mle` does.

    Examples
    --------
    >>> known = uncertainty(np.array([[0, 50, 100]]), Sensor(frames=100, max_intensity=10.0))
    >>> known.standard_error.round(3)
    array([[0.007, 0.1  , 1.411]], dtype=float32)
    >>> known.low.round(2), known.high.round(2)
    (array([[0.  , 0.51, 3.32]], dtype=float32), array([[ 0.04,  0.92, 10.  ]], dtype=float32))
    >>> known.flags().tolist()
    [[1, 0, 2]]
    """
    if not 0.5 <= confidence_level < 1:
        raise ValueError(
            f"confidence_level: expected a coverage from 0.5 to below 1, got {confidence_level!r}"
        )
    warn_about_smooth_kernel(sensor)
    each = [
        _of_channel(channel, sensor, confidence_level, threads) for channel in split_channels(data)
    ]
    color = (len(data.shape) - 1 if isinstance(data, Bits) else np.ndim(data)) == 3
    stacked = {
        field.name: stack_channels([getattr(one, field.name) for one in each], color=color)
        for field in dataclasses.fields(Uncertainty)
        if field.name != "confidence_level"
    }
    return Uncertainty(confidence_level=confidence_level, **stacked)


def _of_channel(
    data: Bits | npt.NDArray[np.int32], sensor: Sensor, confidence_level: float, threads: int | None
) -> Uncertainty:
    seen = count_pixels(data, sensor, threads)
    if seen.varies_within_pixels and not isinstance(data, Bits):
        raise ValueError(
            "counts: where jots of one pixel differ in their efficiency or dark counts the bits "
            "are needed, since a count does not tell which jots fired"
        )
    trials = np.broadcast_to(np.asarray(seen.trials, np.int64), seen.counts.shape)
    dead = trials == 0
    saturated = (seen.counts == trials) & ~dead
    distinct = UniqueCounts(seen)
    inverse = light_of(seen, distinct)
    bounds = _clopper_pearson(distinct, (1 - confidence_level) / 2, seen.varies_within_pixels)
    per_light = 1 / sensor.light_per_intensity
    most = sensor.max_intensity
    low, high = (np.clip(inverse(p, rest) * per_light, 0, most) for p, rest in bounds)
    low[dead], high[dead | saturated] = 0, most
    return Uncertainty(
        standard_error=_standard_error(data, seen, distinct, inverse, threads).astype(np.float32),
        low=low.astype(np.float32),
        high=high.astype(np.float32),
        unlit=(low <= 0) & ~dead,
        saturated=saturated,
        dead=dead,
        confidence_level=confidence_level,
    )


def _clopper_pearson(
    distinct: UniqueCounts, tail: float, differ: bool
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The ends of the interval for p of each distinct pair, each with its complement."""
    from scipy.special import betainccinv, betaincinv

    ones, bits = distinct.ones, distinct.bits
    zeros = bits - ones
    with np.errstate(all="ignore"):
        low = np.where(ones > 0, betaincinv(np.maximum(ones, 1), zeros + 1, tail), 0.0)
        above_low = np.where(ones > 0, betainccinv(zeros + 1, np.maximum(ones, 1), tail), 1.0)
        dark = np.where(zeros > 0, betaincinv(np.maximum(zeros, 1), ones + 1, tail), 0.0)
        high = np.where(zeros > 0, betainccinv(ones + 1, np.maximum(zeros, 1), tail), 1.0)
    if differ:
        # A lone 1 (or 0) among bits that differ is the one case in which the binomial tail is not
        # the larger one; the sum of the probabilities bounds it.
        share = tail / np.maximum(bits, 1)
        low, above_low = np.where(ones == 1, share, low), np.where(ones == 1, 1 - share, above_low)
        dark, high = np.where(zeros == 1, share, dark), np.where(zeros == 1, 1 - share, high)
    return (low, above_low), (high, dark)


def _standard_error(
    data: Bits | npt.NDArray[np.int32],
    seen: PixelCounts,
    distinct: UniqueCounts,
    inverse: Inverse,
    threads: int | None,
) -> Array:
    """(K/α) I^(-1/2) at the estimate, kept half a count from where no bit or every bit is 1."""
    sensor = seen.sensor
    per_light = sensor.light_per_intensity
    trials = distinct.spread(distinct.bits)
    bits = np.maximum(distinct.bits, 1)
    inside = np.clip(distinct.ones, 0.5, bits - 0.5) / bits
    if seen.varies_within_pixels:
        estimate = _likely(data, seen, threads) * per_light
        edge = (seen.counts == 0) | (seen.counts == trials)
        light = np.where(edge, inverse(inside, 1 - inside), estimate)
    else:
        light = inverse(inside, 1 - inside)
    light = np.clip(light, 0, sensor.max_intensity * per_light)
    side = sensor.oversampling if seen.varies_within_pixels else 1
    cells = (light.shape[0] * side, light.shape[1] * side)
    spread = light.repeat(side, 0).repeat(side, 1)
    if seen.varies_within_pixels:
        efficiency, dark, alive = maps_of(sensor)
        number = np.broadcast_to(np.where(alive, sensor.frames, 0), cells)
    else:
        efficiency, dark, number = seen.efficiency, seen.dark_counts, trials
    known = Likelihood(
        np.zeros(cells, np.int32),
        np.ascontiguousarray(number),
        threshold=sensor.threshold,
        efficiency=efficiency,
        dark_counts=dark,
        threads=threads,
    ).information(spread)
    blocks = known.reshape(light.shape[0], side, light.shape[1], side).sum(axis=(1, 3))
    with np.errstate(divide="ignore"):
        return np.asarray(1 / (np.sqrt(blocks) * per_light))


def _likely(
    data: Bits | npt.NDArray[np.int32], seen: PixelCounts, threads: int | None
) -> npt.NDArray[np.float32]:
    """The estimate, without a word on dead pixels, which the picture itself has said."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", JotlightWarning)
        return mle(data, seen.sensor, threads=threads)
