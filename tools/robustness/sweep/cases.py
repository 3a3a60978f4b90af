"""The sensors, shapes, and bits of the sweep.

The full product of all settings would take weeks, so the sweep has three parts. Each takes all
combinations of some settings with every method and every pattern of bits:

- exposures: all gains with all thresholds;
- shapes: all shapes with all numbers of jots and frames per pixel, at three gains;
- sensors: all kinds of kernels, maps, and ranges, at three gains and two thresholds.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight as jl

GAINS = [10.0**power for power in range(-6, 7)]
FEW_GAINS = GAINS[0], None, GAINS[-1]
"""Gains of the parts that vary other settings. None is K, the default."""
THRESHOLDS = 1, 2, 3, 16, 255, 256, 4096, 65_535
SHAPES = (
    *((1, 1), (1, 2), (2, 1), (1, 7), (7, 1), (13, 17), (31, 37), (127, 1), (1, 127), (97, 101)),
    *((1, 65_536), (65_536, 1)),
)
LONG = 65_536
"""Minimum number of pixels of a long image."""
ARRANGEMENTS = (1, 1), (4, 1), (1, 2), (1, 100), (2, 3)
"""Pairs of the oversampling and the number of frames."""

Array = npt.NDArray[Any]


@dataclasses.dataclass(frozen=True)
class Case:
    """Bits of a pattern, and their sensor."""

    sensor: dict[str, Any]
    """Parameters of the sensor; maps are functions of the shape in jots."""
    shape: tuple[int, int]
    pattern: str
    channels: int = 1

    def make(self) -> tuple[jl.Bits, jl.Sensor]:
        """Return the bits and the sensor."""
        plain = {name: value for name, value in self.sensor.items() if not callable(value)}
        side, frames = plain.get("oversampling", 1), plain.get("frames", 1)
        jots = self.shape[0] * side, self.shape[1] * side
        maps = {name: value(jots) for name, value in self.sensor.items() if callable(value)}
        bits = PATTERNS[self.pattern]((frames, *jots), side)
        if self.channels > 1:
            bits = np.stack([bits, *[~bits] * (self.channels - 1)], axis=-1)
        # Without a sensor, 100 frames of 127 x 1 jots would look like one frame of 100 x 127.
        sensor = jl.Sensor(**plain, **maps)
        return jl.Bits.from_array(bits, sensor), sensor

    def __str__(self) -> str:
        values = {name: getattr(v, "__name__", v) for name, v in self.sensor.items()}
        settings = ", ".join(f"{name}={value}" for name, value in values.items())
        color = f" x {self.channels}" if self.channels > 1 else ""
        return f"{self.pattern} bits, {self.shape[0]} x {self.shape[1]}{color} pixels, {settings}"


def _checkerboard(shape: tuple[int, ...], side: int) -> Array:
    return np.indices(shape).sum(0) % 2 == 0


def _blocks(shape: tuple[int, ...], side: int) -> Array:
    rows, columns = np.indices(shape[1:]) // side
    return np.broadcast_to((rows + columns) % 2 == 0, shape)


def _single(shape: tuple[int, ...], side: int) -> Array:
    bits = np.zeros(shape, bool)
    bits.flat[bits.size // 2] = True
    return bits


def _row(shape: tuple[int, ...], side: int) -> Array:
    bits = np.zeros(shape, bool)
    bits[:, shape[1] // 2] = True
    return bits


def _random(fraction: float) -> Callable[[tuple[int, ...], int], Array]:
    return lambda shape, side: np.random.default_rng(0).random(shape) < fraction


PATTERNS: dict[str, Callable[[tuple[int, ...], int], Array]] = {
    "no": lambda shape, side: np.zeros(shape, bool),
    "all": lambda shape, side: np.ones(shape, bool),
    "alternating": _checkerboard,
    "block": _blocks,
    "single": _single,
    "row": _row,
    "half": _random(0.5),
    "sparse": _random(0.01),
}
"""Functions that return bits for their shape (T, H·K̂, W·K̂) and for K̂."""


def _one_live(jots: tuple[int, int]) -> Array:
    mask = np.ones(jots, bool)
    mask[0, 0] = False
    return mask


def _dead_rows(jots: tuple[int, int]) -> Array:
    mask = np.zeros(jots, bool)
    mask[::2] = mask[-4:] = True
    mask[0, 0] = False
    return mask


def _hot_columns(jots: tuple[int, int]) -> Array:
    dark = np.zeros(jots, np.float32)
    dark[:, ::3], dark[:, 1::3] = 1e6, 1e-30
    return dark


def _unequal(jots: tuple[int, int]) -> Array:
    return np.geomspace(1e-6, 1, jots[0] * jots[1], dtype=np.float32).reshape(jots)


SENSORS: dict[str, dict[str, Any]] = {
    "linear kernel": {"kernel": "linear"},
    "quadratic kernel": {"kernel": "quadratic"},
    "cubic kernel": {"kernel": "cubic"},
    "low S": {"max_intensity": 1e-6},
    "high S": {"max_intensity": 1e6},
    "lowest S": {"max_intensity": 1e-18},
    "highest S": {"max_intensity": 1e18},
    "low efficiency": {"efficiency": 1e-6},
    "tiny dark counts": {"dark_counts": 1e-30},
    "dark counts": {"dark_counts": 1.0},
    "many dark counts": {"dark_counts": 1e6},
    "one live jot": {"mask": _one_live},
    "dead rows": {"mask": _dead_rows},
    "hot columns": {"dark_counts": _hot_columns},
    "unequal efficiency": {"efficiency": _unequal},
    "all maps": {"mask": _dead_rows, "dark_counts": _hot_columns, "efficiency": _unequal},
    "all maps, cubic kernel": {"mask": _dead_rows, "dark_counts": _hot_columns, "kernel": "cubic"},
    "color": {},
}
"""Parameters beside the arrangement, gain, and threshold, by name."""


def build_cases(trials: int | None) -> Iterator[Case]:
    """Yield all cases for a method; `trials` is the only K that the method serves, or None."""
    arrangements, base = ARRANGEMENTS, (2, 3)
    if trials is not None:
        base = round(trials**0.5), 1
        arrangements = base, (1, trials)
    yield from _exposures(base)
    yield from _shapes(arrangements)
    yield from _sensors(base)


def _sensor(arrangement: tuple[int, int], gain: float | None, threshold: int) -> dict[str, Any]:
    oversampling, frames = arrangement
    sensor = {"oversampling": oversampling, "frames": frames, "threshold": threshold}
    return sensor if gain is None else {**sensor, "gain": gain}


def _exposures(arrangement: tuple[int, int]) -> Iterator[Case]:
    for gain, threshold, pattern in itertools.product([*GAINS, None], THRESHOLDS, PATTERNS):
        yield Case(_sensor(arrangement, gain, threshold), (13, 17), pattern)


def _shapes(arrangements: tuple[tuple[int, int], ...]) -> Iterator[Case]:
    for shape, arrangement, pattern in itertools.product(SHAPES, arrangements, PATTERNS):
        for gain in FEW_GAINS:
            # Long images take seconds, so there are few of them.
            if shape[0] * shape[1] < LONG or (gain is None and arrangement == arrangements[0]):
                yield Case(_sensor(arrangement, gain, 1), shape, pattern)


def _sensors(arrangement: tuple[int, int]) -> Iterator[Case]:
    for name, pattern, gain, threshold in itertools.product(
        SENSORS, PATTERNS, FEW_GAINS, (1, THRESHOLDS[-1])
    ):
        sensor = {**_sensor(arrangement, gain, threshold), **SENSORS[name]}
        yield Case(sensor, (7, 11), pattern, channels=3 if name == "color" else 1)
