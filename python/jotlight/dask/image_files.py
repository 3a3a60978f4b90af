"""Files of the images of a video. Each ends in its CRC-32C, as the chunks of zarr arrays may."""

import errno
import itertools
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

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
    with path.open("wb", buffering=0) as file:
        for content in (data, google_crc32c.value(data).to_bytes(4, "little")):
            if file.write(content) != len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        if hasattr(os, "posix_fadvise"):
            # Linux then begins to write the image, and later waits less for the disk.
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def is_intact(path: Path, size: int) -> bool:
    """Return whether the file of an image of `size` bytes is complete.

    A power failure may have damaged it.
    """
    import google_crc32c

    if not path.is_file() or path.stat().st_size != size + 4:
        return False
    content = np.frombuffer(path.read_bytes(), np.uint8)  # whose parts are not copies
    value: int = google_crc32c.value(content[:size])
    return value.to_bytes(4, "little") == content[size:].tobytes()


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
