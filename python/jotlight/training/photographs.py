"""Patches of color photographs: planes, scales, and display-encoded or linear light."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Sequence
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Levels
from jotlight.errors import warn
from jotlight.images.color import luma
from jotlight.images.io import read_image
from jotlight.progress import Progress, shown_progress
from jotlight.training.images import describe_smallest
from jotlight.training.patch_sources import Patch, PatchSource, apply_symmetry

_LEVELS = np.arange(256) / 255
_ENCODED = _LEVELS.astype(np.float32)
"""Intensity of each level if photographs stay display-encoded."""

_LINEAR = np.where(_LEVELS <= 0.04045, _LEVELS / 12.92, ((_LEVELS + 0.055) / 1.055) ** 2.4).astype(
    np.float32
)
"""Intensity of each level in linear light, by the inverse of the sRGB curve (IEC 61966-2-1)."""


class PhotographPatches(PatchSource):
    """Random patches of photographs, randomly scaled, rotated, and mirrored.

    Photographs stay in memory as 8-bit levels, 4 bytes per pixel in color and 1 byte in gray.

    Parameters
    ----------
    photographs : sequence of uint8 arrays (H, W) or (H, W, 3)
        Display-encoded photographs. All are equally probable.
    color : float
        Fraction of the patches that are a color plane, if the photograph is in color. The others
        are luma.
    linear : float
        Fraction of the patches whose intensities are linear in light. The others stay
        display-encoded.
    scaled : float
        Fraction of the patches whose pixels are averages over areas of 1 × 1 to `max_scale` ×
        `max_scale` pixels. The averages make them sharper and less noisy than the photograph.
    max_scale : float
        Largest side of these areas, at least 1.

    Raises
    ------
    TypeError, ValueError
        When there is no photograph, when one is not of uint8 with such a shape, or when a setting
        is out of its range.

    Examples
    --------
    >>> photograph = np.full((20, 30, 3), 51, np.uint8)
    >>> source = PhotographPatches([photograph], linear=0.0)
    >>> patch = source.draw(np.random.default_rng(0), 8)
    >>> patch.values.shape, round(float(patch.values[0, 0]), 6)
    ((8, 8), 0.2)
    """

    def __init__(
        self,
        photographs: Sequence[npt.NDArray[np.uint8]],
        *,
        color: float = 0.25,
        linear: float = 0.25,
        scaled: float = 0.5,
        max_scale: float = 3.0,
    ) -> None:
        require_photographs(photographs)
        self._set(color, linear, scaled, max_scale)
        self.photographs = [
            planes_of(photograph, index) for index, photograph in enumerate(photographs)
        ]
        self.max_side = min(min(planes.shape[1:]) for planes in self.photographs)
        self._means = [mean_intensities(planes) for planes in self.photographs]

    def _set(self, color: float, linear: float, scaled: float, max_scale: float) -> None:
        """Check and set the settings."""
        for name, fraction in (("color", color), ("linear", linear), ("scaled", scaled)):
            if not 0 <= fraction <= 1:
                raise ValueError(f"{name}: expected a fraction in [0, 1], got {fraction}")
        if not 1 <= max_scale < math.inf:
            raise ValueError(f"max_scale: expected a finite number of 1 or more, got {max_scale}")
        self.color, self.linear, self.scaled, self.max_scale = color, linear, scaled, max_scale

    def __len__(self) -> int:
        """Return the number of photographs."""
        return len(self.photographs)

    def _photograph(self, index: int) -> tuple[Levels, Array]:
        """Return the planes of a photograph, and their :func:`mean_intensities`."""
        return self.photographs[index], self._means[index]

    @classmethod
    def read(
        cls,
        paths: Sequence[str | os.PathLike[str]],
        *,
        white: float | None = None,
        progress: Progress = False,
        **settings: float,
    ) -> Self:
        """Return the source of patches of image files, which :func:`read_photographs` reads.

        The other parameters, and the errors, are those of that function and of the class.
        """
        return cls(read_photographs(paths, white=white, progress=progress), **settings)

    def draw(self, rng: np.random.Generator, side: int) -> Patch:
        """Return a random patch."""
        planes, means = self._photograph(int(rng.integers(len(self))))
        is_color = rng.random() < self.color and len(planes) > 1
        plane = int(rng.integers(1, len(planes))) if is_color else 0
        values, is_linear = self._cut(rng, planes[plane : plane + 1], side)
        return Patch(values[0], float(means[int(is_linear), plane]))

    def _cut(
        self, rng: np.random.Generator, planes: Levels, side: int
    ) -> tuple[npt.NDArray[np.float32], bool]:
        """Return a random patch of planes, (P, side, side), and whether it is linear in light."""
        is_linear = bool(rng.random() < self.linear)
        size = np.array(planes.shape[1:])
        scale = 1.0
        if rng.random() < self.scaled:
            max_scale = min(self.max_scale, size.min() / side)
            scale = math.exp(rng.uniform(0, math.log(max_scale)))
        if scale == 1:
            corner = rng.integers(size - side + 1).astype(np.float64)
        else:
            corner = rng.uniform(0, np.maximum(size - scale * side, 0))
        tones = _LINEAR if is_linear else _ENCODED
        values = [_average_areas(plane, tones, corner, scale, side) for plane in planes]
        symmetry = int(rng.integers(8))
        return np.stack([apply_symmetry(each, symmetry) for each in values]), is_linear

    def fingerprint(self) -> str:
        """Return a digest of the photographs and of the settings."""
        settings = self.color, self.linear, self.scaled, self.max_scale
        digest = hashlib.sha256(repr(settings).encode())
        for planes in self.photographs:
            digest.update(repr(planes.shape).encode())
            digest.update(planes.data)
        return digest.hexdigest()

    def describe_limit(self) -> str:
        """Return a sentence about the smallest photograph."""
        return describe_smallest([planes[0] for planes in self.photographs])


def read_photographs(
    paths: Sequence[str | os.PathLike[str]],
    *,
    white: float | None = None,
    progress: Progress = False,
) -> list[npt.NDArray[np.uint8]]:
    """Return photographs in files as 8-bit levels, (H, W) or (H, W, 3).

    Parameters
    ----------
    paths : sequence of paths
        Image files that :func:`jotlight.read_image` reads. Levels of more than 8 bits are rounded.
    white : float, optional
        Value of intensity 1, as for :func:`jotlight.read_image`, such as 65535 for TIFF files of 16
        bits. Default: the full scale of 8-bit files and of PNG.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

    Raises
    ------
    TypeError
        For a single path in place of a list.
    OSError, ValueError
        When a file cannot be read, or has NaN or infinity; the message names it.

    Warns
    -----
    JotlightWarning
        When most pixels of a file are brighter than 1, and so become white.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> path = Path(tempfile.mkdtemp()) / "photograph.png"
    >>> jl.save_image(path, np.array([[0.0, 1.0]]))
    >>> read_photographs([path])
    [array([[  0, 255]], dtype=uint8)]
    """
    if isinstance(paths, str | os.PathLike):
        single = os.fspath(paths)
        raise TypeError(
            f"paths: expected a list of paths, got the single path {single!r}; pass [{single!r}], "
            f"or sorted(pathlib.Path({single!r}).iterdir()) for the files of a folder"
        )
    photographs = []
    with shown_progress(progress, "reading photographs") as update:
        for number, path in enumerate(paths, 1):
            photographs.append(as_levels(read_image(path, white=white), os.fspath(path)))
            update(number / len(paths))
    return photographs


def as_levels(image: npt.NDArray[np.floating], name: str) -> npt.NDArray[np.uint8]:
    """Return the intensities of a file as 8-bit levels, after checks.

    Examples
    --------
    >>> as_levels(np.array([[0.0, 0.2, 1.2]]), "photograph.tif")
    array([[  0,  51, 255]], dtype=uint8)
    """
    if not np.isfinite(image).all():
        raise ValueError(
            f"{name}: expected finite intensities, got NaN or infinity; leave this file out, or "
            "replace them"
        )
    if 2 * np.count_nonzero(image > 1) > image.size:
        warn(
            f"{name}: most intensities of a photograph should be at most 1, but most of them "
            f"exceed it, up to {image.max():.4g}, and become white; state the value of intensity 1 "
            "with white=, or divide the file by it"
        )
    levels: npt.NDArray[np.floating] = np.rint(np.clip(image, 0, 1) * 255)
    return levels.astype(np.uint8)


def require_photographs(photographs: object) -> None:
    """Raise TypeError unless photographs are a list or an array, and ValueError if it is empty."""
    if isinstance(photographs, str | os.PathLike | PatchSource):
        kind = (
            "a path" if isinstance(photographs, str | os.PathLike) else type(photographs).__name__
        )
        raise TypeError(
            "photographs: expected a list of uint8 arrays, such as that of "
            f"jotlight.training.read_photographs(paths), got {kind}"
        )
    if len(photographs) == 0:  # type: ignore[arg-type]
        raise ValueError("photographs: expected at least one, got none")


def planes_of(photograph: npt.NDArray[np.uint8], index: int) -> Levels:
    """Return the planes of a photograph, (P, H, W), after checks.

    They are luma alone, or luma, red, green, and blue.
    """
    if not isinstance(photograph, np.ndarray) or photograph.dtype != np.uint8:
        kind = getattr(photograph, "dtype", type(photograph).__name__)
        raise TypeError(
            f"photographs: expected uint8 arrays, got {kind} for number {index}; "
            "(255 * image).round().astype(numpy.uint8) is one of an image in [0, 1]"
        )
    is_color = photograph.ndim == 3 and photograph.shape[2] == 3
    if photograph.size == 0 or not (is_color or photograph.ndim == 2):
        raise ValueError(
            f"photographs: expected shapes (H, W) or (H, W, 3), got {photograph.shape} for number "
            f"{index}"
        )
    if not is_color:
        return np.ascontiguousarray(photograph[None])
    gray = np.rint(luma(photograph)).astype(np.uint8)
    return np.ascontiguousarray(np.stack([gray, *np.moveaxis(photograph, 2, 0)]))


def mean_intensities(planes: Levels) -> Array:
    """Return the mean intensity of each plane, display-encoded and linear, (2, P)."""
    histograms = [np.bincount(plane.ravel(), minlength=256) for plane in planes]
    weights = np.array(histograms).T / planes[0].size
    return np.asarray(np.stack([_ENCODED, _LINEAR]) @ weights)


def _average_areas(
    plane: npt.NDArray[np.uint8],
    tones: npt.NDArray[np.float32],
    corner: npt.NDArray[np.float64],
    scale: float,
    side: int,
) -> npt.NDArray[np.float32]:
    """Return the averages of `tones[plane]` over squares with sides of `scale` pixels.

    The squares fill `side` rows and columns, and the first one begins at `corner`.
    """
    first = np.floor(corner).astype(int)
    last = np.minimum(np.ceil(corner + scale * side).astype(int), plane.shape)
    values = tones[plane[first[0] : last[0], first[1] : last[1]]]
    if scale == 1:
        return values
    rows = _average_intervals(values, corner[0] - first[0], scale, side)
    return _average_intervals(rows.T, corner[1] - first[1], scale, side).T


def _average_intervals(
    values: npt.NDArray[np.float32], start: float, scale: float, number: int
) -> npt.NDArray[np.float32]:
    """Return the averages over intervals of rows, the first of which begins at `start`.

    There are `number` adjacent intervals with a length of `scale` rows. An interval may begin and
    end within a row.
    """
    sums = np.zeros((len(values) + 1, values.shape[1]), np.float32)
    np.cumsum(values, axis=0, out=sums[1:])
    bounds = start + scale * np.arange(number + 1)
    rows = np.minimum(bounds.astype(int), len(values) - 1)
    parts = (bounds - rows).astype(np.float32)[:, None]
    integrals = sums[rows] + parts * values[rows]
    return np.asarray(np.diff(integrals, axis=0) / np.float32(scale))
