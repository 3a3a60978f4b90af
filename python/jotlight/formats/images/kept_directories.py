"""TIFF files of many pages, whose directories are read once rather than at each reading."""

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jotlight.formats.files.remote_files import remote_file
from jotlight.formats.images.tiff_directories import open_checked_tiff

_MANY = 16
"""Number of pages from which directories are kept. A folder may hold many files of few pages."""


class TiffSource:
    """A TIFF file that is opened for each reading, and closed after it.

    Checking and reading the directories takes a time in proportion to the number of pages, so each
    thread does this once. The caller must make sure that the file does not change.

    Parameters
    ----------
    path : Path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kept = threading.local()

    @contextlib.contextmanager
    def open(self) -> Iterator[Any]:
        """Yield the ``tifffile.TiffFile``, whose ``series`` may already be known.

        Raises
        ------
        ValueError
            As :func:`jotlight.formats.images.tiff_directories.open_checked_tiff`.
        """
        tiff = getattr(self._kept, "tiff", None)
        if tiff is None:
            tiff = open_checked_tiff(self._path)
        else:
            tiff.filehandle.open()
        try:
            yield tiff
            is_local = remote_file(self._path) is None
            if is_local and len(tiff.series[0].pages) >= _MANY:
                self._kept.tiff = tiff
        finally:
            tiff.filehandle.close()
