"""Sizes in a `.mat` of version 5, checked before SciPy takes memory for them."""

import zlib
from pathlib import Path
from typing import Literal

from jotlight.formats.limits import check_claimed_size

Order = Literal["little", "big"]

_COMPRESSED = 15
_MATRIX = 14
_NUMBERS = (1, 2, 3, 4, 5, 6, 7, 9, 12, 13)
"""The types that numbers are stored in; SciPy crashes on one that there is not."""
_CLASSES = range(6, 16)
"""Variables of numbers. Others are never read further than their name."""
_COMPLEX = 0x0800
_HEADER = 128
_PREFIX = 1 << 16
_MOST_VARIABLES = 10_000


def check_sizes(path: Path) -> None:
    """Raise ValueError when a variable or a part of one tells of more bytes than there can be."""
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(_HEADER)
        if not header.startswith(b"MATLAB 5.0") or header[126:128] not in (b"IM", b"MI"):
            raise ValueError("it is not of version 5 or 7 (save with -v7 or -v7.3)")
        order: Order = "little" if header[126:128] == b"IM" else "big"
        place = _HEADER
        for _ in range(_MOST_VARIABLES):
            file.seek(place)
            tag = file.read(8)
            if not tag:
                return
            kind, there = _word(tag, 0, order), _word(tag, 4, order)
            if len(tag) < 8 or there > size - place - 8 or kind not in (_COMPRESSED, _MATRIX):
                raise ValueError("it is truncated or damaged")
            start = file.read(min(there, _PREFIX))
            if kind == _COMPRESSED:
                start = zlib.decompressobj().decompress(start, _PREFIX)
                kind, content_bytes = _word(start, 0, order), _word(start, 4, order)
                if kind != _MATRIX or len(start) < 8:
                    raise ValueError("a variable is damaged")
                check_claimed_size("a variable", content_bytes, there)
                _check_parts(start[8:], content_bytes, order)
            else:
                _check_parts(start, there, order)
            place += 8 + there
    raise ValueError(f"it has more than {_MOST_VARIABLES} variables")


def _check_parts(start: bytes, content_bytes: int, order: Order) -> None:
    """The flags, sizes, name and numbers of a variable, each behind a tag."""
    place = 0
    flags = _word(start, 8, order)
    numeric = flags & 0xFF in _CLASSES
    if numeric and flags & _COMPLEX:
        raise ValueError("a variable has complex numbers, expected real ones")
    while place + 8 <= min(len(start), content_bytes):
        word, size = _word(start, place, order), _word(start, place + 4, order)
        if word >> 16:  # up to four bytes stand in the tag itself
            word, size = word & 0xFFFF, 0
        if size > content_bytes - place - 8 or (numeric and word not in _NUMBERS):
            raise ValueError("a variable is damaged")
        place += 8 + (size + 7) // 8 * 8


def _word(data: bytes, place: int, order: Order) -> int:
    return int.from_bytes(data[place : place + 4], order)
