"""Raw frames: files without a header, whose size alone determines the number of frames."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy.typing as npt

from jotlight.array_types import Packed
from jotlight.errors import counted, warn
from jotlight.files import atomic_folder, atomic_write
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.file_sequence import join_files
from jotlight.formats.files.magic import file_type
from jotlight.formats.format import FrameLayout
from jotlight.formats.npy.compressed import Stream, measure_gzip, naming_file, open_gzip
from jotlight.output_files import open_output
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames, read_in_chunks

EXTENSIONS = (".bin", ".bin.gz")
"""Extensions of files with raw frames."""

OTHER_EXTENSIONS = (*EXTENSIONS, ".raw", ".dat")
"""Extensions that files with raw frames have outside of folders. Any other one works, too."""

_CHUNK_BYTES = 1 << 20
"""Number of bytes that are written at once."""


class RawFile:
    """The bytes of a file that contains only frames and may be compressed by gzip.

    Parameters
    ----------
    path : path
    trailer : bytes
        Bytes that may follow the last frame.

    Raises
    ------
    ValueError
        When the first bytes identify another file type.
    """

    def __init__(self, path: Path, trailer: bytes = b"") -> None:
        self.path = path
        kind = file_type(path)
        self._file = FileReader(path)
        self._stream: Stream | None = None
        if kind == "gzip" and path.suffix.lower() == ".gz":
            with naming_file(str(path)):
                size, end = measure_gzip(path, len(trailer))
            self._stream = Stream(
                str(path), lambda: open_gzip(path), size, self._file.check_unchanged
            )
        elif kind is not None:
            raise ValueError(
                f"{path}: expected raw frames, but its first bytes are those of {kind}"
            )
        else:
            size = self._file.size
            end_bytes = min(size, len(trailer))
            end = self._file.read(size - end_bytes, end_bytes).tobytes()
        self.has_trailer = trailer != b"" and end == trailer
        self.size = size - len(trailer) if self.has_trailer else size
        """Number of bytes after decompression, without the trailer."""

    def read(self, position: int, size: int) -> Packed:
        """Return `size` bytes from `position` on. Raise OSError if the file has changed."""
        if self._stream is None:
            return self._file.read(position, size)
        with naming_file(str(self.path)):
            data = self._stream.read(position, size)
            if position + size == self.size:
                # A folder may have more files than the system lets a process open at once.
                self._stream.finish()
            return data


def read_raw(
    path: Path,
    files: Sequence[Path],
    layout: FrameLayout,
    trailer: bytes = b"",
    numbers: Sequence[int] | None = None,
) -> npt.NDArray[Any] | Frames:
    """Return the frames of several files as one stack.

    Parameters
    ----------
    path : path
        The file, or the folder of the files.
    files : sequence of paths
    layout : FrameLayout
        The layout of their frames.
    trailer : bytes
        Bytes that may follow the last frame of a file.
    numbers : sequence of int, optional
        The numbers of the files, if their names count them.

    Returns
    -------
    Frames or ndarray, shape (T, H, ceil(W / 8)), or (T, H, W) for numbers

    Raises
    ------
    ValueError
        When no file has a complete frame.
    """
    raw = [RawFile(file, trailer) for file in files]
    parts = [_frames_of(file, layout) for file in raw]
    if not any(map(len, parts)):
        header = f" after a header of {layout.file_header} bytes" if layout.file_header else ""
        where = f"any of {len(files)} files" if len(files) > 1 else f"its {raw[0].size} bytes"
        raise ValueError(
            f"{files[0]}: expected frames of {layout.frame_bytes} bytes each{header}, got no "
            f"complete one in {where}"
        )
    for file, part in zip(raw, parts, strict=True):
        _warn_about_rest(file, layout, len(part))
    finished = [file.has_trailer for file in raw]
    return join_files(path, files, parts, numbers=numbers, finished=finished)


def _warn_about_rest(file: RawFile, layout: FrameLayout, number: int) -> None:
    """Warn about bytes after the last complete frame, or about a part of a header."""
    left = file.size - layout.file_header - number * layout.frame_bytes
    if left < 0:
        left = file.size
    if left:
        complete = counted(number, "complete frame")
        warn(
            f"{file.path}: {complete} of {layout.frame_bytes} bytes; {left} bytes are left over "
            "and not used"
        )


def _frames_of(file: RawFile, layout: FrameLayout) -> Frames:
    frame_bytes = layout.frame_bytes
    number = max(0, file.size - layout.file_header) // frame_bytes

    def read(start: int, stop: int) -> npt.NDArray[Any]:
        position = layout.file_header + start * frame_bytes
        raw = file.read(position, (stop - start) * frame_bytes)
        return layout.decode(raw.reshape(stop - start, frame_bytes))

    return Frames((number, *layout.shape), read, layout.dtype)


def check_frame_size(bits: Bits, shape: tuple[int, int], name: str) -> None:
    """Raise ValueError unless frames have the size, in jots, that a format requires."""
    if bits.shape[1:] != shape:
        size = " x ".join(map(str, bits.shape[1:]))
        raise ValueError(f"{name}: expected frames of {shape[0]} x {shape[1]} jots, got {size}")


def write_raw(
    bits: Bits,
    path: Path,
    encode: Callable[[Packed], Packed],
    *,
    frames_per_file: int,
    file_name: Callable[[int], str],
    trailer: bytes = b"",
) -> None:
    """Write raw frames to one file, or for a path without extension to a new folder of files.

    Parameters
    ----------
    bits : Bits
    path : path
    encode : callable
        A function that returns the raw bytes of packed frames (n, H, W / 8).
    frames_per_file : int
        Maximum number of frames in each file of a folder.
    file_name : callable
        A function that returns the path, relative to the folder, of file number 0, 1, and so on.
    trailer : bytes
        Bytes that follow the last frame of each file.
    """
    if path.suffix:
        with atomic_write(path) as temporary:
            _write_raw_file(temporary, bits.packed, encode, trailer)
        return
    with atomic_folder(path) as folder:
        for index, start in enumerate(range(0, len(bits), frames_per_file)):
            file = folder / file_name(index)
            file.parent.mkdir(parents=True, exist_ok=True)
            part = bits.packed[start : start + frames_per_file]
            _write_raw_file(file, part, encode, trailer)


def _write_raw_file(
    path: Path, frames: Packed | Frames, encode: Callable[[Packed], Packed], trailer: bytes
) -> None:
    with open_output(path) as file:
        for _, part in read_in_chunks(frames, _CHUNK_BYTES):
            file.write(encode(part).tobytes())
        file.write(trailer)
