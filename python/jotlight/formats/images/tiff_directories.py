"""The directories of a TIFF file, checked before a library follows them."""

import dataclasses
import logging
import os
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from jotlight.formats.files.magic import ByteOrder
from jotlight.formats.files.remote_files import open_binary, remote_file

_TYPE_BYTES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4}
_TYPE_BYTES |= {16: 8, 17: 8, 18: 8}
"""Size of a value in bytes, by the number of its type."""

_SUB_DIRECTORIES = 330
"""Tag whose values are the offsets of further directories."""

_MAX_VALUE_RATIO = 8
"""Maximum ratio of all tag values to the size of the file. It is not 1: pages may share values."""

_FREE_BYTES = 1 << 24
"""Number of bytes that the values of tags may have in a file of any size."""

_NO_OUTPUT = logging.NullHandler()
"""Handler without which Python prints what tifffile logs, also if nobody has set up logging."""


def open_checked_tiff(path: Path) -> Any:
    """Return the ``tifffile.TiffFile`` of a file with valid directories.

    Other files that the metadata name are not opened.

    Raises
    ------
    ValueError
        When its directories overlap, form a cycle, or lie outside of the file.
    """
    import tifffile

    check_directories(path)
    source = path if remote_file(path) is None else open_binary(path)
    logging.getLogger("tifffile").addHandler(_NO_OUTPUT)
    return tifffile.TiffFile(source, is_ome=False, is_mmstack=False, is_ndtiff=False)


def move_samples_last(values: npt.NDArray[Any], axes: str) -> npt.NDArray[Any]:
    """Return images whose samples, such as colors, are on the last axis.

    Some files store each sample apart. `axes` has a letter of tifffile for each axis.

    Examples
    --------
    >>> move_samples_last(np.zeros((3, 480, 640)), "SYX").shape
    (480, 640, 3)
    """
    return np.moveaxis(values, axes.index("S"), -1) if "S" in axes else values


def shape_of(series: Any) -> tuple[int, ...]:
    """Return the shape of a series of tifffile, with the samples on the last axis."""
    empty = np.broadcast_to(np.uint8(0), series.shape)
    return move_samples_last(empty, series.axes).shape


@dataclasses.dataclass(frozen=True)
class _Tag:
    number: int
    kind: int
    """Number of the type of its values."""
    value_bytes: int
    """Size of all values in bytes; 0 if the type is unknown."""
    inline: bytes
    """The values if they fit, or else their offset."""


@dataclasses.dataclass(frozen=True)
class _Layout:
    """Byte order, and the sizes in bytes that differ between TIFF and BigTIFF."""

    order: ByteOrder
    offset_bytes: int
    number_bytes: int
    """Size of the field with the number of tags of a directory."""
    tag_bytes: int
    first_offset_position: int

    def read_number(self, file: IO[bytes], length: int) -> int:
        return int.from_bytes(_read_exactly(file, length), self.order)

    def parse_tag(self, tag: bytes) -> _Tag:
        kind = int.from_bytes(tag[2:4], self.order)
        count = int.from_bytes(tag[4 : 4 + self.offset_bytes], self.order)
        return _Tag(
            number=int.from_bytes(tag[:2], self.order),
            kind=kind,
            value_bytes=count * _TYPE_BYTES.get(kind, 0),
            inline=tag[4 + self.offset_bytes :],
        )


def check_directories(path: Path) -> None:
    """Raise ValueError unless the directories of a TIFF file are a finite chain inside the file.

    Together, the directories may have no more bytes than the file. A cycle, or directories that
    overlap, exceed this limit.
    """
    with open_binary(path) as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(0)
        layout = _read_layout(file)
        file.seek(layout.first_offset_position)
        waiting = [layout.read_number(file, layout.offset_bytes)]
        directory_bytes = value_bytes = 0
        while waiting:
            offset = waiting.pop()
            if offset == 0:
                continue
            file.seek(min(offset, size))
            length = layout.read_number(file, layout.number_bytes) * layout.tag_bytes
            directory_bytes += layout.number_bytes + length + layout.offset_bytes
            if length == 0 or directory_bytes > size:
                raise ValueError(
                    "the directories of its pages overlap, form a cycle, or lie outside of the "
                    "file; it is damaged or truncated"
                )
            tags = _read_exactly(file, length)
            waiting.append(layout.read_number(file, layout.offset_bytes))
            for start in range(0, length, layout.tag_bytes):
                tag = layout.parse_tag(tags[start : start + layout.tag_bytes])
                value_bytes += tag.value_bytes if tag.value_bytes > len(tag.inline) else 0
                if value_bytes > _MAX_VALUE_RATIO * size + _FREE_BYTES:
                    raise ValueError("its tags claim more bytes than it has; it is damaged")
                if tag.number == _SUB_DIRECTORIES and tag.value_bytes:
                    waiting += _read_offsets(file, tag, layout.order, size)


def _read_layout(file: IO[bytes]) -> _Layout:
    order: ByteOrder = "little" if file.read(2) == b"II" else "big"
    is_big_tiff = int.from_bytes(file.read(2), order) == 43
    return _Layout(order, 8, 8, 20, 8) if is_big_tiff else _Layout(order, 4, 2, 12, 4)


def _read_offsets(file: IO[bytes], tag: _Tag, order: ByteOrder, size: int) -> list[int]:
    """Return the values of a tag. The position in the file stays the same."""
    value = tag.inline
    if tag.value_bytes > len(value):
        position = file.tell()
        file.seek(min(int.from_bytes(value, order), size))
        value = _read_exactly(file, tag.value_bytes)
        file.seek(position)
    each = _TYPE_BYTES[tag.kind]
    starts = range(0, tag.value_bytes, each)
    return [int.from_bytes(value[start : start + each], order) for start in starts]


def _read_exactly(file: IO[bytes], length: int) -> bytes:
    data = file.read(length)
    if len(data) != length:
        raise ValueError("a directory of its pages is incomplete; it is damaged or truncated")
    return data
