"""Color mosaics: which filter lies on each pixel, and the light that it passes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Colors, Pattern
from jotlight.arrays import HasReadOnlyArrays
from jotlight.sensing.parameters import mosaic_checks, mosaic_text
from jotlight.squares import repeat_squares

MAX_PERIOD = 16
"""Maximum rows and columns of a pattern that repeats. A larger one is a map of all pixels."""

_BAYER = ("RGGB", "BGGR", "GRBG", "GBRG")


@dataclasses.dataclass(frozen=True, eq=False, repr=False, init=False)
class Mosaic(HasReadOnlyArrays):
    """A color filter on each pixel of a sensor.

    A pixel with a filter that passes the shares t of red, green, and blue sees the light of the
    intensity ``t[0] * red + t[1] * green + t[2] * blue``.

    Parameters
    ----------
    pattern : str or array_like
        The filter of each pixel, from the top left, in one of these forms:

        - letters: ``"RGGB"`` is 2 x 2 pixels, ``"RGB"`` is one row, and ``/`` ends a row, as in
          ``"RGBW/BWRG"``;
        - a list of rows, or a 2-D array of letters;
        - a 2-D array of indices into `filters`, such as ``raw_pattern`` of rawpy;
        - an image (H, W, 3), whose pixels are the shares of red, green, and blue that pass.

        A pattern of up to 16 x 16 pixels repeats. A larger one is a map of all pixels.
    filters : str, optional
        A letter for each filter, such as ``"RGBG"``. A pattern of indices needs it. Default: the
        letters of the pattern, R, G, B, W, C, M, Y before others.
    transmission : array_like of float, shape (N, 3), optional
        The shares of red, green, and blue light that each of the `filters` passes, 0 to 1. Default:
        ideal filters, for the letters R, G, B, W (white, 1 for all three), C, M, and Y.
    white_balance : array_like of float, shape (3,)
        Factors of red, green, and blue in estimates. They also multiply S, the largest intensity.

    Raises
    ------
    TypeError, ValueError
        When the pattern has another form or unknown letters, an array has another shape or values
        out of range, or the filters do not tell red, green, and blue apart.

    Examples
    --------
    >>> Mosaic("RGGB").pattern.tolist(), Mosaic("RGGB").filters
    ([[0, 1], [1, 2]], 'RGB')
    >>> Mosaic([[0, 1], [3, 2]], filters="RGBG") == Mosaic("RGGB")  # as rawpy states it
    True
    >>> Mosaic("RGBW").light(np.full((2, 2, 3), 0.5)).tolist()
    [[0.5, 0.5], [0.5, 1.5]]
    """

    pattern: Pattern
    filters: str
    transmission: Colors
    white_balance: Colors

    def __init__(
        self,
        pattern: npt.ArrayLike,
        filters: str | None = None,
        transmission: npt.ArrayLike | None = None,
        white_balance: npt.ArrayLike = (1.0, 1.0, 1.0),
    ) -> None:
        indices, letters, passed = _read(pattern, filters, transmission)
        if np.linalg.matrix_rank(passed) < 3:
            raise ValueError(
                f"mosaic: expected filters that tell red, green, and blue apart, got {letters} "
                f"with the transmission {passed.round(3).tolist()}; a gray sensor has "
                "mosaic=None"
            )
        checked = {
            "pattern": indices,
            "filters": letters,
            "transmission": passed,
            "white_balance": mosaic_checks.checked_white_balance(white_balance),
        }
        for name, value in checked.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, value: object) -> Self:
        """Return a mosaic from what ``Sensor(mosaic=)`` takes, or from :meth:`to_json`.

        Examples
        --------
        >>> Mosaic.of(Mosaic("GRBG").to_json())
        Mosaic('GRBG')
        """
        if isinstance(value, cls):
            return value
        if isinstance(value, dict):
            try:
                return cls(**{**value, "pattern": mosaic_text.pattern_of_json(value)})
            except (KeyError, TypeError) as error:
                raise ValueError(
                    "mosaic: expected an object with pattern and filters, and optionally "
                    f"transmission and white_balance, but {error}"
                ) from error
        return cls(value)  # type: ignore[arg-type]

    def to_json(self) -> dict[str, Any]:
        """Return the mosaic as values of JSON, which :meth:`of` reads."""
        pattern = self.pattern
        return {
            "pattern": pattern.tolist() if self.repeats else mosaic_text.compress_map(pattern),
            "filters": self.filters,
            "transmission": self.transmission.tolist(),
            "white_balance": self.white_balance.tolist(),
        }

    @property
    def repeats(self) -> bool:
        """Whether the pattern repeats, rather than being a map of all pixels."""
        return bool(max(self.pattern.shape) <= MAX_PERIOD)

    @property
    def is_ideal(self) -> bool:
        """Whether each filter passes what its letter says: W passes all light, R only red."""
        return mosaic_checks.are_ideal(self.filters, self.transmission)

    @property
    def bayer(self) -> str | None:
        """The order of a Bayer mosaic, such as "RGGB", or None for other mosaics."""
        letters = mosaic_text.letters_of(self.pattern, self.filters)
        return letters if self.pattern.shape == (2, 2) and letters in _BAYER else None

    @property
    def sensitivity(self) -> Colors:
        """The light that each filter passes of white light with intensity 1 in all colors, (N,)."""
        return np.asarray(self.transmission.sum(axis=1))

    def check_size(self, height: int, width: int) -> None:
        """Raise ValueError unless the mosaic fits an image of some pixels.

        Examples
        --------
        >>> Mosaic(np.random.default_rng(0).integers(3, size=(40, 50)), "RGB").check_size(40, 48)
        Traceback (most recent call last):
          ...
        ValueError: mosaic: expected a map of 40 x 48 pixels, or a pattern of up to 16 x 16 ...
        """
        if not self.repeats and self.pattern.shape != (height, width):
            rows, columns = self.pattern.shape
            raise ValueError(
                f"mosaic: expected a map of {height} x {width} pixels, or a pattern of up to "
                f"{MAX_PERIOD} x {MAX_PERIOD} that repeats, got {rows} x {columns}; a mosaic has a "
                "filter for each pixel, which covers oversampling x oversampling jots"
            )

    def full(self, height: int, width: int) -> Pattern:
        """Return the index into `filters` of each pixel of an image, (H, W)."""
        self.check_size(height, width)
        rows, columns = self.pattern.shape
        tiles = -(-height // rows), -(-width // columns)
        return np.tile(self.pattern, tiles)[:height, :width]

    def of_jots(self, height: int, width: int, oversampling: int) -> Pattern:
        """Return the index into `filters` of each jot, (H, W) in jots.

        Examples
        --------
        >>> Mosaic("RGGB").of_jots(2, 4, oversampling=2).tolist()
        [[0, 0, 1, 1], [0, 0, 1, 1]]
        """
        pixels = self.full(height // oversampling, width // oversampling)
        return repeat_squares(pixels, oversampling)

    def without_white_balance(self) -> Self:
        """Return the mosaic with the white balance 1, so that estimates are intensities.

        Examples
        --------
        >>> Mosaic("RGGB", white_balance=[1.2, 1, 1.5]).without_white_balance()
        Mosaic('RGGB')
        """
        return dataclasses.replace(self, white_balance=np.ones(3))

    def crop(self, rows: range, columns: range) -> Self:
        """Return the mosaic of a part of the image.

        Examples
        --------
        >>> Mosaic("RGGB").crop(range(1, 5), range(0, 4))
        Mosaic('GBRG')
        """
        if self.repeats:
            shifted = np.roll(self.pattern, (-rows.start, -columns.start), (0, 1))
            return dataclasses.replace(self, pattern=shifted)
        return dataclasses.replace(
            self, pattern=self.pattern[rows.start : rows.stop, columns.start : columns.stop]
        )

    def oriented(self, orient: Callable[[Pattern], Pattern], height: int, width: int) -> Self:
        """Return the mosaic of an image of some pixels that `orient` rotates or mirrors."""
        if not self.repeats:
            return dataclasses.replace(self, pattern=orient(self.pattern))
        rows, columns = orient(self.pattern).shape
        pattern = orient(self.full(height, width))[:rows, :columns]
        return dataclasses.replace(self, pattern=pattern)

    def light(
        self, image: npt.NDArray[np.floating], channel_axis: int | None = None
    ) -> npt.NDArray[np.floating]:
        """Return the intensities that the pixels see of color images, (..., H, W).

        Parameters
        ----------
        image : ndarray of float, shape (..., H, W, 3)
            Red, green, and blue.
        channel_axis : int, optional
            The axis of the colors. Default: the last one.

        Raises
        ------
        ValueError
            When an image has no axis of three colors, or the mosaic does not fit it.
        """
        axis = -1 if channel_axis is None else channel_axis
        if image.ndim < 3 or not -image.ndim <= axis < image.ndim or image.shape[axis] != 3:
            raise ValueError(
                "image: expected red, green, and blue, (..., H, W, 3), for a sensor with a mosaic, "
                f"got shape {image.shape}; for a gray scene, pass "
                "numpy.stack([image] * 3, axis=-1)"
            )
        colors = np.moveaxis(image, axis, -1)
        shares = self.transmission[self.full(*colors.shape[-3:-1])].astype(image.dtype)
        return np.asarray(np.einsum("...c,...c->...", colors, shares))

    def colors(self, values: npt.NDArray[np.floating], weights: npt.ArrayLike) -> Colors:
        """Return red, green, and blue of what the filters see, with the white balance.

        Parameters
        ----------
        values : ndarray, shape (..., N)
            The intensity behind each filter, divided by its :attr:`sensitivity`.
        weights : array_like of float, shape (N,) or (..., N)
            How much the values of each filter count, if there are more than three filters. Filters
            with weight 0 are ignored.

        Raises
        ------
        ValueError
            When the filters with a weight do not tell red, green, and blue apart.

        Examples
        --------
        >>> mixed = Mosaic("RGGB", transmission=[[0.8, 0.1, 0.1], [0, 1, 0], [0, 0, 1]])
        >>> mixed.colors(np.array([0.5, 0.2, 0.1]), [1, 2, 1]).round(4)
        array([0.5875, 0.2   , 0.1   ])
        """
        if np.ndim(weights) == 1:
            return np.asarray(values @ self.inverse(weights).T * self.white_balance)
        matrix = self.transmission / self.sensitivity[:, None]
        products = (matrix[:, :, None] * matrix[:, None, :]).reshape(len(matrix), -1)
        each = np.asarray(weights, np.float64)
        normal = (each @ products).reshape(*each.shape[:-1], 3, 3)
        found = np.linalg.solve(normal, ((each * values) @ matrix)[..., None])[..., 0]
        return np.asarray(found * self.white_balance)

    def inverse(self, weights: npt.ArrayLike) -> Colors:
        """Return the matrix from what the filters see to red, green, and blue, (3, N).

        The parameters and errors are those of :meth:`colors`.

        Examples
        --------
        >>> np.allclose(Mosaic("RGGB").inverse([1, 2, 1]), np.eye(3))
        True
        """
        scale = np.sqrt(np.asarray(weights, np.float64))[:, None]
        matrix = self.transmission / self.sensitivity[:, None] * scale
        if np.linalg.matrix_rank(matrix) < 3:
            used = "".join(np.array(list(self.filters))[np.asarray(weights) > 0])
            raise ValueError(
                f"mosaic: expected pixels of filters that tell red, green, and blue apart, got "
                f"{used}; reconstruct a larger image"
            )
        return np.asarray(np.linalg.pinv(matrix) * scale.T)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mosaic):
            return NotImplemented
        return self.filters == other.filters and all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("pattern", "transmission", "white_balance")
        )

    def __hash__(self) -> int:
        return hash((self.filters, self.pattern.tobytes(), self.transmission.tobytes()))

    def __repr__(self) -> str:
        rows, columns = self.pattern.shape
        if rows * columns > 2 * MAX_PERIOD:
            return f"<Mosaic: {rows} x {columns} pixels, filters {self.filters}>"
        parts = [repr(mosaic_text.letters_of(self.pattern, self.filters))]
        if not self.is_ideal:
            parts.append(f"transmission={self.transmission.tolist()}")
        if (self.white_balance != 1).any():
            parts.append(f"white_balance={self.white_balance.tolist()}")
        return f"Mosaic({', '.join(parts)})"


def _read(pattern: Any, filters: Any, transmission: Any) -> tuple[Pattern, str, Colors]:
    """Return the pattern as indices, the letters of the filters, and the light that they pass."""
    if mosaic_checks.is_image(pattern):
        if filters is not None or transmission is not None:
            raise ValueError(
                "mosaic: expected no filters and no transmission beside an image (H, W, 3), "
                "which states what each pixel passes; leave them out"
            )
        indices, passed = mosaic_checks.of_image(np.asarray(pattern))
        letters = "".join(map(mosaic_checks.letter_of, passed.tolist(), range(len(passed))))
    else:
        indices, letters = mosaic_text.read_pattern(pattern, filters)
        passed = transmission
    passed = mosaic_checks.checked_transmission(passed, indices, letters)
    return mosaic_checks.sort_filters(indices, letters, passed)
