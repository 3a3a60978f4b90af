"""File types that the first bytes of a file identify."""

from pathlib import Path
from typing import Literal

from jotlight.formats.files.remote_files import BLOCK_BYTES, open_binary, remote_file

ByteOrder = Literal["little", "big"]
"""The order of the bytes of a number in a file."""

_HDF5 = b"\x89HDF\r\n\x1a\n"
"""Signature of HDF5. It may follow a block that HDF5 leaves to applications."""

_USER_BLOCKS = range(9, 31)
"""Binary logarithms of the sizes that such a block can have: 512, 1024, 2048, … bytes."""

_SIGNATURES = (
    (b"\x93NUMPY", "npy"),
    (b"\x1f\x8b\x08", "gzip"),
    (b"PK\x03\x04", "zip"),
    (b"PK\x05\x06", "zip"),
    (b"MATLAB ", "matlab"),
    (b"\x89PNG\r\n\x1a\n", "png"),
    (_HDF5, "hdf5"),
    (b"II*\0", "tiff"),
    (b"MM\0*", "tiff"),
    (b"II+\0", "tiff"),
    (b"MM\0+", "tiff"),
)
"""Pairs of the first bytes of a file and the name of its type."""


def file_type(path: Path) -> str | None:
    r"""Return the file type that the first bytes of a file identify, or None.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "a"
    >>> _ = path.write_bytes(b"II*\0 and so on")
    >>> file_type(path)
    'tiff'
    """
    is_remote = remote_file(path) is not None
    with open_binary(path) as file:
        start = file.read(16)
        for first, name in _SIGNATURES:
            if start.startswith(first):
                return name
        for exponent in _USER_BLOCKS:
            if is_remote and 1 << exponent >= BLOCK_BYTES:
                break  # one request suffices for the smaller blocks
            file.seek(1 << exponent)
            start = file.read(len(_HDF5))
            if start == _HDF5:
                return "hdf5"
            if not start:
                break
    return None


def has_type(path: Path, name: str) -> bool:
    """Return whether `path` is a file of the type `name`."""
    return path.is_file() and file_type(path) == name
