"""SwissSPAD2: raw bits in `.bin` files of 8 MiB, the least significant bit first, no header.

The half array has 512 frames of 256 x 512 in a file, row by row. The full array has 256 frames
of 512 x 512, which the two halves write by turns: 128 bits of a row of the top half, 128 of the
mirrored row of the bottom half, and so on; the bottom half is read upside down.
"""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.raw import ENDINGS, list_files, raw_frames
from jotlight.sensing.bits import Bits
from jotlight.sensing.provenance import Provenance

Packed = npt.NDArray[np.uint8]

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Each byte with its bits in reverse."""

_ROW = 512 // 8
_TURN = 128 // 8
"""Bytes that one half writes before it is the other's turn."""

FRAMES_PER_FILE = {"swissspad2": 512, "swissspad2-full": 256}


def _reversed(raw: Packed) -> Packed:
    # Some three times as fast as looking up in an array, which makes indices of 64 bits first.
    return np.frombuffer(raw.tobytes().translate(_REVERSED), np.uint8)


def decode_half_array(raw: Packed) -> Packed:
    """Packed frames (n, 256, 64) of the half array from its bytes; it is its own inverse."""
    return _reversed(raw).reshape(len(raw), 256, _ROW)


def decode_full_array(raw: Packed) -> Packed:
    """Packed frames (n, 512, 64) of the full array from its bytes."""
    turns = _reversed(raw).reshape(len(raw), 256, _ROW // _TURN, 2, _TURN)
    top = turns[:, :, :, 0].reshape(len(raw), 256, _ROW)
    bottom = turns[:, ::-1, :, 1].reshape(len(raw), 256, _ROW)
    return np.concatenate([top, bottom], axis=1)


def encode_full_array(frames: Packed) -> Packed:
    """Undo :func:`decode_full_array`."""
    turns = np.empty((len(frames), 256, _ROW // _TURN, 2, _TURN), np.uint8)
    halves = frames.reshape(len(frames), 2, 256, _ROW // _TURN, _TURN)
    turns[:, :, :, 0] = halves[:, 0]
    turns[:, :, :, 1] = halves[:, 1, ::-1]
    return _reversed(turns).reshape(len(frames), -1)


def open_swissspad(path: Path, *, full: bool) -> Bits:
    """Open a `.bin` file or a folder of them, sorted by the number in their names."""
    files = _by_number(path, list_files(path, ENDINGS, "SwissSPAD2"))
    height = 512 if full else 256
    frames = raw_frames(files, (height, _ROW), decode_full_array if full else decode_half_array)
    notes = [f"frames of {height} x 512, the least significant bit first"]
    if full:
        notes.append("the halves by turns of 128 bits, the bottom half upside down")
    if len(files) > 1:
        notes.append(f"{len(files)} files in the order of the numbers in their names")
    name = "swissspad2-full" if full else "swissspad2"
    return Bits(frames, provenance=Provenance(name, path.name, tuple(notes)))


def _by_number(path: Path, files: list[Path]) -> list[Path]:
    """Sort by the last whole number in the names; the folders are only there to keep them small."""
    if len(files) == 1:
        return files
    numbered: dict[int, Path] = {}
    for file in files:
        digits = re.findall(r"[0-9]+", file.stem)
        number = int(digits[-1]) if digits else -1
        if number in numbered or not digits:
            raise ValueError(
                f"{path}: expected files with a number each in their names, as in filename12.bin, "
                f"got {numbered.get(number, file)} and {file}; open one capture at a time"
            )
        numbered[number] = file
    first, last = min(numbered), max(numbered)
    if missing := last - first + 1 - len(numbered):
        warn(f"{path}: {missing} of the files {first} to {last} are missing; the others are used")
    return [numbered[number] for number in sorted(numbered)]


def raw_bytes(bits: Bits, name: str) -> tuple[int, Callable[[Packed], Packed]]:
    """How many frames go into a file, and what turns packed frames into its bytes."""
    full = name == "swissspad2-full"
    expected = (512 if full else 256, 512)
    if bits.shape[1:] != expected:
        size = " x ".join(map(str, bits.shape[1:]))
        raise ValueError(f"{name}: expected frames of {expected[0]} x 512 jots, got {size}")
    return FRAMES_PER_FILE[name], encode_full_array if full else decode_half_array
