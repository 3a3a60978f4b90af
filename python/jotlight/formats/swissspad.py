"""SwissSPAD2: raw bits in `.bin` files of 8 MiB, the least significant bit first.

A file of the half array has 512 frames of 256 x 512, row by row. A file of the full array has
256 frames of 512 x 512. Its two halves alternate: 128 bits of a row of the top half, 128 bits of
the mirrored row of the bottom half, and so on. The bottom half is read out upside down.
"""

import functools
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Packed
from jotlight.formats.files.file_lists import list_files
from jotlight.formats.files.file_sequence import describe_files
from jotlight.formats.format import Format, FrameLayout, Writer
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.raw import EXTENSIONS, OTHER_EXTENSIONS, check_frame_size, read_raw, write_raw
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.parameters.provenance import Provenance

_WIDTH = 512
_HALF_HEIGHT = 256
_ROW_BYTES = _WIDTH // 8
_TURN_BYTES = 128 // 8
"""Number of bytes of one half that are followed by bytes of the other half."""

_TURNS = _HALF_HEIGHT, _ROW_BYTES // _TURN_BYTES, 2, _TURN_BYTES
"""Shape of a frame of the full array: rows, turns, halves, and bytes."""

_FRAMES_PER_HALF_FILE = 512
_FRAMES_PER_FULL_FILE = 256


def _decode_half(raw: Packed) -> Packed:
    """Return packed frames (n, 256, 64) of the half array; the function is its own inverse."""
    packed = np.array(raw, order="C").reshape(len(raw), _HALF_HEIGHT, _ROW_BYTES)
    engine.reverse_bytes(packed.reshape(-1), None)
    return packed


def _decode_full(raw: Packed) -> Packed:
    """Return packed frames (n, 512, 64) of the full array."""
    packed = np.empty((len(raw), 2 * _HALF_HEIGHT, _ROW_BYTES), np.uint8)
    halves, turns = _halves(packed), raw.reshape(len(raw), *_TURNS)
    halves[:, 0] = turns[:, :, :, 0]
    halves[:, 1, ::-1] = turns[:, :, :, 1]
    engine.reverse_bytes(packed.reshape(-1), None)
    return packed


def _encode_full(packed: Packed) -> Packed:
    """Return the raw bytes of packed frames: the inverse of :func:`_decode_full`."""
    turns = np.empty((len(packed), *_TURNS), np.uint8)
    halves = _halves(packed)
    turns[:, :, :, 0] = halves[:, 0]
    turns[:, :, :, 1] = halves[:, 1, ::-1]
    engine.reverse_bytes(turns.reshape(-1), None)
    return turns.reshape(len(packed), -1)


def _halves(packed: Packed) -> Packed:
    """Return a view of packed frames, divided into halves and turns."""
    return packed.reshape(len(packed), 2, _HALF_HEIGHT, _TURNS[1], _TURNS[3])


def _layout(height: int, decode: Callable[[Packed], Packed]) -> FrameLayout:
    """Return the layout of frames with a height."""
    return FrameLayout((height, _ROW_BYTES), _WIDTH, height * _ROW_BYTES, decode)


_HALF, _FULL = _layout(_HALF_HEIGHT, _decode_half), _layout(2 * _HALF_HEIGHT, _decode_full)


def open_swissspad(path: Path, options: ReadingOptions, *, full: bool = False) -> Bits:
    """Return the bits of a `.bin` file, or of a folder sorted by the numbers in the file names."""
    numbered = _number(path, list_files(path, EXTENSIONS, "SwissSPAD2"))
    files = list(numbered.values())
    layout = _FULL if full else _HALF
    frames = read_raw(path, files, layout, numbers=list(numbered))
    notes = [f"frames of {layout.shape[0]} x {_WIDTH}, the least significant bit first"]
    if full:
        notes.append("the two halves alternate every 128 bits, the bottom half upside down")
    if len(files) > 1:
        notes.append(describe_files(path, files, "the order of the numbers in their names"))
    name = SWISSSPAD2_FULL.name if full else SWISSSPAD2.name
    return Bits(frames, provenance=Provenance(name, path.name, tuple(notes)))


def _number(path: Path, files: list[Path]) -> dict[int, Path]:
    """Return files by the last whole number in their names, in its order, ignoring folders."""
    if len(files) == 1:
        return {0: files[0]}
    numbered: dict[int, Path] = {}
    for file in files:
        digits = re.findall(r"[0-9]+", file.stem)
        number = int(digits[-1]) if digits else -1
        if number in numbered or not digits:
            raise ValueError(
                f"{path}: expected a different number in each file name, as in filename12.bin, "
                f"got {numbered.get(number, file)} and {file}; open one capture at a time"
            )
        numbered[number] = file
    return dict(sorted(numbered.items()))


def _file_name(index: int) -> str:
    """Return the path that the camera's software writes the file with an index to."""
    return f"{index // 2048}/{index // 64}/filename{index}.bin"


def _write_half(bits: Bits, path: Path) -> None:
    check_frame_size(bits, (_HALF_HEIGHT, _WIDTH), SWISSSPAD2.name)
    frames_per_file = _FRAMES_PER_HALF_FILE
    write_raw(bits, path, _decode_half, frames_per_file=frames_per_file, file_name=_file_name)


def _write_full(bits: Bits, path: Path) -> None:
    check_frame_size(bits, (2 * _HALF_HEIGHT, _WIDTH), SWISSSPAD2_FULL.name)
    frames_per_file = _FRAMES_PER_FULL_FILE
    write_raw(bits, path, _encode_full, frames_per_file=frames_per_file, file_name=_file_name)


SWISSSPAD2 = Format(
    "swissspad2",
    "SwissSPAD2, the half array of 256 x 512",
    open=open_swissspad,
    other_extensions=OTHER_EXTENSIONS,
    is_raw=True,
    layout=_HALF,
    fixed_layout=True,
    writer=Writer(bits=_write_half, extensions=(".bin",), plain=True, folder=True),
)

SWISSSPAD2_FULL = Format(
    "swissspad2-full",
    "SwissSPAD2, the full array of 512 x 512",
    open=functools.partial(open_swissspad, full=True),
    other_extensions=OTHER_EXTENSIONS,
    is_raw=True,
    layout=_FULL,
    fixed_layout=True,
    writer=Writer(bits=_write_full, extensions=(".bin",), plain=True, folder=True),
)
