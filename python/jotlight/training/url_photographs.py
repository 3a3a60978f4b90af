"""Patches of photographs in a folder of URLs, which are fetched when they are drawn."""

import collections
import hashlib
import tempfile
from pathlib import Path, PurePosixPath
from typing import Any

from jotlight.array_types import Array, Levels
from jotlight.formats.files.file_systems import explained, find_files, open_file_system
from jotlight.images.io import read_image
from jotlight.images.sets import ENDINGS
from jotlight.training.photographs import PhotographPatches, as_levels, mean_intensities, planes_of

_PHOTOGRAPHS = tuple(ending for ending in ENDINGS if ending != ".npy")


class UrlPhotographs(PhotographPatches):
    """Random patches of the photographs in a folder of URLs, such as ``s3://bucket/photographs``.

    A photograph is fetched when a patch of it is drawn for the first time. The photographs that
    were used last stay in memory. The patches depend on the random generator alone, not on what is
    in memory. So each process of a training on several machines reads what it needs.

    Parameters
    ----------
    folder : str
        URL of a folder that fsspec supports. Its image files are used, also those in folders below.
    max_side : int
        Largest height and width of a patch. No photograph may be smaller.
    max_bytes : int
        Maximum number of bytes of photographs in memory: 4 per pixel in color, 1 in gray.
    storage_options : dict, optional
        Options of the file system, such as ``{"anon": True}``.
    color, linear, scaled, max_scale : float
        As for :class:`jotlight.training.photographs.PhotographPatches`.

    Raises
    ------
    MissingExtraError
        When fsspec is not installed.
    OSError, ValueError
        When the folder cannot be listed, or has no photographs.

    Examples
    --------
    >>> import fsspec, io
    >>> from PIL import Image
    >>> file = io.BytesIO()
    >>> Image.new("L", (300, 280), 51).save(file, "PNG")
    >>> fsspec.filesystem("memory").pipe("/photographs/a.png", file.getvalue())
    >>> source = UrlPhotographs("memory://photographs", max_side=256)
    >>> import numpy as np
    >>> source.draw(np.random.default_rng(0), 64).values.shape
    (64, 64)
    """

    def __init__(
        self,
        folder: str,
        *,
        max_side: int = 256,
        max_bytes: int = 1 << 30,
        storage_options: dict[str, Any] | None = None,
        color: float = 0.25,
        linear: float = 0.25,
        scaled: float = 0.5,
        max_scale: float = 3.0,
    ) -> None:
        self._fs, _ = open_file_system(folder, storage_options)
        found = find_files(folder, storage_options)
        self._files = [
            (name, facts) for name, *facts in found if name.lower().endswith(_PHOTOGRAPHS)
        ]
        if not self._files:
            raise ValueError(
                f"{folder}: expected photographs ({', '.join(_PHOTOGRAPHS)}), got none"
            )
        self._set(color, linear, scaled, max_scale)
        self.max_side, self._max_bytes, self._folder = max_side, max_bytes, folder
        self._kept: collections.OrderedDict[int, tuple[Levels, Array]] = collections.OrderedDict()
        self._bytes = 0

    def __len__(self) -> int:
        """Return the number of photographs."""
        return len(self._files)

    def _photograph(self, index: int) -> tuple[Levels, Array]:
        if index in self._kept:
            self._kept.move_to_end(index)
            return self._kept[index]
        name, _ = self._files[index]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, PurePosixPath(name).name)
            with explained(name):
                path.write_bytes(self._fs.cat_file(name))
            planes = planes_of(as_levels(read_image(path), name), index)
        if min(planes.shape[1:]) < self.max_side:
            raise ValueError(
                f"{name}: expected photographs of at least {self.max_side} x {self.max_side} "
                f"pixels, got {planes.shape[1]} x {planes.shape[2]}; pass a smaller max_side"
            )
        while self._kept and self._bytes + planes.nbytes > self._max_bytes:
            _, (dropped, _) = self._kept.popitem(last=False)
            self._bytes -= dropped.nbytes
        self._kept[index] = planes, mean_intensities(planes)
        self._bytes += planes.nbytes
        return self._kept[index]

    def fingerprint(self) -> str:
        """Return a digest of the names and the states of the files, and of the settings."""
        settings = self.color, self.linear, self.scaled, self.max_scale, self.max_side
        return hashlib.sha256(repr((settings, self._files)).encode()).hexdigest()

    def describe_limit(self) -> str:
        """Return a sentence about `max_side`."""
        return f"The photographs of {self._folder} have patches of at most {self.max_side} pixels"
