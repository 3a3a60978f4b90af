"""The first bytes that tell what a file is."""

from pathlib import Path

_BEGINNINGS = (
    (b"\x93NUMPY", "npy"),
    (b"\x1f\x8b\x08", "npy.gz"),
    (b"PK\x03\x04", "npz"),
    (b"PK\x05\x06", "npz"),
    (b"MATLAB ", "matlab"),
    (b"\x89PNG\r\n\x1a\n", "png"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"II*\0", "tiff"),
    (b"MM\0*", "tiff"),
    (b"II+\0", "tiff"),
    (b"MM\0+", "tiff"),
)


def read_signature(path: Path) -> str | None:
    """The format that the first bytes of a file tell, or None."""
    with path.open("rb") as file:
        start = file.read(16)
    return next((name for first, name in _BEGINNINGS if start.startswith(first)), None)
