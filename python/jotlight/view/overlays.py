"""Maps over the image: dead, hot, and saturated jots, and the standard error."""

import threading
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Levels
from jotlight.calibration.hot_jots import hot_jots_of, hot_jots_unknown_reason
from jotlight.evaluation.methods import COLOR_NETWORK
from jotlight.evaluation.uncertainty import check_errors_known, uncertainty
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.channels import last_channel_axis
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.slices import frames_text
from jotlight.view.counted import EQUIVALENT
from jotlight.view.estimate import DEMOSAICING, Estimate
from jotlight.view.state import COUNTS
from jotlight.view.viewed import Viewable, count_frames, frame_bytes, whole_cycles

DEAD, HOT = 1, 2
"""Values of a map of jots."""

_MAX_BYTES = 1 << 26
"""Maximum number of bytes of bits in which hot jots are searched."""


class JotMap:
    """The dead and the hot jots of a capture, searched once.

    Parameters
    ----------
    viewed : Viewable
        The capture.
    """

    def __init__(self, viewed: Viewable) -> None:
        self._viewed = viewed
        self._lock = threading.Lock()
        self._map: Levels | None = None
        self._note = ""
        self.is_searched = False
        """Whether hot jots have been searched."""

    def find(self) -> tuple[Levels, str]:
        """Return a map of the jots, with 1 for dead and 2 for hot ones, and how it was found."""
        with self._lock:
            if self._map is None:
                part = self._viewed.part(self._viewed.frames[-1:])
                reason = hot_jots_unknown_reason(part, self._viewed.sensor(self._viewed.cycle))
                self._map, self._note = _find_jots(self._viewed, reason)
                self.is_searched = reason is None
            return self._map, self._note


def _find_jots(viewed: Viewable, reason: str | None) -> tuple[Levels, str]:
    """Return a map of the jots, and how it was found, unless there is a reason against a search."""
    frames = viewed.frames[: whole_cycles(viewed, _MAX_BYTES // frame_bytes(viewed))]
    sensor = viewed.sensor(len(frames))
    if reason is not None:
        side = sensor.oversampling
        dead = np.zeros((side * viewed.shape[0], side * viewed.shape[1]), np.uint8)
        if sensor.mask is not None:
            dead[sensor.mask] = DEAD
        return dead, f"hot jots are not searched: {reason}"
    data = viewed.part(frames)
    counts: npt.NDArray[np.integer]
    if isinstance(data, Bits):
        counts, trials = data.counts(1), len(data)
    else:
        counts, trials = count_frames(viewed, frames), sensor.trials
    hot = hot_jots_of(counts, trials, sensor)
    found = np.where(hot, HOT, 0).astype(np.uint8)
    if sensor.mask is not None:
        found[sensor.mask] = DEAD
    number = int(np.count_nonzero(found == DEAD))
    note = f"{number} dead, {int(hot.sum())} hot, from {frames_text(frames)}"
    return found, note


def find_saturated(estimate: Estimate) -> Levels:
    """Return 1 for the pixels whose bits are all 1, or whose readings are all the largest one.

    Raises
    ------
    ValueError
        For equivalent counts, which do not show whether all readings were the largest one, and for
        counts of pixels that also have dead jots.

    Examples
    --------
    >>> counts = np.array([[3, 4]], np.int32)
    >>> made = Estimate(
    ...     image=counts.astype(np.float32), counts=counts, trials=4, sensor=jl.Sensor(frames=4),
    ...     method="mle", title="", seconds=0.0, data=counts,
    ... )
    >>> find_saturated(made).tolist()
    [[0, 1]]
    """
    if estimate.counted == EQUIVALENT:
        raise ValueError(
            "saturated: equivalent counts do not show whether all readings were the largest one; "
            "turn the alignment off"
        )
    mask, trials = estimate.sensor.mask, estimate.trials
    if mask is not None and estimate.method == COUNTS:
        if estimate.sensor.oversampling > 1:
            raise ValueError(
                "saturated: the counts of a pixel are also those of its dead jots; choose a method"
            )
        trials = np.where(mask, 0.0, trials)
    if isinstance(trials, np.ndarray) and trials.ndim < estimate.counts.ndim:
        trials = trials[..., None]
    saturated = (estimate.counts >= trials) & (np.asarray(trials) > 0)
    is_color = estimate.counts.ndim == 3
    return np.asarray(np.any(saturated, axis=2) if is_color else saturated, np.uint8)


def find_errors(estimate: Estimate) -> npt.NDArray[np.float32]:
    """Return the standard error of each pixel, (H, W) or (H, W, C). It is inf without data.

    Raises
    ------
    ValueError
        When the errors of the method are unknown, and for counts, which are no estimate.
    """
    if estimate.method == COUNTS:
        raise ValueError("uncertainty: counts are no estimate; choose a method")
    method = estimate.method
    has_planes = estimate.sensor.mosaic is not None and method != COLOR_NETWORK
    check_errors_known(method, estimate.sensor)
    return uncertainty(
        estimate.data,
        None if isinstance(estimate.data, Merged) else estimate.sensor,
        method=method,
        demosaicing=DEMOSAICING if has_planes else None,
        estimate=estimate.image,
        channel_axis=last_channel_axis(estimate.data),
    ).standard_error


def error_levels(error: npt.NDArray[np.float32]) -> tuple[Levels, dict[str, Any]]:
    """Return standard errors in 255 levels, the error of the highest level, and the median.

    The highest level is the 99.5th percentile, and the facts state whether errors exceed it.

    Of colors, the largest error counts. Pixels without data have the highest level.

    Examples
    --------
    >>> error_levels(np.array([[0.0, 0.5, 1.0]], np.float32))[0].tolist()
    [[0, 128, 255]]
    """
    if error.ndim == 3:
        error = error.max(axis=2)
    finite = error[np.isfinite(error)]
    largest = float(np.percentile(finite, 99.5)) if finite.size else 1.0
    largest = largest if largest > 0 else 1.0
    levels = np.rint(255 * np.clip(np.nan_to_num(error, posinf=largest) / largest, 0, 1))
    median = float(np.median(finite)) if finite.size else None
    facts = {"largest": largest, "is_exceeded": bool((finite > largest).any()), "median": median}
    return levels.astype(np.uint8), facts
