"""The choice of gains and thresholds for a range of light, by the Fisher information."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.notebook import card, table_of
from jotlight.sensing.readings import refuse_different_readings
from jotlight.sensing.reference import reading_information, reference_jot
from jotlight.sensing.response import Array
from jotlight.sensing.sensor import Sensor, require_sensor
from jotlight.sensing.values import numbers_from_zero

_LEVELS = 49
"""Number of levels of light at which the SNR is compared."""

_GRID = 200
"""Number of levels per factor of ten on which a range of light is searched."""

_MAX_EXCHANGES = 1000
"""Maximum number of frames that move to another setting after rounding."""


@dataclasses.dataclass(frozen=True, eq=False)
class BracketPlan:
    """The gains and thresholds of frames for a range of light, and the SNR that they allow.

    Light is in photons per jot and frame of the longest exposure, and SNR is in dB.
    """

    sensor: Sensor
    """The sensor with these gains and thresholds, from the longest exposure to the shortest."""
    exposures: Array
    """The fractions of the longest exposure, one for each setting, (G,)."""
    thresholds: npt.NDArray[np.int64]
    """The thresholds, one for each setting, (G,)."""
    frames: npt.NDArray[np.int64]
    """The number of frames of each setting, (G,)."""
    light: Array
    """The levels of light in ascending order, (N,)."""
    snr_bound: Array
    """The light over the Cramér-Rao bound of a pixel in dB, (N,)."""
    single_snr_bound: Array
    """The same for the best single setting, (N,)."""

    @property
    def min_snr(self) -> float:
        """The lowest SNR bound in the range, in dB."""
        return float(self.snr_bound.min())

    def _rows(self) -> list[tuple[str, str, str]]:
        settings = zip(self.frames, self.exposures, self.thresholds, strict=True)
        return [(f"{n}", f"{exposure:.4g}", f"{q}") for n, exposure, q in settings]

    def _repr_html_(self) -> str:
        facts = {
            "light": f"{self.light[0]:.3g} to {self.light[-1]:.3g} photons per jot and frame",
            "lowest SNR": f"{self.min_snr:.1f} dB",
            "with one setting": f"{self.single_snr_bound.min():.1f} dB",
        }
        return card("BracketPlan", facts) + table_of(
            ["frames", "exposure", "threshold"], self._rows()
        )

    def __repr__(self) -> str:
        settings = ", ".join(f"{n} x {exposure}, q={q}" for n, exposure, q in self._rows())
        return (
            f"<BracketPlan: {settings}; SNR of at least {self.min_snr:.1f} dB from "
            f"{self.light[0]:.3g} to {self.light[-1]:.3g} photons>"
        )


def plan_brackets(
    sensor: Sensor,
    light: tuple[float, float],
    *,
    exposures: Sequence[float] | None = None,
    thresholds: Sequence[int] = (1,),
) -> BracketPlan:
    """Return the exposures and thresholds of frames with the highest SNR throughout a range.

    Parameters
    ----------
    sensor : Sensor
        A sensor with T frames of the longest exposure: one gain and one threshold. Maps are
        replaced by the median of the live jots.
    light : (float, float)
        The minimum and the maximum of the scene, in photons per jot and frame of the longest
        exposure, above 0.
    exposures : sequence of float, optional
        The possible exposures as fractions of the longest one, in (0, 1]. Default: 1, 1/2, 1/4, …,
        down to one at which the brightest light is not saturated.
    thresholds : sequence of int
        The possible thresholds, 1 to 65535.

    Returns
    -------
    BracketPlan
        Its sensor simulates the capture, or describes it.

    Raises
    ------
    TypeError, ValueError
        When an argument is out of range, or the readings of the sensor already differ.

    Notes
    -----
    A reading at the gain a and the threshold q has the Fisher information ``(a η P')²/(P (1 - P))``
    about the light, and that of a pixel is the sum over its readings. The lowest SNR in the range
    is concave in the numbers of frames of each setting, so these solve a linear program. They are
    then rounded, and single frames are exchanged while that helps.

    Examples
    --------
    >>> found = plan_brackets(Sensor(frames=48), (0.05, 100.0))
    >>> int(found.frames.sum()), bool(found.min_snr > found.single_snr_bound.min() + 10)
    (48, True)
    >>> found.sensor.readings_differ
    True
    """
    require_sensor(sensor, may_differ=True)
    refuse_different_readings(
        sensor, "state one of each; jotlight.plan_brackets finds exposures that differ"
    )
    levels = _checked_light(light)
    fractions = _checked_exposures(exposures, levels[-1] * reference_jot(sensor)[0])
    if not len(thresholds):
        raise ValueError("thresholds: expected at least one, got none")
    qs = [sensor.replace(threshold=q).threshold for q in thresholds]
    settings = [(float(fraction), q) for fraction in fractions for q in sorted(set(qs))]
    squares = np.array([_squared_snr(sensor, levels, *setting) for setting in settings])
    squares *= sensor.oversampling**2
    numbers = _choose_numbers(squares, sensor.frames)
    used = np.flatnonzero(numbers)
    used = used[np.argsort([(-settings[i][0], settings[i][1]) for i in used], axis=0)[:, 0]]
    own, frames = [settings[i] for i in used], numbers[used]
    gain = np.repeat([fraction for fraction, _ in own], frames) * sensor.gain / sensor.frames
    best = squares[np.argmax(squares.min(axis=1))] * sensor.frames
    return BracketPlan(
        sensor=sensor.replace(gain=gain, threshold=np.repeat([q for _, q in own], frames)),
        exposures=np.array([fraction for fraction, _ in own]),
        thresholds=np.array([q for _, q in own], np.int64),
        frames=frames,
        light=levels,
        snr_bound=10 * np.log10(numbers @ squares),
        single_snr_bound=10 * np.log10(best),
    )


def snr_bound(sensor: Sensor, intensity: npt.ArrayLike) -> Array:
    """Return the intensity over the Cramér-Rao bound in dB, for readings that may differ.

    Parameters
    ----------
    sensor : Sensor
        Any sensor. Maps of efficiency and dark counts are replaced by the median of the live jots.
    intensity : array_like of float
        Intensities above 0.

    Examples
    --------
    >>> snr_bound(Sensor(frames=48), [0.5, 2.0]).round(1)
    array([12.7, 14.8])
    """
    values = numbers_from_zero("intensity", intensity)
    total = np.zeros(values.shape)
    for group in sensor.groups():
        own, light = group.sensor, group.sensor.light_per_intensity
        jots: float = sensor.oversampling**2
        if np.ndim(sensor.threshold) == 2:  # the pixels are mixed in equal shares
            jots *= float(np.mean(sensor.threshold == own.threshold))
        information = reading_information(own, light * values)
        total += own.frames * jots * (light * values) ** 2 * information
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10(total))


def intensity_range(sensor: Sensor, snr: float) -> tuple[float, float]:
    """Return the widest range of intensities throughout which the SNR bound reaches `snr` dB.

    Parameters
    ----------
    sensor : Sensor
        Any sensor, as for :func:`snr_bound`.
    snr : float
        The SNR in dB.

    Returns
    -------
    (float, float)
        The minimum and the maximum, in a range without a gap.

    Raises
    ------
    ValueError
        When no intensity reaches this SNR.

    Examples
    --------
    >>> low, high = intensity_range(Sensor(frames=48), 9.0)
    >>> round(float(20 * np.log10(high / low)), 1)  # dB
    28.9
    """
    groups = [group.sensor for group in sensor.groups()]
    lights = [group.light_per_intensity for group in groups]
    rates = [group.light_per_intensity * reference_jot(group)[0] for group in groups]
    highest = float(np.max(sensor.threshold) - 1 + sensor.max_reading) * 1e4 / min(rates)
    # With more frames, the SNR is reached with less light.
    lowest = min(1e-6, 0.01 / sensor.trials) / max(lights)
    number = int(np.ceil(np.log10(highest / lowest) * _GRID))
    grid = np.geomspace(lowest, highest, number)
    bounds = snr_bound(sensor, grid)
    reached = bounds >= snr
    edges = np.flatnonzero(np.diff(np.concatenate([[0], reached.astype(np.int8), [0]])))
    if not len(edges):
        raise ValueError(
            f"snr: expected at most {bounds.max():.1f} dB, which the sensor reaches, got {snr}"
        )
    starts, stops = edges[::2], edges[1::2] - 1
    widest = int(np.argmax(stops - starts))

    def cross(inside: int, outside: int) -> float:
        """Return the intensity between two levels at which the bound is `snr`."""
        if not 0 <= outside < number:
            return float(grid[inside])
        part = (snr - bounds[inside]) / (bounds[outside] - bounds[inside])
        return float(grid[inside] * (grid[outside] / grid[inside]) ** part)

    first, last = int(starts[widest]), int(stops[widest])
    return cross(first, first - 1), cross(last, last + 1)


def best_threshold(light: float, *, max_threshold: int = 256) -> int:
    """Return the threshold at which a bit has the highest information about the light.

    With it, about half of the bits are ones in bright light, and fewer in dim light.

    Parameters
    ----------
    light : float
        The expected detections per jot and frame, above 0.
    max_threshold : int
        The highest threshold that the sensor has, 1 to 65535.

    Examples
    --------
    >>> best_threshold(0.3), best_threshold(10.0)
    (1, 11)
    """
    sensor = Sensor()
    if not 0 < light <= 1e5:
        raise ValueError(f"light: expected photons per jot and frame, above 0 to 1e5, got {light}")
    highest = sensor.replace(threshold=max_threshold).threshold
    # Far from the light, in standard deviations, a bit has next to no information.
    reach = 10 * np.sqrt(light) + 10
    first = int(np.clip(light - reach, 1, highest))
    last = int(np.clip(light + reach, 1, highest))
    level = np.array([light])
    information = [
        _squared_snr(sensor, level, 1.0, threshold)[0] for threshold in range(first, last + 1)
    ]
    return first + int(np.argmax(information))


def _squared_snr(sensor: Sensor, light: Array, exposure: float, threshold: int) -> Array:
    """Return the squared SNR bound of one bit at each light of the longest exposure."""
    own = sensor.replace(threshold=threshold)
    return np.asarray((exposure * light) ** 2 * reading_information(own, exposure * light))


def _choose_numbers(squares: Array, frames: int) -> npt.NDArray[np.int64]:
    """Return how many frames each setting gets, so that the lowest sum of `squares` is highest."""
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
    numbers = np.floor(wanted + 1e-9).astype(np.int64)
    for place in np.argsort(numbers - wanted)[: frames - numbers.sum()]:
        numbers[place] += 1
    return _exchange(numbers, squares)


def _exchange(numbers: npt.NDArray[np.int64], squares: Array) -> npt.NDArray[np.int64]:
    """Return numbers of frames after moving frames one by one while the lowest sum rises."""
    for _ in range(_MAX_EXCHANGES):
        total = numbers @ squares
        best, move = float(total.min()), None
        for source in np.flatnonzero(numbers):
            lowest = (total - squares[source] + squares).min(axis=1)
            target = int(np.argmax(lowest))
            if lowest[target] > best * (1 + 1e-12):
                best, move = float(lowest[target]), (source, target)
        if move is None:
            break
        numbers = numbers.copy()
        numbers[move[0]] -= 1
        numbers[move[1]] += 1
    return numbers


def _checked_light(light: tuple[float, float]) -> Array:
    levels = np.asarray(light)
    if levels.dtype.kind not in "iuf" or levels.shape != (2,):
        raise TypeError(
            "light: expected the minimum and the maximum in photons per jot and frame, such as "
            f"(0.05, 100), got {light!r}"
        )
    low, high = levels.astype(np.float64)
    if not 0 < low < high <= 1e9:
        raise ValueError(
            f"light: expected a minimum below the maximum, above 0 and up to 1e9, got {light!r}"
        )
    return np.geomspace(low, high, _LEVELS)


def _checked_exposures(exposures: Sequence[float] | None, max_rate: float) -> Array:
    if exposures is None:
        # A bit is most informative at 1.6 detections.
        number = max(0, int(np.ceil(np.log2(max_rate / 1.6)))) if max_rate > 0 else 0
        return np.asarray(0.5 ** np.arange(number + 2))
    values = np.asarray(exposures)
    is_list = values.dtype.kind in "iuf" and values.ndim == 1 and values.size > 0
    if not is_list or not ((values > 0) & (values <= 1)).all():
        raise ValueError(
            "exposures: expected fractions of the longest exposure, above 0 and up to 1, such as "
            f"(1, 1/8, 1/64), got {exposures!r}"
        )
    return np.unique(values.astype(np.float64))[::-1]
