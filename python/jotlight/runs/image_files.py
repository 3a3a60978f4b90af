"""Files of the images of a video. Each ends in its CRC-32C, as the chunks of zarr arrays may."""

import dataclasses
import itertools
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
import numpy.typing as npt

from jotlight.files import flush_to_disk
from jotlight.formats.files.safe_paths import check_inside
from jotlight.formats.zarr.writing import import_zarr

_CHECKSUM_BYTES = 4

_BLOCK_BYTES = 1 << 24
"""Number of bytes that are read at a time."""

_FILES = 4
"""Number of files that are checked, or flushed to the disk, at a time."""

S = TypeVar("S")
T = TypeVar("T")


def write_image(path: Path, image: npt.NDArray[Any]) -> None:
    """Write a contiguous image as the chunk that the zarr library would write, but faster.

    Raises
    ------
    OSError
        When the image cannot be written. The error names the file.
    """
    import google_crc32c

    data: Any = image.reshape(-1).view(np.uint8)
    checksum = google_crc32c.value(data).to_bytes(_CHECKSUM_BYTES, "little")
    with path.open("wb", buffering=0) as file:
        try:
            for left in (memoryview(data), memoryview(checksum)):
                while len(left) > 0:  # if a part was written, the next write states the reason
                    left = left[file.write(left) :]
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from error
        if hasattr(os, "posix_fadvise"):
            # Linux then begins to write the image, and later waits less for the disk.
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def map_in_threads(function: Callable[[S], T], items: Iterable[S]) -> Iterator[T]:
    """Yield `function` of each item in order. The disk completes many requests at a time.

    Examples
    --------
    >>> list(map_in_threads(len, ["a", "bc"]))
    [1, 2]
    """
    left = iter(items)
    with ThreadPoolExecutor(_FILES) as threads:
        while batch := list(itertools.islice(left, _FILES**2)):
            yield from threads.map(function, batch)


@dataclasses.dataclass(frozen=True)
class ImageFiles:
    """The files of the images of a zarr array, of which each is a chunk.

    Parameters
    ----------
    folder : path
        The zarr array.
    shape : tuple of int
        (N, H, W) or (N, H, W, C).
    dtype : str
        Type of the values.
    """

    folder: Path
    shape: tuple[int, ...]
    dtype: str

    @property
    def nbytes(self) -> int:
        """Number of bytes of an image, without its checksum."""
        return math.prod(self.shape[1:]) * np.dtype(self.dtype).itemsize

    def path(self, index: int) -> Path:
        """Return the file of an image.

        Examples
        --------
        >>> ImageFiles(Path("v.zarr"), (9, 3, 4), "float32").path(7).name
        'c.7.0.0'
        """
        return self.folder / f"c.{index}{'.0' * len(self.shape[1:])}"

    def find(self) -> set[int]:
        """Return the numbers of the images whose files have the right size.

        A damaged description may state any N. So the time depends on the number of files only.

        Raises
        ------
        OSError, ValueError
            When the folder cannot be read, or a link leads out of it.
        """
        pattern = re.compile(r"c\.(0|[1-9]\d*)" + r"\.0" * len(self.shape[1:]))
        found = set()
        with os.scandir(self.folder) as entries:
            for entry in entries:
                match = pattern.fullmatch(entry.name)
                if match is None or int(match[1]) >= self.shape[0]:
                    continue
                if entry.is_symlink():
                    check_inside(Path(entry.path), self.folder)
                if entry.is_file() and entry.stat().st_size == self.nbytes + _CHECKSUM_BYTES:
                    found.add(int(match[1]))
        return found

    def describe(self, attributes: dict[str, Any]) -> bytes:
        """Return the content of the `zarr.json` of the array."""
        zarr = import_zarr()
        files: dict[str, Any] = {}
        zarr.create_array(
            zarr.storage.MemoryStore(files),
            shape=self.shape,
            chunks=(1, *self.shape[1:]),
            dtype=self.dtype,
            compressors=[zarr.codecs.Crc32cCodec()],
            attributes=attributes,
            # Folders for the rows and columns of each image would take as long as counting it.
            chunk_key_encoding={"name": "default", "separator": "."},
        )
        return bytes(files["zarr.json"].to_bytes())

    def check_sizes(self) -> None:
        """Raise ValueError unless each image of the array has a file of its size."""
        found = self.find()
        if missing := self.shape[0] - len(found):
            example = next(index for index in range(self.shape[0]) if index not in found)
            self._refuse(missing, example, "are missing or incomplete")

    def check_checksums(self, progress: Callable[[float], object]) -> None:
        """Raise ValueError unless each image of the array matches its checksum.

        `progress` is called repeatedly with the completed fraction, from 0 to 1.
        """
        self.check_sizes()
        number, damaged = self.shape[0], []
        for index, intact in enumerate(self.are_intact(range(number))):
            if not intact:
                damaged.append(index)
            progress((index + 1) / number)
        if damaged:
            self._refuse(len(damaged), damaged[0], "do not match their checksums")

    def _refuse(self, number: int, example: int, reason: str) -> NoReturn:
        """Raise ValueError because there is a reason to refuse a number of images."""
        raise ValueError(
            f"{self.folder}: {number} of its {self.shape[0]} images {reason}, such as "
            f"{self.path(example).name}; restore it from a copy, or delete it to make it again"
        )

    def are_intact(self, indices: Iterable[int]) -> Iterator[bool]:
        """Yield whether each of some images matches its checksum."""
        return map_in_threads(self._is_intact, map(self.path, indices))

    def flush(self) -> None:
        """Wait until all images are on the disk."""
        for _ in map_in_threads(flush_to_disk, map(self.path, range(self.shape[0]))):
            pass
        flush_to_disk(self.folder)

    def _is_intact(self, path: Path) -> bool:
        import google_crc32c

        checksum = google_crc32c.Checksum()
        with path.open("rb") as file:
            # The memory does not depend on a size that a damaged file states.
            for start in range(0, self.nbytes, _BLOCK_BYTES):
                checksum.update(file.read(min(_BLOCK_BYTES, self.nbytes - start)))
            stored = file.read(_CHECKSUM_BYTES)
        return int.from_bytes(stored, "little") == int.from_bytes(checksum.digest(), "big")
