"""The estimate of a window, by the same functions as `jotlight reconstruct`."""

import dataclasses
import time
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import AnyIntegers, Image
from jotlight.errors import warn
from jotlight.estimators.demosaicing import COLORS
from jotlight.evaluation.choice import Choice
from jotlight.evaluation.contradictions.clipping import clipping_of, with_clipping_of
from jotlight.evaluation.many_trials import MAX_NETWORK_TRIALS, trials_of
from jotlight.evaluation.methods import COLOR_NETWORK, is_iterative, needs_bits
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.request import Request
from jotlight.formats.capture import CountStack
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.channels import last_channel_axis
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.pixel_counts import Data
from jotlight.sensing.likelihood.multibit import ReadingLikelihood
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor
from jotlight.view.counted import EQUIVALENT, ONES, Counted, counted_by
from jotlight.view.state import COUNTS
from jotlight.view.viewed import Check, Viewable

DEMOSAICING = "differences"
"""How the planes of a mosaic become an image. It needs no extra."""

_MAX_BRIEF_PIXELS = 1 << 20
"""Number of pixels whose maximum likelihood one thread finds in a few milliseconds."""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Estimate:
    """An image of a window, and how it was made."""

    image: Image
    """Intensities, or for "counts" fractions of the largest possible counts. (H, W) or (H, W, C).
    """
    counts: AnyIntegers
    """The number of ones of each pixel, or the sum of its readings, without those of dead jots.
    After an alignment, ones along the motion. For "counts", with those of dead jots."""
    trials: float | npt.NDArray[np.float64]
    """The largest possible value of each count, a number or a map. For bits, it is the number of
    binary readings behind the count."""
    sensor: Sensor
    """The sensor of the window."""
    method: str
    title: str
    seconds: float
    data: Data
    """The data of the estimate, for its uncertainty."""
    counted: Counted = ONES
    """What is counted."""

    @property
    def is_function_of_counts(self) -> bool:
        """Whether pixels with the same number of ones have the same value, in a gray image."""
        has_maps = self.sensor.mosaic is not None or bool(self.sensor.maps())
        is_mle = self.method == "mle" and not has_maps and self.sensor.has_plain_bits
        is_pointwise = is_mle or (self.method == COUNTS and self.counted == ONES)
        return is_pointwise and not isinstance(self.trials, np.ndarray) and self.counts.ndim == 2

    @property
    def mean_reading(self) -> float:
        """The mean of all readings, or for bits the fraction of ones."""
        fraction = self.counts.mean(dtype=np.float64) / np.mean(self.trials)
        return float(fraction * self.counted.largest)


def choose(viewed: Viewable, number: int, method: str) -> Choice:
    """Return the choice of a named method for a window, with its largest intensity.

    Raises
    ------
    ValueError
        When the method does not serve the sensor.
    """
    choice = recommend(viewed, number, method)
    if method == COLOR_NETWORK and (best := recommend(viewed, number).method) != method:
        raise ValueError(
            f"method: expected up to {MAX_NETWORK_TRIALS:,} trials per pixel for the color network "
            f"alone, got {trials_of(viewed.sensor(number)):,.0f}; choose {best}, which blends it "
            "with other methods, or a shorter window"
        )
    return choice


def recommend(viewed: Viewable, number: int, method: str | None = None) -> Choice:
    """Return the choice that :func:`jotlight.reconstruct` makes for a window of frames."""
    sensor = viewed.sensor(number)
    takes_colors = sensor.mosaic is not None or viewed.shape[2:] == (COLORS,)
    return Request(method).choose(
        sensor, takes_colors=takes_colors, is_range_known=viewed.is_range_known
    )


def fraction_estimate(viewed: Viewable, counts: AnyIntegers, number: int) -> Estimate:
    """Return the counts as fractions of the largest, for display before any method has run."""
    sensor = viewed.sensor(number)
    counted = counted_by(sensor)
    largest = sensor.trials * counted.largest
    image = (counts / largest).astype(np.float32)
    return Estimate(
        image=image,
        counts=counts,
        trials=largest,
        sensor=sensor,
        method=COUNTS,
        title=counted.title,
        seconds=0.0,
        data=counts,
        counted=counted,
    )


def fraction_at(intensity: float, sensor: Sensor) -> float:
    """Return the expected count of a pixel of some intensity, as a fraction of the largest one.

    Examples
    --------
    >>> round(fraction_at(1.0, jl.Sensor(frames=16)), 4)
    0.6321
    >>> round(fraction_at(1.0, jl.Sensor(frames=16, bit_depth=4)), 4)  # 1 of at most 15 photons
    0.0667
    """
    plain = sensor.without_maps()
    assert isinstance(plain.efficiency, float), "the mean of a map is a number"
    none = np.zeros((1, 0), np.int32)
    total = 0.0
    for group in plain.groups():
        rate = plain.efficiency * group.sensor.light_per_intensity * intensity + plain.dark_counts
        mean, _, _ = ReadingLikelihood(group.sensor.jot_response(), none, False).moments(rate)
        total += len(group.frames) * mean.item()
    return total / (plain.frames * plain.max_reading)


def estimate(
    viewed: Viewable,
    frames: range,
    method: str,
    counts: AnyIntegers,
    merged: Merged | None = None,
    check: Check = lambda: None,
) -> Estimate:
    """Return the estimate of a window by a method, or the fraction of ones for "counts".

    Parameters
    ----------
    viewed : Viewable
        The capture.
    frames : range
        The window.
    method : str
        A key of ``METHODS``, "network-color", or "counts".
    counts : ndarray of int32
        The counts of the window.
    merged : Merged, optional
        The aligned bits of the window. Default: the frames are summed as they are.
    check : callable, optional
        A function that raises CancelledError when the estimate is no longer wanted.

    Raises
    ------
    CancelledError
        When `check` raises it.
    ValueError, TypeError, ImportError
        When the method does not serve the sensor or the data, or a package is missing.
    """
    if method == COUNTS:
        return fraction_estimate(viewed, counts, len(frames))
    choice = choose(viewed, len(frames), method)
    sensor = viewed.sensor(len(frames)).replace(max_intensity=choice.max_intensity)
    counted = counted_by(sensor)
    trials: float | npt.NDArray[np.float64] = sensor.trials * counted.largest
    data: Data
    if merged is not None:
        sensor = without_mosaic(sensor)
        is_plain = sensor.has_plain_bits
        own = sensor if is_plain else merged.sensor.replace(max_intensity=choice.max_intensity)
        data = dataclasses.replace(merged, sensor=own)
        counts, trials = np.asarray(merged.ones), merged.trials
        counted = ONES if is_plain else EQUIVALENT
    elif _suffice(sensor, method):
        data = counts
    else:
        part = viewed.part(frames)
        data = counts if isinstance(part, CountStack) else part
    options: dict[str, Any] = {}
    # The color network is chosen where it is recommended. Along a motion, pixels may lack bits of a
    # color, and then another method is.
    if method != COLOR_NETWORK:
        options["method"] = method
        if sensor.mosaic is not None:
            options["demosaicing"] = DEMOSAICING
        if is_iterative(method):
            options["callback"] = lambda _: check()
    if merged is None and sensor.mask is not None:
        counts, trials = _live_counts(counts, data, sensor)
    check()
    start = time.perf_counter()
    with with_clipping_of(choice):
        image, info = reconstruct(
            data,
            sensor if merged is None else None,
            return_info=True,
            channel_axis=last_channel_axis(data),
            threads=1 if method == "mle" and counts.size <= _MAX_BRIEF_PIXELS else None,
            **options,
        )
    seconds = time.perf_counter() - start
    if (remark := clipping_of(choice, float(image.max()))) is not None:
        warn(remark)
    return Estimate(
        image=image,
        counts=counts,
        trials=trials,
        sensor=sensor,
        method=info.method,
        title=info.title,
        seconds=seconds,
        data=data,
        counted=counted,
    )


def _live_counts(
    counts: AnyIntegers, data: Data, sensor: Sensor
) -> tuple[AnyIntegers, npt.NDArray[np.float64]]:
    """Return the counts of the jots that are not dead, and the largest possible values of them."""
    mask, side = sensor.mask, sensor.oversampling
    assert mask is not None, "the caller has checked it"
    largest = sensor.frames * sensor.max_reading
    trials = np.multiply(Bits.from_array(~mask).counts(side), largest, dtype=np.float64)
    if side > 1 and isinstance(data, Bits):
        return data.counts(side, mask=mask), trials
    jots = data.sum() if side > 1 and isinstance(data, Readings) else counts
    if jots.shape[:2] != mask.shape:  # a stack of counts of pixels, which no method takes
        return counts, trials
    live = np.where(mask if jots.ndim == 2 else mask[..., None], 0, jots)
    height, width, *channels = live.shape
    pixels = live.reshape(height // side, side, width // side, side, *channels)
    return np.asarray(pixels.sum(axis=(1, 3))), trials


def _suffice(sensor: Sensor, method: str) -> bool:
    """Return whether the counts of a window have all that a method needs of its bits."""
    are_alike = sensor.oversampling == 1 or not sensor.maps()
    return sensor.has_plain_bits and are_alike and not needs_bits(method, sensor)
