"""The named scenes: the planes of each, with random paths."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.datasets.moving_scenes.paths import Path, random_shifts
from jotlight.datasets.moving_scenes.planes import Outline, Plane, Waves
from jotlight.datasets.moving_scenes.textures import Texture

Array = npt.NDArray[np.float64]

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


def _half_plane(slope: float, row: float) -> Outline:
    """Return the outline of what lies below a line. At the center, the line is at `row`."""

    def opacity(points: Array) -> Array:
        return np.asarray(np.clip(points[0] - slope * points[1] + row + 0.5, 0, 1))

    return opacity
