"""The size of a network's errors: from photographs, and corrected by held-out bits of the data.

Everything is in terms of z = arcsin √p, where p is the probability that a bit of the pixel is 1.
The noise of z is nearly the same at every exposure.
"""

import dataclasses
import json
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.evaluation.intervals.contrast import NO_CONTRAST, Contrast
from jotlight.networks.inference.dim_scenes import trials_per_combined
from jotlight.sensing.bits.subsampling import subsample_counts
from jotlight.sensing.parameters.binomial import arcsin_root, squared_sine

FILE = Path(__file__).with_name("error_scale.json")
"""The error model of gray estimates, which ``tools/calibrate_intervals.py`` writes."""

COLOR_FILE = Path(__file__).with_name("color_error_scale.json")
"""The error model of the colors of mosaics, of ``tools/calibrate_color_intervals.py``."""

WINDOWS = 3, 15
"""Sides of the windows in which the activity of an estimate is measured, in pixels."""

MIN_HELD_OUT = 2
"""Minimum number of held-out bits of a pixel that reveal an error: with one, the variance of a bit
is unknown."""

_SEED = 2026
"""Seed of the division of the bits, so that the result is reproducible."""

_SIDE = 3
"""Number of classes of brightness, and of activity, in which the errors are measured."""

_SPREAD = 0.35
"""Standard deviation of the logarithm of the correction between photographs."""

_MIN_CORRECTION, _MAX_CORRECTION = 0.1, 100.0
"""Limits of the correction of the squared scale."""

_SMALLEST = 1e-2
"""Variance times K below which a window counts as flat."""


_ROUNDING = 1e-5
"""Relative difference by which a probability is below that of S in spite of rounding errors."""

_MIN_RATIO = 1e-6
"""Smallest ratio of two probabilities of a bit, so that one bit cannot decide."""


@dataclasses.dataclass(frozen=True)
class ErrorModel:
    """The distribution of the errors of a network on photographs."""

    weights: Array
    """Weights of the terms of :func:`error_terms`, whose sum is the logarithm of the scale."""
    ones: Array
    """log(1 + expected ones) of each of O classes of pixels, ascending."""
    activity: Array
    """Activity of each of A classes of pixels with these ones, (O, A), ascending in each row."""
    tails: Array
    """Tail probabilities, ascending."""
    low: Array
    """Lower quantiles of error/scale, of each class and tail probability: (O, A, tails)."""
    high: Array
    """Upper quantiles of error/scale, of each class and tail probability: (O, A, tails)."""
    deviation: Array
    """Root mean square of error/scale, of each class of ones."""

    @classmethod
    def read(cls, path: Path = FILE) -> Self:
        """Return the model in a file."""
        content = json.loads(path.read_text("utf-8"))
        return cls(
            **{field.name: np.array(content[field.name]) for field in dataclasses.fields(cls)}
        )

    def write(self, path: Path) -> None:
        """Write the model to a file, with five significant digits."""
        content: dict[str, Any] = {}
        for name, values in dataclasses.asdict(self).items():
            content[name] = json.loads(
                json.dumps(values.tolist()), parse_float=lambda text: float(f"{float(text):.5g}")
            )
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")

    def scale(self, z: Array, trials: Array, *others: Array) -> Array:
        """Return the scale of the errors of an estimate z (H, W), from photographs.

        The parameters are those of :func:`error_terms`.
        """
        logarithm = np.zeros(z.shape)
        for weight, term in zip(self.weights, error_terms(z, trials, *others), strict=True):
            logarithm += weight * term
        return np.exp(logarithm)

    def quantiles(self, z: Array, trials: Array, tail: float) -> tuple[Array, Array]:
        """Return the lower and the upper quantile of error/scale at each pixel."""
        # Between the tail probabilities, the quantiles are nearly linear in their logarithm.
        place = np.interp(np.log(tail), np.log(self.tails), np.arange(len(self.tails)))
        below = min(int(place), len(self.tails) - 2)
        ones, activity = log_ones(z, trials), log_activity(z, trials, WINDOWS[1])
        weights = _class_weights(ones, self.ones)
        low, high = np.zeros(z.shape), np.zeros(z.shape)
        for index, weight in enumerate(weights):
            for table, end in ((self.low, low), (self.high, high)):
                row = table[index, :, below : below + 2] @ [1 + below - place, place - below]
                end += weight * np.interp(activity, self.activity[index], row)
        return low, high

    def deviations(self, z: Array, trials: Array) -> Array:
        """Return the root mean square of error/scale at each pixel."""
        return np.asarray(np.interp(log_ones(z, trials), self.ones, self.deviation))


@cache
def error_model(path: Path = FILE) -> ErrorModel:
    """Return a model that comes with jotlight."""
    return ErrorModel.read(path)


def error_terms(z: Array, trials: Array, *others: Array) -> Iterator[Array]:
    """Yield the terms of the logarithm of the scale, each (H, W): 28 without other numbers.

    They are 1 and the products of up to two of six numbers: log K, the logarithm of the variance of
    z in two windows relative to the noise, z, and the logarithms of the expected ones and zeros.
    There may be others.
    """
    numbers = [np.log(trials) / 3]
    numbers += [log_activity(z, trials, side) for side in WINDOWS]
    numbers += [2 * z, log_ones(z, trials) / 3, np.log1p(trials * np.cos(z) ** 2) / 3]
    numbers += others
    yield np.ones_like(z)
    yield from numbers
    for first in range(len(numbers)):
        for second in range(first, len(numbers)):
            yield numbers[first] * numbers[second]


def log_activity(z: Array, trials: Array, side: int) -> Array:
    """Return the logarithm of the deviation of z relative to the noise, in a window."""
    from scipy.ndimage import uniform_filter

    mean = uniform_filter(z, side, mode="mirror")
    variance = uniform_filter(z * z, side, mode="mirror") - mean * mean
    return np.asarray(np.log(np.maximum(variance, 0) * trials + _SMALLEST) / 2)


def log_ones(z: Array, trials: Array) -> Array:
    """Return log(1 + expected ones)."""
    return np.asarray(np.log1p(trials * squared_sine(z)))


def _class_weights(values: Array, centers: Array) -> list[Array]:
    """Return the weights of classes in a linear interpolation between their centers."""
    return [np.interp(values, centers, row) for row in np.eye(len(centers))]


def combine_dim(z: Array, trials: Array) -> tuple[Array, Array, float]:
    """Return z and the trials of an image with c trials combined into one, and c.

    A K-conditioned network combines the trials of a dim scene
    (:mod:`jotlight.networks.inference.dim_scenes`). Its errors are those of a scene with K/c trials
    and probabilities c p. For other scenes, c is 1. The errors of z are multiplied by √c.

    Examples
    --------
    >>> z, trials, factor = combine_dim(np.full((8, 8), 1 / 64), np.full((8, 8), 1024.0))
    >>> print(f"{z.mean():.3f} {trials.mean():.0f} {factor:.0f}")
    0.253 4 256
    """
    p = squared_sine(z)
    factor = trials_per_combined(p.astype(np.float32), trials.astype(np.float32))
    if factor == 1:
        return z, trials, factor
    return arcsin_root(factor * p), trials / factor, factor


def gray_scale(
    model: ErrorModel, z: Array, trials: Array, contrast: Contrast = NO_CONTRAST
) -> Array:
    """Return the scale of the errors of a gray estimate z (H, W), from photographs."""
    combined, trials, factor = combine_dim(z, trials)
    return np.asarray(model.scale(combined, trials) / np.sqrt(factor) * contrast.factor(z))


@dataclasses.dataclass(frozen=True)
class Half:
    """One half of the bits of an image."""

    ones: npt.NDArray[np.int64]
    trials: npt.NDArray[np.int64]


def divide_bits(ones: npt.NDArray[np.int32], trials: Array) -> tuple[Half, Half]:
    """Return two random halves of the bits of each pixel, (H, W).

    Each half is a capture with half of the trials, and both are independent.

    Examples
    --------
    >>> first, second = divide_bits(np.full((2, 3), 8), np.full((2, 3), 9.0))
    >>> bool((first.trials + second.trials == 9).all())
    True
    """
    rng = np.random.default_rng(_SEED)
    whole = ones + np.floor(trials - ones).astype(np.int64)
    number = np.floor(0.5 * whole + rng.random(whole.shape)).astype(np.int64)
    number = np.minimum(number, whole)
    first = subsample_counts(ones, whole, number, rng)
    return Half(first, number), Half(ones - first, whole - number)


@dataclasses.dataclass(frozen=True)
class HalfErrors:
    """The squared errors of an estimate from one half of the bits, by the other half."""

    z: Array
    """Estimate from one half."""
    trials: Array
    """Trials of that half."""
    slope: Array
    """Derivative of p with respect to z."""
    squared: Array
    """Unbiased estimates of the squared error of p; they can be negative."""
    known: npt.NDArray[np.bool_]
    """Whether the squared error of a pixel is known."""
    gain: Array
    """Logarithm of the probability of the held-out bits under the estimate, relative to that under
    the fraction of ones of the same pixel."""
    p: Array
    """Probability that a bit of the pixel is 1, by the estimate."""
    held_out: Half
    """The other half of the bits."""
    relative_slope: float | Array = 1.0
    """Derivative of arcsin √p with respect to z."""

    @classmethod
    def measure(cls, z: Array, trained: Half, held_out: Half) -> Self:
        """Return the errors of the estimate z from `trained`, measured by `held_out`."""
        number = held_out.trials
        known = (number >= MIN_HELD_OUT) & (trained.trials > 0)
        mean = held_out.ones / np.maximum(number, 1)
        noise = mean * (1 - mean) / np.maximum(number - 1, 1)
        squared = (mean - squared_sine(z)) ** 2 - noise
        # Half a count keeps the fraction away from 0 and 1.
        fraction = (trained.ones + 0.5) / (trained.trials + 1)
        of_one, of_zero = (
            np.log(np.maximum(ratio, _MIN_RATIO))
            for ratio in (squared_sine(z) / fraction, np.cos(z) ** 2 / (1 - fraction))
        )
        gain = held_out.ones * of_one + (number - held_out.ones) * of_zero
        trials = np.maximum(trained.trials, 1).astype(np.float64)
        # dp = 2 sin z cos z dz = sin 2z dz
        gain, p = np.where(known, gain, 0.0), np.sin(z) ** 2
        return cls(z, trials, np.sin(2 * z), squared, known, gain, p, held_out)

    def below(self, largest: Array) -> Self:
        """Return the errors of estimates whose arcsin √p is below that of S, (H, W).

        Those at S are limited by it. Of brighter pixels, bits contradict S, and not the estimate.
        """
        is_limited = self.p >= np.sin(largest) ** 2 * (1 - _ROUNDING)
        gain = np.where(is_limited, 0.0, self.gain)
        return dataclasses.replace(self, known=self.known & ~is_limited, gain=gain)


def expected_squares(
    model: ErrorModel, half: HalfErrors, contrast: Contrast = NO_CONTRAST
) -> Array:
    """Return the squared errors of p that a model expects of the estimate from half of the bits."""
    scale = gray_scale(model, half.z, half.trials, contrast)
    scale *= model.deviations(half.z, half.trials)
    return np.asarray((scale * half.slope) ** 2)


def correction(halves: Sequence[HalfErrors], of_model: Sequence[Array], z: Array) -> Array:
    """Return the factor of the scale from photographs at each pixel, (H, W).

    The pixels are divided into classes of brightness and activity. In each class, the measured
    squared errors are compared with those that the model expects. The noise of the comparison
    decides how much it counts.

    Parameters
    ----------
    halves : sequence of HalfErrors
        The measured errors of the estimates from each half. Their z state the class.
    of_model : sequence of ndarray, shape (H, W)
        The squared errors that the model expects of each.
    z : ndarray, shape (H, W)
        The estimate from all bits.
    """
    sums = np.zeros((3, _SIDE**2))
    for half, expected in zip(halves, of_model, strict=True):
        row, column = (
            np.minimum((_SIDE * rank).astype(int), _SIDE - 1)[half.known] for rank in _ranks(half.z)
        )
        for index, values in enumerate((half.squared, expected, half.squared**2)):
            sums[index] += np.bincount(_SIDE * row + column, values[half.known], _SIDE**2)
    measured, expected, squares = sums.reshape(3, _SIDE, _SIDE)
    is_known = expected > 0
    factor, error = (
        np.divide(values, expected, out=np.ones_like(expected), where=is_known)
        for values in (measured, np.sqrt(squares))
    )
    factor = np.clip(factor, _MIN_CORRECTION, _MAX_CORRECTION)
    trust = is_known / (1 + (error / factor / _SPREAD) ** 2)
    return np.exp(0.5 * _interpolate(trust * np.log(factor), _ranks(z)))


def _ranks(z: Array) -> tuple[Array, Array]:
    """Return the rank of the brightness and of the activity of each pixel in the image, 0 to 1."""
    from scipy.ndimage import uniform_filter

    mean, square = (uniform_filter(values, WINDOWS[0], mode="mirror") for values in (z, z * z))
    brightness, activity = (
        np.searchsorted(np.sort(values, axis=None), values) / values.size
        for values in (mean, square - mean * mean)
    )
    return brightness, activity


def _interpolate(table: Array, ranks: tuple[Array, Array]) -> Array:
    """Return the values of a table of classes, interpolated between the centers of the classes."""
    from scipy.ndimage import map_coordinates

    places = [_SIDE * rank - 0.5 for rank in ranks]
    return np.asarray(map_coordinates(table, places, order=1, mode="nearest"))
