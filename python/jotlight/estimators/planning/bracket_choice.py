"""The numbers of frames of each exposure and threshold with the highest SNR in a range of light."""

import functools
from collections.abc import Iterator

import numpy as np

from jotlight.array_types import Array, Integers
from jotlight.estimators.planning.planned_estimates import PlannedEstimates, PlannedGroup
from jotlight.sensing.likelihood.reference import reference_jot, saturation_rate
from jotlight.sensing.sensor import Sensor

Setting = tuple[float, int]
"""An exposure as a fraction of the longest one, and a threshold."""


_FACTORS = 1.0, np.e, np.e**2
"""Factors between two levels of light whose readings must differ. 1 is the Fisher information."""

_MAX_EXCHANGES = 100
"""Maximum number of frames that move to another setting."""

_MIN_GAIN = 0.01
"""Smallest gain in dB for which a frame moves."""

_MAX_KEPT = 1 << 14
"""Maximum number of values of the SNR that are kept."""

_PRECISION = 2.0**-24
"""Smallest relative error of an estimate, which is a float32."""


class FrameDivision:
    """Frames with some settings, and the SNR of `jotlight.mle` at some levels of light.

    Parameters
    ----------
    sensor : Sensor
        The sensor: one gain and one threshold.
    settings : list of (float, int)
        The possible settings.
    levels : ndarray of float64, shape (N,)
        Light in photons per jot and frame of the longest exposure.
    """

    def __init__(self, sensor: Sensor, settings: list[Setting], levels: Array) -> None:
        self._settings, self._levels, self._jots = settings, levels, sensor.oversampling**2
        self._sensors = [sensor.replace(threshold=threshold) for _, threshold in settings]
        efficiency, self._dark_counts = reference_jot(sensor)
        self._groups = [
            PlannedGroup(own.jot_response(), efficiency, self._dark_counts, exposure)
            for own, (exposure, _) in zip(self._sensors, settings, strict=True)
        ]
        self._estimates = PlannedEstimates(self._groups, float(levels[-1]))
        self._max_light = sensor.max_intensity * sensor.light_per_intensity
        self._bounds = self._squared_snr(1.0)
        self._snr_at = functools.lru_cache(_MAX_KEPT)(self._snr_of)

    def best(self, frames: int) -> Integers:
        """Return numbers of frames whose lowest quality is high.

        They start from linear programs, for the Fisher information and for the difference of the
        readings at two levels of light. Then single frames move while this raises the lowest
        quality.
        """
        starts = [
            divide_frames(np.maximum(self._squared_snr(factor), 1e-300), frames)
            for factor in _FACTORS
        ]
        numbers = max(starts, key=lambda start: float(self._quality(start).min()))
        for _ in range(_MAX_EXCHANGES):
            better = self._move_frame(numbers)
            if better is None:
                break
            numbers = better
        return numbers

    def best_single(self, frames: int) -> Integers:
        """Return numbers of frames of the same setting whose lowest quality is highest."""
        best, lowest = None, -np.inf
        for index in range(len(self._settings)):
            numbers = np.zeros(len(self._settings), np.int64)
            numbers[index] = frames
            found = self._lowest_quality(numbers, lowest, [0, len(self._levels) - 1])
            if best is None or found > lowest:
                best, lowest = numbers, found
        assert best is not None
        return best

    def bound(self, numbers: Integers) -> Array:
        """Return the light over the Cramér-Rao bound in dB at each level."""
        with np.errstate(divide="ignore"):  # where all readings are the largest
            return np.asarray(10 * np.log10(self._jots * (numbers @ self._bounds)))

    def snr(self, numbers: Integers) -> Array:
        """Return the light over the root mean square error of the estimate, in dB, (N,)."""
        key = tuple(numbers.tolist())
        return np.array([self._snr_at(key, index) for index in range(len(self._levels))])

    def max_light(self, numbers: Integers) -> float:
        """Return the largest estimate of light, in photons per frame of the longest exposure."""
        if self._max_light >= self._levels[-1] * (1 - 1e-9):
            return self._max_light
        lights = [
            (saturation_rate(own, int(number) * self._jots) - self._dark_counts)
            / (group.efficiency * group.exposure)
            for own, group, number in zip(self._sensors, self._groups, numbers, strict=True)
            if number
        ]
        return max(*lights, float(self._levels[-1]))

    def _snr_of(self, numbers: tuple[int, ...], index: int) -> float:
        """Return the SNR at a level."""
        readings = [number * self._jots for number in numbers]
        level, largest = float(self._levels[index]), self.max_light(np.array(numbers))
        _, mse = self._estimates.bias_and_mse(readings, level, largest)
        return float(-10 * np.log10(max(mse / level**2, _PRECISION**2)))

    def _quality(self, numbers: Integers) -> Array:
        """Return the SNR or its bound, whichever is lower, at each level.

        Saturated pixels may have a good estimate only because it is clipped. The bound says that
        their readings have no information.
        """
        return np.minimum(self.snr(numbers), self.bound(numbers))

    def _lowest_quality(
        self, numbers: Integers, needed: float, first: list[int], stop: int | None = None
    ) -> float:
        """Return the lowest quality, or a value up to `needed` if it is not above.

        Most choices fail at one of the levels `first`. A level at which one fails becomes the first
        of them, because the next one probably fails there, too. Only `stop` levels are compared.
        """
        others = [index for index in range(len(self._levels)) if index not in first]
        lowest = float(self.bound(numbers).min())
        if lowest <= needed:
            return lowest
        key = tuple(numbers.tolist())
        for index in [*first, *others][:stop]:
            lowest = min(lowest, self._snr_at(key, index))
            if lowest <= needed:
                first[:] = [index, *(each for each in first if each != index)]
                break
        return lowest

    def _move_frame(self, numbers: Integers) -> Integers | None:
        """Return numbers of frames after the best move of one of them, or None if none helps.

        The moves that help most where the quality is lowest come first: they are probably the best,
        and then the others need few levels.
        """
        quality = self._quality(numbers)
        needed, better = float(quality.min()) + _MIN_GAIN, None
        first = [int(index) for index in np.argsort(quality)[:3]]
        found = [
            (self._lowest_quality(moved, needed, first[:1], stop=1), moved)
            for moved in _moves(numbers)
        ]
        for highest, moved in sorted(found, key=lambda each: -each[0]):
            if highest <= needed:
                break
            if (lowest := self._lowest_quality(moved, needed, first)) > needed:
                needed, better = lowest, moved
        return better

    def _squared_snr(self, factor: float) -> Array:
        """Return the squared SNR of a reading of each setting at each level, (G, N).

        It follows from the Bhattacharyya distance of the readings at two levels of light, whose
        ratio is the factor. For small factors, it is that of the Fisher information.
        """
        squares = np.empty((len(self._groups), len(self._levels)))
        for group, out in zip(self._groups, squares, strict=True):
            light = group.exposure * self._levels
            if factor == 1:
                out[:] = light**2 * group.jot.information_per_reading(light)
                continue
            # The product of both probabilities is largest where the readings between them are.
            rows, readings, _ = group.probabilities(self._levels)
            near = [
                group.jot.probability(readings, light[rows] * factor**power)
                for power in (-0.5, 0.5)
            ]
            overlap = np.bincount(rows, np.sqrt(near[0] * near[1]), light.size)
            out[:] = -8 / np.log(factor) ** 2 * np.log(np.clip(overlap, 1e-300, 1))
        return squares


def _moves(numbers: Integers) -> Iterator[Integers]:
    """Yield the numbers of frames after each move of a frame to another setting.

    Examples
    --------
    >>> [moved.tolist() for moved in _moves(np.array([2, 0, 1]))]
    [[1, 1, 1], [1, 0, 2], [3, 0, 0], [2, 1, 0]]
    """
    for source in np.flatnonzero(numbers):
        for target in range(len(numbers)):
            if source != target:
                moved = numbers.copy()
                moved[source] -= 1
                moved[target] += 1
                yield moved


def divide_frames(squares: Array, frames: int) -> Integers:
    """Return how many frames each setting gets, so that the lowest sum of `squares` is high.

    Parameters
    ----------
    squares : ndarray of float64, shape (G, N)
        What a frame of each setting adds at each level.
    frames : int
        The number of frames.

    Examples
    --------
    >>> divide_frames(np.array([[3.0, 0.0], [0.0, 1.0]]), 8)
    array([2, 6])
    """
    from scipy.optimize import linprog

    settings, levels = squares.shape
    scale = squares.max()
    # Maximize t, where the weighted sum at every level is t or more, and the weights sum to 1.
    found = linprog(
        np.append(np.zeros(settings), -1.0),
        A_ub=np.column_stack([-squares.T / scale, np.ones(levels)]),
        b_ub=np.zeros(levels),
        A_eq=np.append(np.ones(settings), 0.0)[None],
        b_eq=[1.0],
    )
    wanted = frames * np.clip(found.x[:-1], 0, 1)
    numbers: Integers = np.floor(wanted + 1e-9).astype(np.int64)
    for place in np.argsort(numbers - wanted)[: frames - numbers.sum()]:
        numbers[place] += 1
    return numbers
