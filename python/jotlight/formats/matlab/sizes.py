"""Checks of a `.mat` file of version 5 to 7, before SciPy reads it.

The sizes that the file states are checked before SciPy allocates memory for them. The checksums of
compressed variables are checked because SciPy ignores them.
"""

import itertools
import os
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from jotlight.formats.files.limits import check_claimed_size
from jotlight.formats.files.magic import ByteOrder
from jotlight.formats.files.remote_files import open_binary

COMPRESSED = 15
"""Type of a compressed variable."""
_MATRIX = 14
"""Type of an uncompressed variable."""
_NUMBER_TYPES = (1, 2, 3, 4, 5, 6, 7, 9, 12, 13)
"""Types in which numbers are stored. SciPy crashes on an unknown type."""
_NUMERIC_CLASSES = range(6, 16)
"""Classes of variables that hold numbers. Of other variables, jotlight reads only the name."""
_COMPLEX = 0x0800
"""Flag of a variable with complex numbers."""
HEADER_BYTES = 128
"""Number of bytes before the first variable."""
_TAG_BYTES = 8
_PREFIX_BYTES = 1 << 16
"""Number of bytes that are inspected at the start of a variable."""
_MAX_VARIABLES = 10_000


def check_sizes(path: Path) -> list[int]:
    """Return the number of decompressed bytes of each variable, in the order of the file.

    Raises
    ------
    ValueError
        When a variable, or a part of it, claims more bytes than the file can hold.
    """
    sizes = []
    with open_binary(path) as file:
        order = _byte_order(file.read(HEADER_BYTES))
        for kind, size in _read_tags(file, order, path.stat().st_size):
            prefix = file.read(min(size, _PREFIX_BYTES))
            if kind == COMPRESSED:
                size = _check_compressed(prefix, size, order)
            else:
                _check_parts(prefix, size, order)
            sizes.append(size)
    return sizes


def check_streams(file: BinaryIO) -> None:
    """Raise ValueError unless all compressed variables are complete and fit their checksums."""
    file_bytes = file.seek(0, os.SEEK_END)
    file.seek(0)
    order = _byte_order(file.read(HEADER_BYTES))
    for kind, size in _read_tags(file, order, file_bytes):
        if kind == COMPRESSED:
            _check_stream(file, size, order)


def extract_variable(file: BinaryIO, number: int) -> bytes:
    """Return a file with one of the variables of a file, counted from 0. Only it is read."""
    file_bytes = file.seek(0, os.SEEK_END)
    file.seek(0)
    header = file.read(HEADER_BYTES)
    tags = _read_tags(file, _byte_order(header), file_bytes)
    _, size = next(itertools.islice(tags, number, None))
    start = file.tell() - _TAG_BYTES
    file.seek(start)
    return header + file.read(_TAG_BYTES + size)


def _byte_order(header: bytes) -> ByteOrder:
    if not header.startswith(b"MATLAB 5.0") or header[126:128] not in (b"IM", b"MI"):
        raise ValueError("it is not of version 5 or 7 (save with -v7 or -v7.3)")
    return "little" if header[126:128] == b"IM" else "big"


def _read_tags(file: BinaryIO, order: ByteOrder, file_bytes: int) -> Iterator[tuple[int, int]]:
    """Yield the type and the size of each variable, with the file at its first byte."""
    position = HEADER_BYTES
    for _ in range(_MAX_VARIABLES):
        file.seek(position)
        tag = file.read(_TAG_BYTES)
        if not tag:
            return
        kind, size = _word(tag, 0, order), _word(tag, 4, order)
        position += _TAG_BYTES
        available = file_bytes - position
        if len(tag) < _TAG_BYTES or size > available or kind not in (COMPRESSED, _MATRIX):
            raise ValueError("it is truncated or damaged")
        yield kind, size
        position += size
    raise ValueError(f"it has more than {_MAX_VARIABLES} variables")


def _check_stream(file: BinaryIO, size: int, order: ByteOrder) -> None:
    """Decompress a variable to its end, where zlib checks its Adler-32, in little memory."""
    stream, position, claimed = zlib.decompressobj(), 0, None
    while not stream.eof:
        data = stream.unconsumed_tail
        if not data:
            data = file.read(min(size, _PREFIX_BYTES))
            size -= len(data)
        part = stream.decompress(data, _PREFIX_BYTES)
        if claimed is None and len(part) >= _TAG_BYTES:
            claimed = _TAG_BYTES + _word(part, 4, order)
        position += len(part)
        if (not data and not part) or (claimed is not None and position > claimed):
            raise ValueError("a variable is truncated, or longer than it states")
    if position != claimed or stream.unused_data or size:
        raise ValueError("a variable has another length than it states")


def _check_compressed(prefix: bytes, compressed_bytes: int, order: ByteOrder) -> int:
    """Return the number of decompressed bytes of a variable."""
    prefix = zlib.decompressobj().decompress(prefix, _PREFIX_BYTES)
    kind, size = _word(prefix, 0, order), _word(prefix, 4, order)
    if kind != _MATRIX or len(prefix) < _TAG_BYTES:
        raise ValueError("a variable is damaged")
    check_claimed_size("a variable", size, compressed_bytes)
    _check_parts(prefix[_TAG_BYTES:], size, order)
    return size


def _check_parts(prefix: bytes, variable_bytes: int, order: ByteOrder) -> None:
    """Check the flags, sizes, name, and numbers of a variable. A tag precedes each of them."""
    position = 0
    flags = _word(prefix, 8, order)
    is_numeric = flags & 0xFF in _NUMERIC_CLASSES
    if is_numeric and flags & _COMPLEX:
        raise ValueError("a variable has complex numbers, expected real ones")
    while position + _TAG_BYTES <= min(len(prefix), variable_bytes):
        kind, size = _word(prefix, position, order), _word(prefix, position + 4, order)
        if kind >> 16:  # the tag itself holds up to four bytes of data
            kind, size = kind & 0xFFFF, 0
        available = variable_bytes - position - _TAG_BYTES
        if size > available or (is_numeric and kind not in _NUMBER_TYPES):
            raise ValueError("a variable is damaged")
        position += _TAG_BYTES + (size + 7) // 8 * 8


def _word(data: bytes, position: int, order: ByteOrder) -> int:
    return int.from_bytes(data[position : position + 4], order)
