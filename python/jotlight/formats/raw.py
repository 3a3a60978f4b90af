"""Raw frames in files without a header: only their size tells how many there are."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.compressed import Stream, open_gzip, said
from jotlight.formats.magic import read_signature
from jotlight.sensing.frames import Frames, concatenate

Decode = Callable[[npt.NDArray[np.uint8]], npt.NDArray[np.uint8]]

ENDINGS = (".bin", ".bin.gz")
"""How the names of files with raw frames end."""

_MOST_FILES = 1_000_000
_AT_ONCE = 1 << 20


def natural_sort_key(path: Path) -> tuple[tuple[int, int, str], ...]:
    """A key that sorts `RAW2.bin` before `RAW10.bin`, in each folder of the path."""
    return tuple(
        (1, 0, word) if index % 2 == 0 else (0, int(word), "")
        for part in path.parts
        for index, word in enumerate(re.split(r"([0-9]+)", part))
        if word
    )


def list_files(path: Path, endings: tuple[str, ...], name: str) -> list[Path]:
    """The file itself, or those below a folder that end so, in natural order."""
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise FileNotFoundError(f"there is no file or folder {path}")
    found = []
    for file in path.rglob("*"):
        if file.name.lower().endswith(endings) and file.is_file() and file.name[0] != ".":
            found.append(file)
        if len(found) > _MOST_FILES:
            raise ValueError(f"{path}: expected at most {_MOST_FILES} files, got more")
    if not found:
        raise ValueError(
            f"{path}: expected a folder with {name} files ({endings[0]}), got none in it"
        )
    return sorted(found, key=lambda file: natural_sort_key(file.relative_to(path)))


class RawFile:
    """The bytes of a file that holds nothing but frames; it may be compressed by gzip.

    Parameters
    ----------
    path : path
    trailer : bytes
        What may stand at the end of a file and is no frame.

    Raises
    ------
    ValueError
        When its first bytes tell that it is something else.
    """

    def __init__(self, path: Path, trailer: bytes = b"") -> None:
        self.path = path
        told = read_signature(path)
        self._stream: Stream | None = None
        if told == "npy.gz" and path.suffix.lower() == ".gz":
            self._stream = Stream(lambda: open_gzip(path))
            size, end = _size_and_end(path, len(trailer))
        elif told is not None:
            raise ValueError(
                f"{path}: expected raw frames, and its first bytes are those of {told}"
            )
        else:
            size = path.stat().st_size
            with path.open("rb") as file:
                file.seek(max(0, size - len(trailer)))
                end = file.read()
        self.size = size - len(trailer) if trailer and end == trailer else size
        """How many bytes there are, without the trailer."""

    def read(self, place: int, size: int) -> npt.NDArray[np.uint8]:
        """Bytes from a place on; OSError where they are not there any more."""
        if self._stream is None:
            # Not mapped into memory: a file that becomes shorter would end the program.
            data = np.fromfile(self.path, np.uint8, size, offset=place)
        else:
            with said(str(self.path)):
                data = np.frombuffer(self._stream.read(place, size), np.uint8)
            if place + size == self.size:
                # A folder may have more files than can be open at once.
                self._stream.close()
        if len(data) != size:
            raise OSError(f"{self.path} has become shorter since it was opened")
        return data


def _size_and_end(path: Path, number: int) -> tuple[int, bytes]:
    """How many bytes a compressed file becomes, and the last of them."""
    size, end = 0, b""
    with said(str(path)), open_gzip(path) as file:
        while piece := file.read(_AT_ONCE):
            size += len(piece)
            end = (end + piece)[-number:] if number else b""
    return size, end


def raw_frames(
    files: Sequence[Path], shape: tuple[int, int], decode: Decode, trailer: bytes = b""
) -> npt.NDArray[np.uint8] | Frames:
    """Frames that stand one after the other in files.

    Parameters
    ----------
    files : sequence of paths
    shape : tuple of int
        Of a decoded frame, packed; it has as many bytes as in the file.
    decode : callable
        Turns raw bytes (n, bytes of a frame) into packed frames (n, *shape).
    trailer : bytes
        What may stand at the end of a file and is no frame.
    """
    parts = [_frames_of(file, shape, decode, trailer) for file in files]
    frames = concatenate(parts)
    if len(frames) == 0:
        many = f"any of {len(files)} files" if len(files) > 1 else "it"
        raise ValueError(
            f"{files[0]}: expected frames of {shape[0] * shape[1]} bytes each, got none whole in "
            f"{many}"
        )
    return frames


def _frames_of(path: Path, shape: tuple[int, int], decode: Decode, trailer: bytes) -> Frames:
    size = shape[0] * shape[1]
    file = RawFile(path, trailer)
    number, left = divmod(file.size, size)
    if left:
        whole = f"{number} whole frame{'' if number == 1 else 's'}"
        warn(f"{path}: {whole} of {size} bytes; {left} bytes are left over and not used")

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        raw = file.read(start * size, (stop - start) * size)
        return decode(raw.reshape(stop - start, size))

    return Frames((number, *shape), read)
