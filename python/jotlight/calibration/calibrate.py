"""Calibration of a sensor: dark counts, hot and dead jots, and response, from two captures."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts
from jotlight.calibration.bulk import fit_bulk
from jotlight.calibration.captured_sensor import captured_threshold
from jotlight.calibration.evenness import warn_about_scene
from jotlight.calibration.flat import measure_response
from jotlight.calibration.hot_jots import check_false_positive_rate
from jotlight.calibration.jot_counts import JotCounts
from jotlight.calibration.jot_mosaics import mosaic_of_jots
from jotlight.calibration.result import Calibration, check_same_jots
from jotlight.calibration.steadiness import Steadiness, steadiness, warn_about_unsteady_frames
from jotlight.checks import as_counts, positive_number, real_number, shown
from jotlight.errors import warn
from jotlight.paths import refuse_path
from jotlight.progress import Progress, equal_steps, shown_progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.response import inverse_detection_probability

MAX_DARK = 0.1
"""Default dark counts per frame above which a hot jot is masked.

`docs/results/calibration.md` has the measurement behind this number.
"""

_MIN_JOTS = 64
"""Minimum number of jots in which the ordinary ones can be found."""


# All but the two captures are keyword-only and documented, so eleven parameters read well.
def calibrate(
    dark: Bits | npt.ArrayLike,
    flat: Bits | npt.ArrayLike | None = None,
    *,
    frames: int | None = None,
    flat_frames: int | None = None,
    threshold: int | None = None,
    false_positive_rate: float = 1e-4,
    max_dark: float = MAX_DARK,
    provenance: dict[str, Provenance] | None = None,
    mosaic: object = None,
    threads: int | None = None,
    progress: Progress = False,
) -> Calibration:
    """Return the calibration of a sensor from a dark capture and, optionally, a flat one.

    Parameters
    ----------
    dark : Bits or array_like of int, shape (H, W)
        Frames without light, or the counts of ones over such frames.
    flat : Bits or array_like of int, shape (H, W), optional
        The same for an evenly lit surface, out of focus, with the exposure time of the dark
        capture. About half of the bits should be ones.
    frames, flat_frames : int, optional
        T: the number of frames of counts. Bits do not need it. Default of `flat_frames`: `frames`.
    threshold : int, optional
        q: the number of photons that make a jot report 1. Default: that of the sensor that the
        bits carry, or 1.
    false_positive_rate : float
        Maximum fraction of ordinary jots that are called hot, and maximum fraction that are called
        dead. Counts are integers, so the actual rate of hot jots is lower:
        `Calibration.hot_probability`.
    max_dark : float
        Dark counts per frame above which a hot jot is masked. Reconstruction uses the other hot
        jots, with their dark counts.
    provenance : dict, optional
        Where the captures come from, with the keys ``"dark"`` and ``"flat"``. The calibration keeps
        it. Default: the provenance of the bits.
    mosaic : str, array_like, or jotlight.Mosaic, optional
        The color filter of each jot, as :class:`jotlight.Sensor` takes the filters of pixels. The
        response of a jot is then relative to that of the jots behind the same filter, and the
        calibration keeps the filters. Default: those of the sensor that the flat bits carry, or
        none.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

    Returns
    -------
    Calibration

    Raises
    ------
    TypeError, ValueError
        If the captures contradict the other arguments, or their sensor has read noise or several
        gains or thresholds.

    Warns
    -----
    JotlightWarning
        If frames are correlated, if the rates change over time, if there are too few frames to
        distinguish hot jots from ordinary ones at the false-positive rate, if the dark capture
        shows a scene, if the light of the flat capture is not even, and if most hot jots do not
        have their dark counts in the flat capture.
    PeriodicRatesWarning
        If the rates of the flat capture repeat, as under color filters, and no `mosaic` is stated.

    Notes
    -----
    A jot is hot if the distribution of the ordinary jots does not explain its count: see
    :func:`jotlight.calibration.fit_bulk`. Its dark counts are the most likely ones. Those of the
    other jots are shrunk toward their mean according to their counting noise, for threshold 1, and
    the most likely ones for higher thresholds.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> counts = rng.binomial(4096, 0.002, (64, 64))
    >>> counts[10, 20] = 4096
    >>> calibration = jl.calibrate(counts, frames=4096)
    >>> np.argwhere(calibration.mask).tolist()
    [[10, 20]]
    >>> calibration.sensor(frames=16)
    Sensor(frames=16, dark_counts=<64 x 64 map>, mask=<64 x 64 map>)
    """
    check_limits(false_positive_rate, max_dark)
    threshold = captured_threshold(threshold, dark=dark, flat=flat)
    if mosaic is not None and flat is None:
        raise ValueError("mosaic: is for a flat capture, and there is none; leave it out")
    known = _provenance(dark=dark, flat=flat) if provenance is None else dict(provenance)
    if "dark" in known and "flat" in known:
        check_same_jots("flat", known["flat"], "dark", known["dark"])
    if flat_frames is None and not isinstance(flat, Bits):
        flat_frames = frames
    with shown_progress(progress, "calibrating") as update:
        begin = equal_steps(update, 1 if flat is None else 2)
        sums = count_jots("dark", dark, frames, threads, begin("the dark capture"))
        bright = None
        if flat is not None:
            bright = count_jots("flat", flat, flat_frames, threads, begin("the flat capture"))
            filters = mosaic_of_jots(flat, mosaic, bright.ones.shape)
            bright = dataclasses.replace(bright, mosaic=filters)
    return calibrate_sums(sums, bright, threshold, false_positive_rate, max_dark, known)


@dataclasses.dataclass(frozen=True)
class JotSums:
    """What a calibration needs from a dark or a flat capture."""

    ones: Counts
    """Number of ones of each jot, (H, W)."""
    frames: int
    steadiness: Steadiness | None
    """Results of the tests of the frames, if the frames are known."""
    mosaic: Mosaic | None = None
    """The color filters of the jots, or None for a gray sensor."""


def check_limits(false_positive_rate: float, max_dark: float) -> None:
    """Raise ValueError for a rate or a number of dark counts out of range."""
    check_false_positive_rate(false_positive_rate)
    positive_number("max_dark", max_dark)


def check_jots(dark: tuple[int, ...], flat: tuple[int, ...] | None) -> None:
    """Raise ValueError for captures of too few jots, and for captures of different sizes.

    Examples
    --------
    >>> check_jots((8, 8), (8, 16))
    Traceback (most recent call last):
      ...
    ValueError: flat: expected the dark capture's 8 x 8 jots, got 8 x 16
    """
    if math.prod(dark) < _MIN_JOTS:
        raise ValueError(
            f"dark: expected {_MIN_JOTS} jots or more to find the ordinary ones, got "
            f"{math.prod(dark)}"
        )
    if flat is not None and flat != dark:
        raise ValueError(
            f"flat: expected the dark capture's {' x '.join(map(str, dark))} jots, got "
            f"{' x '.join(map(str, flat))}"
        )


def calibrate_sums(
    dark: JotSums,
    flat: JotSums | None,
    threshold: int,
    false_positive_rate: float,
    max_dark: float,
    provenance: dict[str, Provenance],
) -> Calibration:
    """Return the calibration from the sums of a dark capture and, optionally, of a flat one.

    See :func:`calibrate` for the parameters.
    """
    ones, number = dark.ones, dark.frames
    check_jots(ones.shape, None if flat is None else flat.ones.shape)
    bulk = fit_bulk(ones, number)
    hot_threshold = bulk.threshold(false_positive_rate)
    dark_counts = JotCounts(ones, number, threshold).detections()
    if (ones == number).all():
        raise ValueError("dark: expected some jots that do not report 1 in every frame, got none")
    hot = ones >= hot_threshold
    # A jot that reported 1 in every frame has no finite rate.
    mask = hot & ((dark_counts > max_dark) | (ones == number))
    if threshold == 1:
        # The counting noise of a short capture would be a pattern in every estimate. For higher
        # thresholds, missed hot jots dominate the mean, and its root would be far too many counts.
        likely = bulk.shrunk_probabilities(ones[~hot])
        dark_counts[~hot] = inverse_detection_probability(1, likely, 1 - likely)
    found = Calibration(
        dark_counts=dark_counts.astype(np.float32),
        mask=mask,
        hot=hot,
        dead=np.zeros(ones.shape, bool),
        threshold=threshold,
        false_positive_rate=false_positive_rate,
        max_dark=max_dark,
        bulk=bulk,
        hot_threshold=hot_threshold,
        hot_probability=bulk.tail_probability(hot_threshold),
        dark_ones=ones,
        dark_frames=number,
        dark_steadiness=dark.steadiness,
        provenance=provenance,
    )
    if hot_threshold > number:
        warn(
            f"dark: no jot is called hot, since {found.insufficient_frames_reason()}, more than "
            f"the rate of {false_positive_rate:.2g}; record more frames, or frames with fewer dark "
            "counts"
        )
    warn_about_unsteady_frames("dark", dark.steadiness, false_positive_rate)
    warn_about_scene(ones / number, hot)
    return found if flat is None else _with_flat(found, flat)


def _with_flat(found: Calibration, flat: JotSums) -> Calibration:
    """Return the calibration with the results of the flat capture."""
    ones, number = flat.ones, flat.frames
    measured = measure_response(
        JotCounts(ones, number, found.threshold),
        JotCounts(found.dark_ones, found.dark_frames, found.threshold),
        found.mask,
        false_positive_rate=found.false_positive_rate,
        filters=None if flat.mosaic is None else flat.mosaic.full(*ones.shape),
    )
    warn_about_unsteady_frames("flat", flat.steadiness, found.false_positive_rate)
    efficiency = np.minimum(measured.relative / measured.relative.max(), 1).astype(np.float32)
    mask = found.mask | measured.dead
    return dataclasses.replace(
        found,
        mask=mask,
        dead=measured.dead,
        efficiency=efficiency,
        # Networks assume the median jot, so this jot gets one detection at intensity 1.
        scale=1 / float(np.median(efficiency[~mask])),
        flat_ones=ones,
        flat_frames=number,
        prnu=measured.prnu,
        prnu_error=measured.prnu_error,
        flat_noise=measured.noise,
        flat_steadiness=flat.steadiness,
        mosaic=flat.mosaic,
    )


def count_jots(
    name: str,
    data: Bits | npt.ArrayLike,
    frames: int | None,
    threads: int | None,
    progress: Callable[[float], object],
) -> JotSums:
    """Return what a calibration needs from a capture, named in messages."""
    refuse_path(data)
    if isinstance(data, Readings):
        raise ValueError(
            f"{name}: expected single bits or counts of ones, got readings of "
            f"{data.sensor.bit_depth} bits; state their measured dark_counts, efficiency, and mask "
            "in the Sensor"
        )
    if isinstance(data, Bits):
        if len(data.shape) != 3:
            raise ValueError(
                f"{name}: expected frames of one channel, got {data.shape[3]}; calibrate each "
                "channel by itself"
            )
        if frames is not None and frames != len(data):
            raise ValueError(
                f"frames: expected the {len(data)} of the {name} bits, got {shown(frames)}"
            )
        ones = data.counts(1, threads=threads)
        return JotSums(ones, len(data), steadiness(data, threads=threads, progress=progress))
    ones = as_counts(data)
    if ones.ndim != 2:
        raise ValueError(
            f"{name}: expected jotlight.Bits, or counts of ones of one channel (H, W), got shape "
            f"{ones.shape}; Bits.from_array packs frames (T, H, W) of 0 and 1"
        )
    if frames is None:
        raise ValueError(
            f"frames: {name} holds counts, and their number of frames is unknown; pass frames "
            "(--frames, --flat-frames)"
        )
    number = real_number(frames)
    if not (1 <= number < 2**31 and ones.max() <= number and number == int(number)):
        raise ValueError(
            f"frames: expected a whole number, at least the largest of the {name} counts, "
            f"{ones.max()}, got {shown(frames)}"
        )
    return JotSums(ones, int(frames), None)


def _provenance(**data: object) -> dict[str, Provenance]:
    return {
        name: part.provenance
        for name, part in data.items()
        if isinstance(part, Bits) and part.provenance is not None
    }
