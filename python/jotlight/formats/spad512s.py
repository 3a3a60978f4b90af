"""SPAD512S: frames of 512 x 512 jots, the most significant bit first, as they come off the camera.

Its own software shows them rotated by 90 degrees anticlockwise, and so do we. A dense file has up
to 1000 frames of 32768 bytes. A sparse file has the places of the ones as uint32, little endian,
and 262144 after each frame. Either has the four letters `DONE` at its end when it came by the
network.
"""

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.formats.orientation import transpose_packed
from jotlight.formats.raw import ENDINGS, RawFile, list_files, raw_frames
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, concatenate
from jotlight.sensing.provenance import Provenance

Packed = npt.NDArray[np.uint8]

SIDE = 512
FRAME_BYTES = SIDE * SIDE // 8
TRAILER = b"DONE"
FRAMES_PER_FILE = 1000

_END = SIDE * SIDE
_EVERY = 64
"""The place of one frame in so many is remembered, so that a long file takes little memory."""
_WORDS = 1 << 20
_SHOWN = "rotated by 90 degrees anticlockwise, as its own software shows it"


def shown(raw: Packed) -> Packed:
    """Packed frames as the camera's software shows them."""
    return transpose_packed(raw.reshape(len(raw), SIDE, SIDE // 8), SIDE)[:, ::-1]


def encode_frames(frames: Packed) -> Packed:
    """Undo :func:`shown`."""
    return transpose_packed(frames[:, ::-1], SIDE)


def has_trailer(path: Path) -> bool:
    """Whether a file is one that the camera's software ended with `DONE`."""
    size = path.stat().st_size
    if size <= len(TRAILER):
        return False
    with path.open("rb") as file:
        file.seek(size - len(TRAILER))
        return file.read() == TRAILER


def looks_sparse(path: Path) -> bool:
    """Whether a file with a trailer begins like a sparse one: places, and ends of frames."""
    words = np.fromfile(path, "<u4", min(_END + 1, path.stat().st_size // 4 - 1))
    ends = int((words == _END).sum())
    # In dark frames of a dense file most words are 0, which is a place of one jot.
    return ends > 0 and words.max() <= _END and int((words == 0).sum()) <= ends + 1


def open_spad512s(path: Path, *, sparse: bool = False) -> Bits:
    """Open a file, or a folder of them in natural order."""
    name = "spad512s-sparse" if sparse else "spad512s"
    files = list_files(path, ENDINGS, "SPAD512S")
    if sparse:
        frames = concatenate([_sparse_frames(file) for file in files])
        if len(frames) == 0:
            raise ValueError(f"{path}: expected frames that end in {_END}, got no such end")
        notes = [f"places of ones as uint32, little endian, row by row; {_SHOWN}"]
    else:
        frames = raw_frames(files, (SIDE, SIDE // 8), shown, TRAILER)
        notes = [f"frames of {SIDE} x {SIDE}, the most significant bit first; {_SHOWN}"]
    if len(files) > 1:
        notes.append(f"{len(files)} files in the natural order of their names")
    return Bits(frames, provenance=Provenance(name, path.name, tuple(notes)))


def _sparse_frames(path: Path) -> Frames:
    file = RawFile(path, TRAILER)
    total, left = divmod(file.size, 4)

    def words_at(start: int, number: int) -> npt.NDArray[np.uint32]:
        return file.read(4 * start, 4 * number).view("<u4")

    frames, starts, end = 0, [0], 0
    for start in range(0, total, _WORDS):
        words = words_at(start, min(_WORDS, total - start))
        if words.max(initial=0) > _END:
            wrong = int(np.argmax(words > _END))
            raise ValueError(
                f"{path}: expected places of 0 to {_END - 1} and {_END} at the end of a frame, got "
                f"{words[wrong]} at byte {4 * (start + wrong)}; it is no sparse file or damaged"
            )
        ends = np.flatnonzero(words == _END) + start + 1
        # The frame with number n begins after the end of frame n - 1.
        starts += ends[-(frames + 1) % _EVERY :: _EVERY].tolist()
        frames += len(ends)
        end = int(ends[-1]) if len(ends) else end
    if end < total or left:
        warn(
            f"{path}: {frames} whole frames; {4 * (total - end) + left} bytes are left over "
            "without an end of frame and not used"
        )

    def read(start: int, stop: int) -> Packed:
        out = np.zeros((stop - start, _END), np.bool_)
        number, place = start // _EVERY * _EVERY, starts[start // _EVERY]
        behind = -(-stop // _EVERY)
        last = starts[behind] if behind < len(starts) else total
        while number < stop:
            words = words_at(place, min(_WORDS, last - place))
            ends = words == _END
            # The number of the frame that each word belongs to.
            of = number + np.cumsum(ends) - ends
            ours = (of >= start) & (of < stop) & ~ends
            out[of[ours] - start, words[ours]] = True
            number, place = number + int(ends.sum()), place + len(words)
        return shown(np.packbits(out.reshape(-1, SIDE, SIDE), axis=2))

    def in_parts(start: int, stop: int) -> Packed:
        # A frame unpacked takes eight times as much, so few of them at a time.
        cuts = [start, *range((start // _EVERY + 1) * _EVERY, stop, _EVERY), stop]
        return np.concatenate([read(a, b) for a, b in itertools.pairwise(cuts)])

    return Frames((frames, SIDE, SIDE // 8), in_parts)


def raw_bytes(bits: Bits, *, sparse: bool = False) -> tuple[int, Callable[[Packed], Packed]]:
    """How many frames go into a file, and what turns packed frames into its bytes."""
    if bits.shape[1:] != (SIDE, SIDE):
        size = " x ".join(map(str, bits.shape[1:]))
        raise ValueError(f"spad512s: expected frames of {SIDE} x {SIDE} jots, got {size}")
    return FRAMES_PER_FILE, (
        lambda part: _as_words(encode_frames(part))
    ) if sparse else encode_frames


def _as_words(raw: Packed) -> npt.NDArray[np.uint8]:
    flat = np.unpackbits(raw.reshape(len(raw), -1), axis=1)
    # An end after each frame sorts behind its pixels.
    whole = np.concatenate([flat, np.ones((len(raw), 1), np.uint8)], axis=1)
    return np.nonzero(whole)[1].astype("<u4").view(np.uint8)
