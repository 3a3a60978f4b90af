"""Counts from images that hold the means of frames, times a scale such as 255."""

from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.checks import Counts

SCALES = 255, 65535
"""Scales of images of means with 8 and with 16 bits."""

_MIN_LEVELS = 3
"""Minimum number of different values from which scaled counts can be recognized."""

_MIN_STEP = 2
"""Minimum distance of the values of successive counts at which counts can be recognized."""

_MAX_TRIALS = 4096
"""Maximum number of trials that is recognized."""


def unscale_counts(values: npt.NDArray[Any], scale: float, trials: int) -> Counts:
    """Return the counts k of integers that are scale · k / trials, rounded or truncated.

    Parameters
    ----------
    values : ndarray of int
        Any shape.
    scale : float
        The value of a pixel that is 1 in all trials.
    trials : int
        K, at most `scale` / 1.5. With more trials, a value could be a rounded count and, as well,
        another count that was truncated.

    Raises
    ------
    ValueError
        When a value is not a scaled count.

    Examples
    --------
    >>> unscale_counts(np.array([0, 16, 64, 255]), 255, 16).tolist()
    [0, 1, 4, 16]
    """
    counts = np.rint(values * (trials / scale))
    if _is_rounded(values, counts * (scale / trials)):
        return _checked(values, counts, scale, trials)
    counts = np.ceil(values * (trials / scale) - 1e-9)
    truncated = np.floor(counts * (scale / trials) + 1e-9)
    if np.array_equal(values, truncated):
        return _checked(values, counts, scale, trials)
    wrong = values.flat[int(np.argmax(values != truncated))]
    raise ValueError(
        f"counts_scale: expected multiples of {scale:g} / {trials}, rounded or truncated, got "
        f"{wrong}; state the number of frames behind each value, and the value of a pixel that is "
        "1 in all of them"
    )


def recognize_trials(values: npt.NDArray[Any], scale: float) -> int | None:
    """Return the smallest number of trials for which values are scaled counts, or None.

    It is at most half the scale. All images have values that are scaled counts for more trials.

    Examples
    --------
    >>> recognize_trials(np.array([0, 16, 64, 255]), 255)
    16
    >>> recognize_trials(np.arange(256), 255) is None
    True
    """
    levels = np.unique(values)
    if len(levels) < _MIN_LEVELS or levels[0] < 0 or levels[-1] > scale:
        return None
    for trials in range(len(levels) - 1, min(_MAX_TRIALS, int(scale / _MIN_STEP)) + 1):
        if _is_rounded(levels, np.rint(levels * (trials / scale)) * (scale / trials)):
            return trials
    return None


def scaled_counts_hint(values: npt.NDArray[Any]) -> str | None:
    """Return the advice to state the scale if values look like scaled counts, or None.

    Examples
    --------
    >>> scaled_counts_hint(np.array([0, 16, 64, 255])).partition(";")[0]
    'the values look like means of 16 frames times 255'
    """
    for scale in SCALES:
        trials = recognize_trials(values, scale)
        if trials is not None:
            return (
                f"the values look like means of {trials} frames times {scale}; if they are, open "
                f"the file with counts_scale={scale} (--counts-scale {scale}) and trials={trials} "
                f"(--frames {trials})"
            )
    return None


def _is_rounded(values: npt.NDArray[Any], exact: npt.NDArray[np.float64]) -> bool:
    """Return whether integers are rounded numbers. Programs differ in how they round halves."""
    return bool((abs(values - exact) <= 0.5 + 1e-9).all())


def _checked(
    values: npt.NDArray[Any], counts: npt.NDArray[np.float64], scale: float, trials: int
) -> Counts:
    if counts.size and (counts.min() < 0 or counts.max() > trials):
        raise ValueError(
            f"counts_scale: expected values from 0 to {scale:g}, got {values.min()} to "
            f"{values.max()}"
        )
    return counts.astype(np.int32)
