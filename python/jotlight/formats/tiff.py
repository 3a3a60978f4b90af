"""TIFF files by strangers: the directories of their pages are walked before they are believed."""

import os
from pathlib import Path
from typing import IO, Any, Literal

_TYPE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_TYPE_BYTES |= {16: 8, 17: 8, 18: 8}
_SUB_DIRECTORIES = 330

_MOST_READ = 8
"""How often the bytes of a file are read at most as the values of tags, which pages may share."""
_SLACK = 1 << 24


def open_checked_tiff(path: Path) -> Any:
    """Open a checked file with tifffile, which is not to open others that it names.

    Raises
    ------
    ValueError
        When its directories overlap, lead back, or do not lie in it.
    """
    import tifffile

    check_directories(path)
    return tifffile.TiffFile(path, is_ome=False, is_mmstack=False, is_ndtiff=False)


def check_directories(path: Path) -> None:
    """Raise ValueError unless following the directories ends, and soon.

    Together they may take no more bytes than the file has. A chain that leads back to itself, or
    whose directories lie over each other, exceeds that.
    """
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        order: Literal["little", "big"] = "little" if file.read(2) == b"II" else "big"
        big = int.from_bytes(file.read(2), order) == 43
        # Bytes of an offset, of the number of tags, and of a tag.
        offset_bytes, number_bytes, tag_bytes = (8, 8, 20) if big else (4, 2, 12)
        file.seek(8 if big else 4)
        waiting = [_number(file, offset_bytes, order)]
        taken = read = 0
        while waiting:
            offset = waiting.pop()
            if offset == 0:
                continue
            file.seek(min(offset, size))
            length = _number(file, number_bytes, order) * tag_bytes
            taken += number_bytes + length + offset_bytes
            if length == 0 or taken > size:
                raise ValueError(
                    "the directories of its pages overlap, lead back or are not in it; it is "
                    "damaged or truncated"
                )
            tags = _exactly(file, length)
            waiting.append(_number(file, offset_bytes, order))
            for start in range(0, length, tag_bytes):
                tag = tags[start : start + tag_bytes]
                kind = int.from_bytes(tag[2:4], order)
                count = int.from_bytes(tag[4 : 4 + offset_bytes], order)
                value = tag[4 + offset_bytes :]
                here = count * _TYPE_BYTES.get(kind, 0)
                read += here if here > len(value) else 0
                if read > _MOST_READ * size + _SLACK:
                    raise ValueError("its tags tell of more bytes than it has; it is damaged")
                if int.from_bytes(tag[:2], order) == _SUB_DIRECTORIES and here:
                    if here > len(value):
                        place = file.tell()
                        file.seek(min(int.from_bytes(value, order), size))
                        value = _exactly(file, here)
                        file.seek(place)
                    each = _TYPE_BYTES[kind]
                    found = (value[at : at + each] for at in range(0, here, each))
                    waiting += [int.from_bytes(one, order) for one in found]


def _number(file: IO[bytes], length: int, order: Literal["little", "big"]) -> int:
    return int.from_bytes(_exactly(file, length), order)


def _exactly(file: IO[bytes], length: int) -> bytes:
    data = file.read(length)
    if len(data) != length:
        raise ValueError("a directory of its pages is not whole; it is damaged or truncated")
    return data
