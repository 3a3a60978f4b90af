"""Counts from images that hold the means of frames, times a scale such as 255."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Counts
from jotlight.checks import refuse_masked
from jotlight.errors import warn
from jotlight.sensing.sensor import Sensor

SCALES = 255, 65535
"""Scales of images of means with 8 and with 16 bits."""

_MIN_LEVELS = 3
"""Minimum number of different values from which scaled counts can be recognized."""

_MIN_STEP = 2
"""Minimum distance of the values of successive counts at which counts can be recognized."""

_MAX_TRIALS = 4096
"""Maximum number of trials that is recognized."""

_MIN_NONZERO = 16
"""Minimum number of pixels above 0 from which a common divisor of counts is no coincidence."""

_MIN_EXPECTED = 10
"""Expected number of counts above 1 from which it is no coincidence that there are none: then its
probability is below exp(-10)."""


def check_trials(dtype: np.dtype[Any], scale: float, trials: int) -> None:
    """Raise ValueError if values of a type cannot distinguish counts of this number of trials.

    Examples
    --------
    >>> check_trials(np.dtype(np.float32), 1, 16)
    >>> check_trials(np.dtype(np.uint8), 255, 171)
    Traceback (most recent call last):
    ...
    ValueError: trials: expected at most 170, because the scale 255 rounds the counts of more ...
    """
    if dtype.kind == "f":
        limit = int(0.25 / _float_tolerance(dtype))
        what = f"{dtype} rounds"
    else:
        limit = int(scale / 1.5)
        what = f"the scale {scale:g} rounds"
    if limit < 1:
        raise ValueError(
            f"counts_scale: expected a scale such as 255 or 65535, because the image holds {dtype} "
            f"and whole numbers round means of the scale {scale:g} to 0 or 1; only floats hold "
            "means of this scale"
        )
    if trials > limit:
        raise ValueError(
            f"trials: expected at most {limit}, because {what} the counts of more trials, got "
            f"{trials}"
        )


def unscale_counts(values: npt.NDArray[Any], scale: float, trials: int) -> Counts:
    """Return the counts k of numbers that are scale · k / trials.

    Parameters
    ----------
    values : ndarray of int or float
        Any shape. Integers may be rounded or truncated. Floats may differ by the rounding of their
        type, or be rounded to whole numbers like integers.
    scale : float
        The value of a pixel that is 1 in all trials.
    trials : int
        K. For integers, it is at most `scale` / 1.5. With more trials, a value could be a rounded
        count and, as well, another count that was truncated.

    Raises
    ------
    ValueError
        When a value is not a scaled count.

    Examples
    --------
    >>> unscale_counts(np.array([0, 16, 64, 255]), 255, 16).tolist()
    [0, 1, 4, 16]
    >>> unscale_counts(np.array([0, 0.0625, 1], np.float32), 1, 16).tolist()
    [0, 1, 16]
    """
    if values.dtype.kind == "f":
        return _unscale_floats(values, scale, trials)
    counts = np.rint(values * (trials / scale))
    if _is_rounded(values, counts * (scale / trials)):
        return _checked(values, counts, scale, trials)
    counts = np.ceil(values * (trials / scale) - 1e-9)
    truncated = np.floor(counts * (scale / trials) + 1e-9)
    if np.array_equal(values, truncated):
        return _checked(values, counts, scale, trials)
    raise _not_scaled(values, values != truncated, scale, trials)


def _unscale_floats(values: npt.NDArray[Any], scale: float, trials: int) -> Counts:
    exact = values.astype(np.float64) * (trials / scale)
    counts = np.rint(exact)
    # The comparison is false for NaN and, as infinity minus infinity is NaN, for infinity.
    with np.errstate(invalid="ignore"):
        wrong = ~(abs(exact - counts) <= _float_tolerance(values.dtype) * trials)
    if not wrong.any():
        return _checked(values, counts, scale, trials)
    whole = np.isfinite(values).all() and (values == np.rint(values)).all()
    if whole and trials <= scale / 1.5 and abs(values).max() <= scale:
        return unscale_counts(values.astype(np.int64), scale, trials)
    raise _not_scaled(values, wrong, scale, trials)


def _float_tolerance(dtype: np.dtype[Any]) -> float:
    """Return the relative error of means of a type. Many float64 were float32 before."""
    return 4 * float(max(np.finfo(dtype).eps, np.finfo(np.float32).eps))


def _not_scaled(
    values: npt.NDArray[Any], wrong: npt.NDArray[np.bool_], scale: float, trials: int
) -> ValueError:
    return ValueError(
        f"counts_scale: expected multiples of {scale:g} / {trials}, rounded or truncated, got "
        f"{values.flat[int(np.argmax(wrong))]}; state the number of frames behind each value, and "
        "the value of a pixel that is 1 in all of them"
    )


def find_fewer_trials(counts: Counts, trials: int) -> int | None:
    """Return a smaller number of trials that explains all counts just as well, or None.

    If means of 16 frames are read as means of 64, all counts are multiples of 4.

    Examples
    --------
    >>> find_fewer_trials(4 * np.arange(17), 64)
    16
    >>> find_fewer_trials(np.arange(17), 16) is None
    True
    """
    if np.count_nonzero(counts) < _MIN_NONZERO:
        return None
    divisor = math.gcd(trials, *np.unique(counts).tolist())
    return trials // divisor if divisor > 1 else None


def recognize_trials(values: npt.NDArray[Any], scale: float) -> int | None:
    """Return the smallest number of trials for which values are scaled counts, or None.

    For integers, it is at most half the scale. All images of integers have values that are scaled
    counts for more trials. In a dim image, several successive numbers of trials may explain all
    values, and none of them is recognized.

    Examples
    --------
    >>> recognize_trials(np.array([0, 16, 64, 255]), 255)
    16
    >>> recognize_trials(np.arange(256), 255), recognize_trials(np.array([0, 2, 4, 6]), 255)
    (None, None)
    """
    levels, floats = np.unique(values), values.dtype.kind == "f"
    if len(levels) < _MIN_LEVELS or not (levels[0] >= 0 and levels[-1] <= scale):
        return None
    most = _MAX_TRIALS if floats else min(_MAX_TRIALS, int(scale / _MIN_STEP))
    for trials in range(1 if floats else len(levels) - 1, most + 1):
        if floats:
            exact = levels.astype(np.float64) * (trials / scale)
            if (abs(exact - np.rint(exact)) <= _float_tolerance(values.dtype) * trials).all():
                return trials
        elif _are_levels(levels, scale, trials):
            return None if _are_levels(levels, scale, trials + 1) else trials
    return None


def scaled_counts_hint(values: npt.NDArray[Any]) -> str | None:
    """Return the advice to state the scale if integers look like scaled counts, or None.

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
                f"(--trials {trials}); the counts of an array x are "
                f"np.rint(x / {scale} * {trials}).astype(int), with Sensor(frames={trials})"
            )
        if np.array_equal(np.unique(values), [0, scale]):
            return (
                f"the values are only 0 and {scale}, as in a black-and-white image of one frame; "
                "if they are its bits, open the file with unpacked=True (--unpacked); the counts "
                f"of an array x are np.rint(x / {scale}).astype(int)"
            )
    return None


def check_whole(data: object, trials: int, *, takes_trials: bool = True) -> None:
    """Raise TypeError for floats in place of counts. The message says how to convert means.

    `takes_trials` is whether the caller has a parameter `trials`, which may mark missing pixels.

    Examples
    --------
    >>> check_whole(np.array([[0.3, 1.0]]), 16)
    Traceback (most recent call last):
    ...
    TypeError: data: expected ... got float64; the counts of means x of 16 frames are ...
    """
    refuse_masked("counts", data)
    values = np.asarray(data)
    if values.dtype.kind != "f" or values.size == 0:  # an empty list has the type of floats
        return
    raise TypeError(
        f"data: expected jotlight.Bits or an image of counts in whole numbers, got "
        f"{values.dtype}{_advice_on_floats(values, trials, takes_trials)}"
    )


def _advice_on_floats(values: npt.NDArray[Any], trials: int, takes_trials: bool) -> str:
    """Return what floats in place of counts probably are, and what to do."""
    if not np.isfinite(values).all():
        known = values[~np.isnan(values)]
        if not (np.isfinite(known).all() and (known == np.rint(known)).all()):
            return " with NaN or infinity"
        mask = "np.isnan(x)" if values.ndim == 2 else "a map (H, W) of them"
        missing = f"trials=np.where(np.isnan(x), 0, {trials})"
        return (
            " with NaN; if these pixels x have no data, pass np.nan_to_num(x).astype(int) and "
            f"{missing if takes_trials else f'sensor.replace(mask={mask})'}"
        )
    photograph = "; a photograph becomes bits by sensor.expose(image)"
    if (values == np.rint(values)).all():
        return f"; cast rounded floats with astype(int){photograph}"
    scale = next((scale for scale in (1, *SCALES) if values.max() <= scale), None)
    number = None if scale is None else recognize_trials(values, scale)
    if number is None and scale == 1:
        number = trials
    # All multiples of 1 / 2 are means of 510 frames times 255, and so on.
    if scale is None or number is None or (scale != 1 and number % scale == 0):
        return f"; fractions are no counts, so pass the counts from before a scaling{photograph}"
    fraction = "x" if scale == 1 else f"x / {scale}"
    return (
        f"; the counts of means x of {number} frames are "
        f"np.rint({fraction} * {number}).astype(int), with Sensor(frames={number}){photograph}"
    )


def check_range(counts: Counts, sensor: Sensor) -> None:
    """Raise ValueError for counts that a sensor cannot report. Warn if they look like means."""
    low, high, trials = counts.min(), counts.max(), sensor.trials
    if low < 0 or high > trials:
        raise range_error(counts, sensor)
    if trials in SCALES and (hint := scaled_counts_hint(counts)):
        warn(f"counts: {hint}")


def warn_about_unpacked_frames(images: Counts, sensor: Sensor) -> None:
    """Warn about a stack of counts that looks like the frames of one image, unpacked.

    Examples
    --------
    >>> frames = jl.Sensor(frames=16).expose(np.full((8, 8), 0.5), rng=0).to_array().astype(int)
    >>> warn_about_unpacked_frames(frames.sum(0)[None], jl.Sensor(frames=16))  # no warning
    """
    number, _, width = images.shape
    if not (number > 1 and sensor.frames > 1 and images.max() == 1):
        return
    if number == sensor.frames:
        found, frames = f"{number} images of nothing but 0 and 1", "frames"
    elif width == sensor.frames:
        found, frames = f"{width} columns of nothing but 0 and 1", "np.moveaxis(frames, 2, 0)"
    else:
        return
    trials, share = sensor.trials, float(images.mean()) / sensor.trials
    one_or_none = (1 - share) ** (trials - 1) * (1 + (trials - 1) * share)
    if images.size * (1 - one_or_none) > _MIN_EXPECTED:
        warn(
            f"counts: {found} look like the {sensor.frames} frames of one image; "
            f"jotlight.Bits.from_array({frames}, sensor) makes bits of them"
        )


def range_error(values: npt.NDArray[Any], sensor: Sensor) -> ValueError:
    """Return the error for counts that a sensor cannot report; they may be floats.

    Examples
    --------
    >>> range_error(np.array([0.5, 3]), jl.Sensor(frames=2))
    ValueError('counts: expected 0 to K = 2 ones per pixel (2 frames of 1 x 1 jots), got 0.5 to 3')
    """
    whole = bool(np.isfinite(values).all() and (values == np.rint(values)).all())
    hint = scaled_counts_hint(values.astype(np.int64)) if whole else None
    return ValueError(
        f"counts: expected 0 to K = {sensor.trials} ones per pixel ({sensor.frames} frames of "
        f"{sensor.oversampling} x {sensor.oversampling} jots), got {values.min():.10g} to "
        f"{values.max():.10g}" + (f"; {hint}" if hint else "")
    )


def _are_levels(values: npt.NDArray[Any], scale: float, trials: int) -> bool:
    """Return whether integers are rounded scaled counts."""
    return _is_rounded(values, np.rint(values * (trials / scale)) * (scale / trials))


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
