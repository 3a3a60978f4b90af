"""The named scenes: the planes of each, with random paths."""

from collections.abc import Callable

import numpy as np

from jotlight.array_types import Array
from jotlight.datasets.moving_scenes.paths import Path, random_shifts
from jotlight.datasets.moving_scenes.planes import Outline, Plane, Waves
from jotlight.datasets.moving_scenes.textures import Texture

Maker = Callable[[Texture, Texture, int, np.random.Generator], list[Plane]]
"""A function of the textures of background and foreground, the number of frames, and a generator.

It returns the planes from back to front.
"""


def _static(back: Texture, _: Texture, frames: int, __: np.random.Generator) -> list[Plane]:
    return [Plane(back, Path.from_shifts(np.zeros((frames, 2))))]


def _shake(back: Texture, _: Texture, frames: int, rng: np.random.Generator) -> list[Plane]:
    return [Plane(back, Path.from_shifts(random_shifts(frames, rng.uniform(12, 36), rng)))]


def _rotate(back: Texture, _: Texture, frames: int, rng: np.random.Generator) -> list[Plane]:
    time = _centered_time(frames)
    angle = np.deg2rad(4) * (time + 0.3 * np.sin(2.5 * time))
    return [Plane(back, Path(random_shifts(frames, 8, rng), angle, np.exp(-0.05 * time)))]


def _fast(back: Texture, _: Texture, frames: int, rng: np.random.Generator) -> list[Plane]:
    direction = rng.uniform(-0.25, 0.25) + rng.choice([0, np.pi])
    time = np.arange(frames) - frames // 2
    rows = 0.6 * time * np.sin(direction) + 12 * np.sin(time / 60)
    shifts = np.stack([rows, time * np.cos(direction)], axis=1)
    if frames > 1:
        shifts /= np.linalg.norm(np.diff(shifts, axis=0), axis=1).mean()
    return [Plane(back, Path.from_shifts(shifts))]


def _layers(back: Texture, front: Texture, frames: int, _: np.random.Generator) -> list[Plane]:
    return [_drifting(back, frames), _object(front, frames)]


def _spin(back: Texture, _: Texture, frames: int, rng: np.random.Generator) -> list[Plane]:
    angle = np.deg2rad(30) * rng.choice([-1, 1]) * _centered_time(frames)
    return [Plane(back, Path(random_shifts(frames, 8, rng), angle, np.ones(frames)))]


def _parallax(back: Texture, front: Texture, frames: int, rng: np.random.Generator) -> list[Plane]:
    shifts = random_shifts(frames, rng.uniform(12, 24), rng)
    near, far = (Path.from_shifts(factor * shifts) for factor in (1.5, 0.5))
    return [
        Plane(back, far),
        Plane(front, Path.from_shifts(shifts), _half_plane(0.0, -20.0)),
        Plane(back, near, _half_plane(0.3, -70.0)),
    ]


def _sheet(back: Texture, _: Texture, frames: int, rng: np.random.Generator) -> list[Plane]:
    path = Path.from_shifts(random_shifts(frames, rng.uniform(6, 12), rng))
    return [Plane(back, path, waves=Waves(amplitude=5, wavelength=96, period=1.3 * frames))]


def _flicker(back: Texture, _: Texture, frames: int, rng: np.random.Generator) -> list[Plane]:
    path = Path.from_shifts(random_shifts(frames, rng.uniform(12, 36), rng))
    brightness = 1 + 0.3 * np.sin(2 * np.pi * (np.arange(frames) - frames // 2) / (frames / 5))
    return [Plane(back, path, brightness=brightness)]


def _appear(back: Texture, front: Texture, frames: int, _: np.random.Generator) -> list[Plane]:
    return [_drifting(back, frames), _object(front, frames, appears=0.6 * frames)]


def _several(number: int) -> Maker:
    """Return the maker of a scene with several objects."""

    def make(back: Texture, front: Texture, frames: int, rng: np.random.Generator) -> list[Plane]:
        time = np.linspace(-1, 1, frames)
        turn = rng.uniform(0, 2 * np.pi)
        planes = [_drifting(back, frames)]
        for index in range(number):
            angle = turn + 2 * np.pi * index / number
            around = np.array([np.sin(angle), np.cos(angle)])
            course = angle + rng.uniform(0.3, 0.7) * np.pi
            path = np.outer(time + 0.25 * time**2, [np.sin(course), np.cos(course)])
            shifts = rng.uniform(10, 16) * path
            planes.append(
                Plane(
                    front,
                    Path.from_shifts(shifts - shifts[frames // 2]),
                    _disk(72 * around, 100 / (number + 1)),
                )
            )
        return planes

    return make


def _small(back: Texture, front: Texture, frames: int, _: np.random.Generator) -> list[Plane]:
    path = _object(front, frames).path
    return [_drifting(back, frames), Plane(front, path, _disk(np.zeros(2), 16))]


def _stop(back: Texture, front: Texture, frames: int, _: np.random.Generator) -> list[Plane]:
    shifts = _object(front, frames).path.shift
    shifts = shifts[np.minimum(np.arange(frames), int(0.6 * frames))]
    path = Path.from_shifts(shifts - shifts[frames // 2])
    return [_drifting(back, frames), Plane(front, path, _blob)]


def _person(back: Texture, front: Texture, frames: int, _: np.random.Generator) -> list[Plane]:
    """Return a figure that walks: its limbs swing around their joints."""
    walk = _object(front, frames).path.shift * (0.5, 1.0)
    time = _centered_time(frames)
    planes = [_drifting(back, frames)]
    limbs = (
        ((-14, -12), (36, -26), 9, 0.4),
        ((-14, 12), (36, 26), 9, -0.4),
        ((24, -8), (84, -14), 11, -0.3),
        ((24, 8), (84, 14), 11, 0.3),
        ((-14, 0), (24, 0), 22, 0.0),
        ((-52, 0), (-50, 0), 16, 0.0),
    )
    for joint, end, radius, swing in limbs:
        angle = swing * np.sin(0.5 * np.pi * time)
        around = np.array(joint, np.float64)
        cosine, sine = np.cos(angle), np.sin(angle)
        turned = np.stack(
            [cosine * around[0] - sine * around[1], sine * around[0] + cosine * around[1]], axis=1
        )
        path = Path(walk + around - turned, angle, np.ones(frames))
        planes.append(Plane(front, path, _capsule(around, np.array(end, np.float64), radius)))
    return planes


MOTIONS: dict[str, Maker] = {
    "static": _static,
    "shake": _shake,
    "rotate": _rotate,
    "fast": _fast,
    "layers": _layers,
    "spin": _spin,
    "parallax": _parallax,
    "sheet": _sheet,
    "flicker": _flicker,
    "appear": _appear,
    "two": _several(2),
    "three": _several(3),
    "five": _several(5),
    "small": _small,
    "stop": _stop,
    "person": _person,
}
"""The functions that make the named scenes. :func:`jotlight.datasets.moving` describes them."""


def _centered_time(frames: int) -> Array:
    """Return the time of each frame, from about -1 to 1, and 0 in the middle frame."""
    time = np.linspace(-1, 1, frames)
    return np.asarray(time - time[frames // 2])


def _drifting(texture: Texture, frames: int) -> Plane:
    """Return a background that drifts by 12 columns and 6 rows."""
    shifts = np.stack([np.linspace(3, -3, frames), np.linspace(-6, 6, frames)], axis=1)
    return Plane(texture, Path.from_shifts(shifts - shifts[frames // 2]))


def _object(texture: Texture, frames: int, appears: float = -np.inf) -> Plane:
    """Return an object of 104 pixels that moves by about 32 columns and 16 rows."""
    time = np.linspace(-1, 1, frames)
    shifts = np.stack([8 * time, -16 * (time + 0.25 * time**2)], axis=1)
    path = Path.from_shifts(shifts - shifts[frames // 2])
    return Plane(texture, path, _blob, appears=appears)


def _blob(points: Array) -> Array:
    """Return the opacity of a rounded triangle around the center."""
    angle = np.arctan2(points[0], points[1])
    radius = 52 + 10 * np.cos(3 * angle + 1)
    return np.asarray(np.clip(radius - np.hypot(*points) + 0.5, 0, 1))


def _disk(center: Array, radius: float) -> Outline:
    """Return the outline of a disk."""
    return _capsule(center, center, radius)


def _capsule(start: Array, end: Array, radius: float) -> Outline:
    """Return the outline of all points within a radius of a line from one point to another."""
    line = end - start
    squared = max(float(line @ line), 1e-9)

    def opacity(points: Array) -> Array:
        row, column = points[0] - start[0], points[1] - start[1]
        place = np.clip((row * line[0] + column * line[1]) / squared, 0, 1)
        distance = np.hypot(row - place * line[0], column - place * line[1])
        return np.asarray(np.clip(radius - distance + 0.5, 0, 1))

    return opacity


def _half_plane(slope: float, row: float) -> Outline:
    """Return the outline of what lies below a line. At the center, the line is at `row`."""

    def opacity(points: Array) -> Array:
        return np.asarray(np.clip(points[0] - slope * points[1] + row + 0.5, 0, 1))

    return opacity
