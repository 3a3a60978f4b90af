"""Paths: where a plane is at each time, as a shift, an angle, and a zoom."""

import dataclasses
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array


@dataclasses.dataclass(frozen=True)
class Path:
    """The pose of a plane in each frame. Between two frames, it changes linearly.

    The point X of a plane, relative to the center of the image, is at Z R X + shift, where R
    rotates by the angle and Z is the zoom.

    Parameters
    ----------
    shift : ndarray of float, shape (T, 2)
        Rows and columns in pixels.
    angle : ndarray of float, shape (T,)
        Radians, from the axis of the rows to that of the columns.
    zoom : ndarray of float, shape (T,)
        Factors above 0.
    """

    shift: Array
    angle: Array
    zoom: Array

    @classmethod
    def from_shifts(cls, shift: npt.ArrayLike) -> Self:
        """Return a path without rotation and zoom.

        Examples
        --------
        >>> path = Path.from_shifts([[0, 0], [2, 4]])
        >>> path.positions(0.5, np.zeros((2, 1))).ravel().tolist()
        [1.0, 2.0]
        """
        shifts = np.asarray(shift, np.float64)
        return cls(shifts, np.zeros(len(shifts)), np.ones(len(shifts)))

    @classmethod
    def from_table(cls, table: npt.ArrayLike) -> Self:
        """Return the path of a table with a line per frame.

        Parameters
        ----------
        table : array_like of float, shape (T, 2) or (T, 4)
            The shift in rows and in columns in pixels, and optionally the angle in degrees and the
            zoom.

        Raises
        ------
        ValueError
            When the table has another shape, or numbers that are not finite, or a zoom of 0 or
            less.
        """
        values = np.asarray(table, np.float64)
        if values.ndim != 2 or values.shape[1] not in (2, 4) or len(values) == 0:
            raise ValueError(
                "motion: expected a line per frame with 2 numbers (shift in rows and columns) or 4 "
                f"(also the angle in degrees and the zoom), got shape {values.shape}"
            )
        if not np.isfinite(values).all() or (values.shape[1] == 4 and values[:, 3].min() <= 0):
            raise ValueError("motion: expected finite numbers, and zooms above 0")
        if values.shape[1] == 2:
            return cls.from_shifts(values)
        return cls(values[:, :2], np.deg2rad(values[:, 2]), values[:, 3])

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.shift)

    def positions(self, time: float, points: Array) -> Array:
        """Return where points of the plane, (2, ...), are in the image at a time."""
        shift, rotation = self._pose(time)
        moved = np.einsum("ij,j...->i...", rotation, points)
        return np.asarray(moved + _as_column(shift, points))

    def points(self, time: float, positions: Array) -> Array:
        """Return which points of the plane are at some positions: the inverse of `positions`."""
        shift, rotation = self._pose(time)
        inverse = np.linalg.inv(rotation)
        centered = positions - _as_column(shift, positions)
        return np.asarray(np.einsum("ij,j...->i...", inverse, centered))

    def _pose(self, time: float) -> tuple[Array, Array]:
        """Return the shift, and the product of zoom and rotation."""
        first = int(np.clip(np.floor(time), 0, max(0, len(self) - 2)))
        last = min(first + 1, len(self) - 1)

        def at(values: Array) -> Array:
            return np.asarray(values[first] + (time - first) * (values[last] - values[first]))

        cosine, sine = np.cos(at(self.angle)), np.sin(at(self.angle))
        return at(self.shift), at(self.zoom) * np.array([[cosine, -sine], [sine, cosine]])


def random_shifts(frames: int, extent: float, rng: np.random.Generator) -> Array:
    """Return a smooth random path, (T, 2), whose bounding box has a diagonal of `extent` pixels.

    It is a sum of four sines, and starts at 0 in the middle frame.
    """
    time = np.linspace(0, 1, frames)[:, None]
    shifts = np.zeros((frames, 2))
    for mode in range(1, 5):
        amplitude = rng.normal(size=2) / mode**1.2
        shifts += amplitude * np.sin(np.pi * mode * time + rng.uniform(0, 2 * np.pi, 2))
    diagonal = float(np.linalg.norm(np.ptp(shifts, axis=0)))
    shifts *= extent / diagonal if diagonal > 0 else 0.0
    return np.asarray(shifts - shifts[frames // 2])


def _as_column(vector: Array, like: Array) -> Array:
    return vector.reshape(2, *[1] * (like.ndim - 1))
