"""Raw frames in files without a header: only their size tells how many there are."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.frames import Frames, joined

Decode = Callable[[npt.NDArray[np.uint8]], npt.NDArray[np.uint8]]

_MOST_FILES = 1_000_000


def natural(path: Path) -> tuple[tuple[int, int, str], ...]:
    """A key that sorts `RAW2.bin` before `RAW10.bin`, in each folder of the path."""
    return tuple(
        (1, 0, word) if index % 2 == 0 else (0, int(word), "")
        for part in path.parts
        for index, word in enumerate(re.split(r"([0-9]+)", part))
        if word
    )


def files_of(path: Path, ending: str, name: str) -> list[Path]:
    """The file itself, or those below a folder that end so, in natural order."""
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise FileNotFoundError(f"there is no file or folder {path}")
    found = []
    for file in path.rglob("*"):
        if file.suffix.lower() == ending and file.is_file() and not file.name.startswith("."):
            found.append(file)
        if len(found) > _MOST_FILES:
            raise ValueError(f"{path}: expected at most {_MOST_FILES} files, got more")
    if not found:
        raise ValueError(f"{path}: expected a folder with {name} files ({ending}), got none in it")
    return sorted(found, key=lambda file: natural(file.relative_to(path)))


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
    frames = joined(parts)
    if len(frames) == 0:
        many = f"any of {len(files)} files" if len(files) > 1 else "it"
        raise ValueError(
            f"{files[0]}: expected frames of {shape[0] * shape[1]} bytes each, got none whole in "
            f"{many}"
        )
    return frames


def _frames_of(file: Path, shape: tuple[int, int], decode: Decode, trailer: bytes) -> Frames:
    size = shape[0] * shape[1]
    there = file.stat().st_size
    if trailer and there % size == len(trailer):
        with file.open("rb") as handle:
            handle.seek(there - len(trailer))
            there -= len(trailer) if handle.read() == trailer else 0
    if left := there % size:
        number = f"{there // size} whole frame{'' if there // size == 1 else 's'}"
        warn(f"{file}: {number} of {size} bytes; {left} bytes are left over and not used")

    def read(start: int, stop: int) -> npt.NDArray[np.uint8]:
        # Not mapped into memory: a file that becomes shorter would end the program.
        raw = np.fromfile(file, np.uint8, (stop - start) * size, offset=start * size)
        if len(raw) != (stop - start) * size:
            raise OSError(f"{file} has become shorter since it was opened")
        return decode(raw.reshape(stop - start, size))

    return Frames((there // size, *shape), read)
