"""A folder in which files with frames appear."""

import os
import re
import time
from collections import deque
from collections.abc import Container
from pathlib import Path

from jotlight.errors import hide_warnings
from jotlight.formats.files.file_lists import NUMBER, file_extension
from jotlight.sensing.bits.bits import Bits
from jotlight.view.live import growing_file
from jotlight.view.live.capture import LiveCapture
from jotlight.view.live.growing_file import STEADY_SECONDS, GrowingFile, Open, as_bits
from jotlight.view.live.tails import POLL_SECONDS

_MAX_TRIED = 8
"""Number of files of which one must be readable when a folder is opened."""

_MAX_GAPS = 100
"""Number of the newest gaps whose files are recognized when they come late."""

Key = tuple[int, str]
"""The last number in the name of a file, or -1, and the name."""


def list_files(folder: Path, seen: Container[str] = ()) -> list[tuple[Key, Path]]:
    """Return the files of a folder that are not `seen`, sorted by the last number in their names.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("f10.png", "f9.png", ".hidden", "f8.png.part"):
    ...     folder.joinpath(name).touch()
    >>> [path.name for _, path in list_files(folder)]
    ['f9.png', 'f10.png']
    """
    found = []
    with os.scandir(folder) as entries:
        for entry in entries:
            # Programs write a file under such a name, and rename it when it is complete.
            is_part = entry.name.startswith(".") or entry.name.endswith((".part", ".tmp", ".json"))
            if entry.name in seen or is_part or not entry.is_file(follow_symlinks=False):
                continue
            path = folder / entry.name
            found.append((_key(path), path))
    return sorted(found)


def _key(path: Path) -> Key:
    is_counted = file_extension(path) == NUMBER
    digits = re.findall(r"[0-9]+", path.name if is_counted else path.stem)
    return int(digits[-1][:18]) if digits else -1, path.name


def open_first(folder: Path, open_file: Open) -> tuple[Path, Bits, set[str]]:
    """Return one of the newest files of a folder, its bits, and the names up to it. Wait for one.

    Raises
    ------
    OSError, ValueError
        When files have been there for a while, and none of the newest holds bits.
    """
    start = None
    while True:
        files = list_files(folder)
        newest = [path for _, path in files[: -_MAX_TRIED - 1 : -1]]
        # The newest file may not be complete, so the one before it comes first.
        for path in [*newest[1:2], *newest[:1], *newest[2:]]:
            try:
                with hide_warnings("left over"):  # the rest of the last frame may follow
                    bits = as_bits(open_file(path), path)
                return path, bits, {each.name for key, each in files if key <= _key(path)}
            except (OSError, ValueError) as error:
                start = time.monotonic() if start is None else start
                if time.monotonic() - start > growing_file.MAX_FAILURES:
                    raise error
        time.sleep(POLL_SECONDS)


class FolderReader:
    """The frames of the files of a folder, as they appear.

    A file may grow until the next one appears. Files with another ending than the first one are
    ignored. A gap in the numbers of the names counts as dropped frames, and so does a file that
    cannot be read: as many frames as in the file before it. A file that appears later with a number
    from a gap stays dropped. Any other new file with a lower number begins a new sequence.

    Parameters
    ----------
    folder : Path
        The folder.
    open_file : callable
        A function that opens a file.
    first : Path
        The file with which the capture begins.
    seen : set of str
        The names of this file and of those before it.
    is_raw : bool
        Whether the files have no header.
    """

    def __init__(
        self, folder: Path, open_file: Open, first: Path, seen: set[str], *, is_raw: bool
    ) -> None:
        self._folder, self._open, self._is_raw = folder, open_file, is_raw
        self._extension = file_extension(first)
        self._last, self._seen = _key(first), seen
        self._listed: dict[str, float] = {}
        """When each file that was not yet seen was first listed."""
        self._file: GrowingFile | None = GrowingFile(first, open_file, is_raw=is_raw)
        self._frames = 0
        """Number of frames in the file before."""
        self._unit: int | None = None
        """Difference of the numbers of two files: 1, or their frames if the names count frames."""
        self._gaps: deque[range] = deque(maxlen=_MAX_GAPS)

    def __call__(self, capture: LiveCapture) -> None:
        """Add frames until the capture is closed."""
        while not capture.stop.is_set():
            new = self._list_new(capture)
            for waiting in range(len(new), 0, -1):
                self._finish(capture)
                if capture.stop.is_set():
                    return
                self._begin(capture, *new[-waiting], waiting)
            if not new:
                if self._file is not None:
                    self._file.add_new(capture)
                capture.stop.wait(POLL_SECONDS)

    def _list_new(self, capture: LiveCapture) -> list[tuple[Key, Path]]:
        """Return the new files before the first gap in their numbers.

        A listing may lack files that appear while it is made. So a gap counts only if it is still
        there in a later listing.
        """
        now = time.monotonic()
        new = []
        for key, path in list_files(self._folder, self._seen):
            if file_extension(path) == self._extension:
                new.append((key, path))
            else:
                self._seen.add(path.name)
                capture.remark = f"{path.name}: ignored, because it is no {self._extension}"
        self._listed = {path.name: self._listed.get(path.name, now) for _, path in new}
        last = self._last[0]
        for index, ((number, name), _) in enumerate(new):
            if number - last > (self._unit or 1) and now - self._listed[name] < STEADY_SECONDS:
                return new[:index]
            last = number
        return new

    def _finish(self, capture: LiveCapture) -> None:
        """Add the last frames of the present file, and count those that cannot be read."""
        if self._file is None:
            return
        while not self._file.add_new(capture):
            if capture.stop.is_set():
                return
        file, self._file = self._file, None
        if file.error is None:
            self._frames = file.frames or self._frames  # 0 if it is gone
            for text in file.warnings:
                capture.remark = text
        else:
            capture.remark = f"skipped, and counted as dropped: {file.error}"
            capture.drop(max(0, self._frames - file.frames))

    def _begin(self, capture: LiveCapture, key: Key, path: Path, waiting: int) -> None:
        """Count the frames that are missing before a file, and make it the present one.

        If more files are waiting than fit into memory, its frames are dropped.
        """
        self._seen.add(path.name)
        number, before = key[0], self._last[0]
        if any(number in gap for gap in self._gaps):
            capture.remark = f"{path.name}: came late, so its frames stay dropped"
            return
        self._last = key if number > -1 else self._last
        if self._unit is None and self._frames > 0 and -1 < before < number:
            self._unit = self._frames if number - before == self._frames else 1
        missing = (number - before - 1) // (self._unit or 1)
        if before > -1 and missing > 0:
            self._gaps.append(range(before + 1, number))
            capture.drop(missing * self._frames)
        elif -1 < number < before:
            self._gaps.clear()
            capture.remark = f"{path.name}: its number is lower, so a new sequence begins"
        if waiting > max(1, capture.ring.capacity // max(1, self._frames)):
            capture.drop(self._frames)
        else:
            self._file = GrowingFile(path, self._open, is_raw=self._is_raw)
