"""The photographs that train the networks, and those that choose between checkpoints.

The folder of the data holds ``bsds300``, ``bsds500_extra``, and ``photographs``. Every tenth file
of `VALIDATION_FOLDERS` validates, and the first ten files of ``photographs/gb82`` are for other
tests. All other files of `WEIGHTS` train.
"""

from functools import cache
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.images.sets import ENDINGS
from jotlight.training import (
    PatchMixture,
    PhotographPatches,
    SyntheticPatches,
    read_photographs,
)

WEIGHTS = {
    "bsds300/train": 3.0,
    "bsds500_extra": 2.0,
    "photographs/cid22": 3.0,
    "photographs/clic2025": 0.6,
    "photographs/gb82": 0.4,
}
"""Folders of photographs, and their weights: about ten times the share of each patch."""

SYNTHETIC_WEIGHT, FINE = 0.8, 0.25
"""Weight of the drawings, and the fraction of them that is fine. Both improve text and gratings
(decision 51)."""

COLOR = LINEAR = 0.1
"""Fractions of the photographs' patches that are color planes, and that are linear in light."""

VALIDATION_FOLDERS = "bsds500_extra", "photographs/cid22", "photographs/clic2025"
VALIDATION_SIDE = 320
"""Height and width of the central part of validation photographs that is measured."""


def training_source(data: Path) -> PatchMixture:
    """Return the mixture of all photographs and synthetic patches that trains the networks."""
    sources = photograph_sources(data, color=COLOR, linear=LINEAR)
    return PatchMixture([*sources, (SyntheticPatches(fine=FINE), SYNTHETIC_WEIGHT)])


def photograph_sources(data: Path, **settings: float) -> list[tuple[PhotographPatches, float]]:
    """Return the training photographs of each folder, and their weights.

    `settings` are those of `PhotographPatches`, for each folder.
    """
    return [
        (PhotographPatches(photographs(data, folder), **settings), weight)
        for folder, weight in WEIGHTS.items()
    ]


@cache
def photographs(data: Path, folder: str) -> list[np.ndarray]:
    """Return the training photographs of a folder, as 8-bit levels."""
    return read_photographs(training_files(data, folder))


def training_files(data: Path, folder: str) -> list[Path]:
    """Return the files of a folder that train."""
    files = _files(data / folder)
    if folder in VALIDATION_FOLDERS:
        return [path for number, path in enumerate(files, 1) if number % 10]
    return files[10:] if folder == "photographs/gb82" else files


def validation_files(data: Path) -> list[Path]:
    """Return every tenth file of `VALIDATION_FOLDERS`."""
    return [path for folder in VALIDATION_FOLDERS for path in _files(data / folder)[9::10]]


def validation_images(data: Path) -> list[np.ndarray]:
    """Return the central parts of the validation photographs, in gray."""
    images = [jl.read_image(path, gray=True) for path in validation_files(data)]
    return [_center(image) for image in images]


def _center(image: np.ndarray) -> np.ndarray:
    sizes = [min(size, VALIDATION_SIDE) for size in image.shape]
    starts = [(size - part) // 2 for size, part in zip(image.shape, sizes, strict=True)]
    (y, x), (height, width) = starts, sizes
    return np.ascontiguousarray(image[y : y + height, x : x + width])


def _files(folder: Path) -> list[Path]:
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS)
    if not files:
        raise FileNotFoundError(f"{folder}: expected photographs, found none")
    return files
