"""Planes: textures with an outline that move along paths."""

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.datasets.moving_scenes.paths import Path
from jotlight.datasets.moving_scenes.textures import Texture

Outline = Callable[[Array], Array]
"""A function that returns the opacity, from 0 to 1, of points (2, ...) of a plane."""

_INVERSION_STEPS = 40
"""Number of steps that invert a deformation. Each reduces the error by the factor of its slope,
which is at most a half."""


@dataclasses.dataclass(frozen=True)
class Waves:
    """A deformation of a plane by standing waves, as of a sheet in the wind.

    At time t, the position x shows the point x + a sin(2π t / `period`) s(x), where s has waves of
    length `wavelength` in both directions.
    """

    amplitude: float
    wavelength: float
    period: float

    def __call__(self, time: float, positions: Array) -> Array:
        """Return the displacement (2, ...) of positions (2, ...)."""
        phase = 2 * np.pi * positions / self.wavelength
        waves = np.stack([np.sin(phase[1]), np.sin(phase[0])])
        return np.asarray(self.amplitude * np.sin(2 * np.pi * time / self.period) * waves)


@dataclasses.dataclass(frozen=True)
class Plane:
    """A photograph that moves along a path. Its points are relative to the center of the image."""

    texture: Texture
    path: Path
    outline: Outline | None = None
    """The opacity of its points. Default: it is opaque everywhere."""
    waves: Waves | None = None
    """Its deformation, if there is any."""
    brightness: Array | None = None
    """Factor of its intensities in each frame, (T,). Default: 1."""
    appears: float = -np.inf
    """Time from which it is visible."""

    def points(self, time: float, positions: Array) -> Array:
        """Return which points of the plane are at some positions (2, ...) at a time."""
        if self.waves is not None:
            positions = positions + self.waves(time, positions)
        return self.path.points(time, positions)

    def positions(self, time: float, points: Array) -> Array:
        """Return where points of the plane are at a time: the inverse of `points`."""
        without_waves = self.path.positions(time, points)
        if self.waves is None:
            return without_waves
        positions = without_waves
        for _ in range(_INVERSION_STEPS):
            positions = without_waves - self.waves(time, positions)
        return positions

    def intensities(self, time: float, points: Array) -> npt.NDArray[np.float32]:
        """Return the intensities of points at a time."""
        rows, columns = (
            self.texture.detail * point + (size - 1) / 2
            for point, size in zip(points, self.texture.size, strict=True)
        )
        values = self.texture(rows, columns)
        if self.brightness is None:
            return values
        factor = np.interp(time, np.arange(len(self.brightness)), self.brightness)
        return values * np.float32(factor)

    def opacity(self, time: float, points: Array) -> Array:
        """Return the opacity of points at a time, from 0 to 1."""
        if time < self.appears:
            return np.zeros(points.shape[1:])
        return np.ones(points.shape[1:]) if self.outline is None else self.outline(points)
