"""SPAD512S: frames of 512 x 512 jots as the camera reads them out, most significant bit first.

The camera's own software shows frames rotated by 90 degrees counterclockwise, and so does
jotlight. A dense file has up to 1000 frames of 32768 bytes. A sparse file lists the positions of
the ones as little-endian uint32, and the number 262144 after each frame. A file that was sent over
the network ends with the four letters `DONE`.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Packed
from jotlight.errors import counted, warn
from jotlight.formats.files.file_lists import list_files, natural_sort_key
from jotlight.formats.files.file_reader import FileReader
from jotlight.formats.files.file_sequence import describe_files, join_files
from jotlight.formats.files.magic import file_type
from jotlight.formats.files.safe_paths import MAX_SEARCHED, list_below
from jotlight.formats.format import Format, FrameLayout, Writer
from jotlight.formats.frames.orientation import rotate_packed, transpose_packed
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.raw import (
    EXTENSIONS,
    OTHER_EXTENSIONS,
    RawFile,
    check_frame_size,
    read_raw,
    write_raw,
)
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.parameters.provenance import Provenance

FRAMES_PER_FILE = 1000
"""Maximum number of frames in each file that jotlight writes, as the camera's software does."""

_SIDE = 512
_TRAILER = b"DONE"

_END_OF_FRAME = _SIDE * _SIDE
"""Number that follows the positions of each frame in a sparse file."""

_INDEX_STEP = 64
"""Number of frames for each stored offset. It limits the memory for a long file."""

_WORDS_AT_ONCE = 1 << 20
"""Number of words of a sparse file that are read at once."""

_ROTATED = "rotated by 90 degrees counterclockwise, as its own software shows it"


def _decode(raw: Packed) -> Packed:
    """Return packed frames (n, 512, 64) as the camera's software shows them."""
    return rotate_packed(raw.reshape(len(raw), _SIDE, _SIDE // 8), _SIDE)


_LAYOUT = FrameLayout((_SIDE, _SIDE // 8), _SIDE, _SIDE * _SIDE // 8, _decode)
"""The layout of a dense file."""


def _encode_dense(packed: Packed) -> Packed:
    """Return the raw bytes of packed frames: the inverse of :func:`_decode`."""
    return transpose_packed(packed[:, ::-1], _SIDE)


def _encode_sparse(packed: Packed) -> Packed:
    """Return the positions of the ones, and the end of each frame, as bytes."""
    flat = np.unpackbits(_encode_dense(packed).reshape(len(packed), -1), axis=1)
    # An additional 1 after the last jot of each frame has the position that marks its end.
    with_end = np.concatenate([flat, np.ones((len(packed), 1), np.uint8)], axis=1)
    return np.nonzero(with_end)[1].astype("<u4").view(np.uint8)


def _has_trailer(path: Path) -> bool:
    size = path.stat().st_size
    if size <= len(_TRAILER):
        return False
    return FileReader(path).read(size - len(_TRAILER), len(_TRAILER)).tobytes() == _TRAILER


def _looks_sparse(path: Path) -> bool:
    """Return whether a file with the trailer is sparse, judged from its first words."""
    file = FileReader(path)
    words = file.read(0, 4 * min(_END_OF_FRAME + 1, file.size // 4 - 1)).view("<u4")
    ends = int((words == _END_OF_FRAME).sum())
    # In dark frames of a dense file most words are 0, but in a sparse frame 0 occurs at most once.
    return ends > 0 and words.max() <= _END_OF_FRAME and int((words == 0).sum()) <= ends + 1


def _matches(path: Path, *, sparse: bool) -> bool:
    """Return whether the file, or a file in the folder, has the trailer and this layout."""
    if path.is_dir():
        files = sorted(list_below(path, (".bin",), max_others=MAX_SEARCHED), key=natural_sort_key)
    else:
        files = [path] if file_type(path) is None else []
    finished = next(filter(_has_trailer, files), None)
    return finished is not None and _looks_sparse(finished) == sparse


def open_spad512s(path: Path, options: ReadingOptions, *, sparse: bool = False) -> Bits:
    """Return the bits of a file, or of a folder in natural order."""
    files = list_files(path, EXTENSIONS, "SPAD512S")
    if sparse:
        frames = _read_all_sparse(path, files)
        notes = [f"positions of the ones as uint32, little endian, row by row; {_ROTATED}"]
    else:
        frames = read_raw(path, files, _LAYOUT, _TRAILER)
        notes = [f"frames of {_SIDE} x {_SIDE}, the most significant bit first; {_ROTATED}"]
    if len(files) > 1:
        notes.append(describe_files(path, files))
    name = SPAD512S_SPARSE.name if sparse else SPAD512S.name
    return Bits(frames, provenance=Provenance(name, path.name, tuple(notes)))


def _read_all_sparse(path: Path, files: Sequence[Path]) -> npt.NDArray[Any] | Frames:
    """Return the frames of sparse files as one stack."""
    raw = [RawFile(file, _TRAILER) for file in files]
    parts, ends = zip(*map(_read_sparse, raw), strict=True)
    if not any(map(len, parts)):
        raise ValueError(f"{path}: expected frames that end in {_END_OF_FRAME}, got no such end")
    for file, part, end in zip(raw, parts, ends, strict=True):
        if left := file.size - end:
            warn(
                f"{file.path}: {counted(len(part), 'complete frame')}; {left} bytes are left over "
                "without an end of frame and not used"
            )
    return join_files(path, files, parts, finished=[file.has_trailer for file in raw])


def _read_sparse(file: RawFile) -> tuple[Frames, int]:
    """Return the frames of a sparse file, and the position in bytes at which the last one ends."""
    total = file.size // 4

    def read_words(start: int, number: int) -> npt.NDArray[np.uint32]:
        return file.read(4 * start, 4 * number).view("<u4")

    frames, offsets, end = _index_sparse(file.path, read_words, total)

    def read_group(start: int, stop: int) -> Packed:
        """Return some frames of one group, which is read from its stored offset on."""
        packed = np.zeros((stop - start, _END_OF_FRAME // 8), np.uint8)
        frame, position = start // _INDEX_STEP * _INDEX_STEP - start, offsets[start // _INDEX_STEP]
        next_group = -(-stop // _INDEX_STEP)
        last = offsets[next_group] if next_group < len(offsets) else total
        while frame < len(packed):
            words = read_words(position, min(_WORDS_AT_ONCE, last - position))
            frame = engine.set_positions(words, frame, packed, None)
            position += len(words)
        return _decode(packed)

    def read(start: int, stop: int) -> Packed:
        # Unpacked frames take eight times the memory, so each group is decoded on its own.
        first_cut = (start // _INDEX_STEP + 1) * _INDEX_STEP
        cuts = [start, *range(first_cut, stop, _INDEX_STEP), stop]
        return np.concatenate([read_group(a, b) for a, b in itertools.pairwise(cuts)])

    return Frames((frames, _SIDE, _SIDE // 8), read), 4 * end


def _index_sparse(
    path: Path, read_words: Callable[[int, int], npt.NDArray[np.uint32]], total: int
) -> tuple[int, list[int], int]:
    """Return the number of frames, the offset of every 64th frame, and the end of the last one.

    Offsets count words from the start of the file.
    """
    frames, offsets, end = 0, [0], 0
    for start in range(0, total, _WORDS_AT_ONCE):
        words = read_words(start, min(_WORDS_AT_ONCE, total - start))
        if words.max(initial=0) > _END_OF_FRAME:
            wrong = int(np.argmax(words > _END_OF_FRAME))
            raise ValueError(
                f"{path}: expected positions of 0 to {_END_OF_FRAME - 1}, and {_END_OF_FRAME} at "
                f"the end of a frame, got {words[wrong]} at byte {4 * (start + wrong)}; it is not "
                "a sparse file, or it is damaged"
            )
        ends = np.flatnonzero(words == _END_OF_FRAME) + start + 1
        # Frame n begins at the end of frame n - 1.
        offsets += ends[-(frames + 1) % _INDEX_STEP :: _INDEX_STEP].tolist()
        frames += len(ends)
        end = int(ends[-1]) if len(ends) else end
    return frames, offsets, end


def _write(bits: Bits, path: Path, *, sparse: bool) -> None:
    check_frame_size(bits, (_SIDE, _SIDE), (SPAD512S_SPARSE if sparse else SPAD512S).name)
    write_raw(
        bits,
        path,
        _encode_sparse if sparse else _encode_dense,
        frames_per_file=FRAMES_PER_FILE,
        file_name="RAW{:05d}.bin".format,
        trailer=_TRAILER,
    )


SPAD512S = Format(
    "spad512s",
    "SPAD512S, 512 x 512",
    open=open_spad512s,
    matches=functools.partial(_matches, sparse=False),
    other_extensions=OTHER_EXTENSIONS,
    is_raw=True,
    layout=_LAYOUT,
    fixed_layout=True,
    writer=Writer(
        bits=functools.partial(_write, sparse=False), extensions=(".bin",), plain=True, folder=True
    ),
)

SPAD512S_SPARSE = Format(
    "spad512s-sparse",
    "SPAD512S, the positions of the ones",
    open=functools.partial(open_spad512s, sparse=True),
    matches=functools.partial(_matches, sparse=True),
    other_extensions=OTHER_EXTENSIONS,
    is_raw=True,
    fixed_layout=True,
    writer=Writer(bits=functools.partial(_write, sparse=True), extensions=(".bin",), folder=True),
)
