"""Which format a file or folder is of, by its content."""

from pathlib import Path

from jotlight.formats.raw import natural
from jotlight.formats.spad512s import has_trailer
from jotlight.formats.visionsim import NAME as TRANSFORMS
from jotlight.formats.zarr import DESCRIPTIONS as ZARR

FORMATS = {
    "npy": "an array of NumPy: a photon cube or counts",
    "npy.gz": "the same, compressed",
    "npz": "an archive of arrays of NumPy",
    "visionsim": "a data set of visionsim, with transforms.json",
    "swissspad2": "SwissSPAD2, the half array of 256 x 512",
    "swissspad2-full": "SwissSPAD2, the full array of 512 x 512",
    "spad512s": "SPAD512S, 512 x 512",
    "spad512s-sparse": "SPAD512S, the places of the ones",
    "matlab": "MATLAB, a .mat or a folder of parts",
    "tiff": "counts in a TIFF, or in a folder of them",
    "png": "counts in a grey PNG, or in a folder of them",
    "hdf5": "an array in an HDF5 file",
    "zarr": "an array in a folder of zarr",
}
"""The name of each format that is read, and what it is."""

RAW = ("swissspad2", "swissspad2-full", "spad512s", "spad512s-sparse")
"""Formats without a header, which nothing in the file tells."""

_BEGINNINGS = (
    (b"\x93NUMPY", "npy"),
    (b"\x1f\x8b", "npy.gz"),
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

_ENDINGS = {
    ".npy": "npy",
    ".npz": "npz",
    ".mat": "matlab",
    ".tif": "tiff",
    ".tiff": "tiff",
    ".png": "png",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".gz": "npy.gz",
}
"""What says what was expected of a file that does not begin as its name promises."""


def recognise(path: Path) -> str:
    """The name of the format that a file or folder is of.

    Raises
    ------
    OSError
        When it cannot be read.
    ValueError
        When nothing tells.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "capture.bin"
    >>> _ = path.write_bytes(bytes(32768) + b"DONE")
    >>> recognise(path)
    'spad512s'
    """
    if path.is_dir():
        return _of_folder(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    if path.name == TRANSFORMS:
        return "visionsim"
    with path.open("rb") as file:
        start = file.read(16)
    for beginning, name in _BEGINNINGS:
        if start.startswith(beginning):
            return name
    if has_trailer(path):
        return "spad512s"
    ending = path.suffix.lower()
    if ending in _ENDINGS:
        raise ValueError(
            f"{path}: expected a {ending} file by its name, but it does not begin like one"
        )
    raise _unknown(path)


def _of_folder(path: Path) -> str:
    if (path / TRANSFORMS).is_file():
        return "visionsim"
    if any((path / name).is_file() for name in ZARR):
        return "zarr"
    if next(path.glob("part_*.mat"), None) is not None:
        return "matlab"
    raw = sorted(path.rglob("*.bin"), key=natural)
    if raw and all(has_trailer(file) for file in raw[:-1]) and has_trailer(raw[0]):
        return "spad512s"
    for ending, name in ((".png", "png"), (".tif", "tiff"), (".tiff", "tiff")):
        if not raw and any(file.suffix.lower() == ending for file in path.iterdir()):
            return name
    if path.suffix.lower() in _ENDINGS:
        raise IsADirectoryError(f"{path}: expected a {path.suffix} file, got a folder")
    raise _unknown(path)


def _unknown(path: Path) -> ValueError:
    others = ", ".join(name for name in FORMATS if name not in RAW)
    return ValueError(
        f"{path}: nothing in it tells its format; give the one it is of, format= (--format): "
        f"{', '.join(RAW)} for raw frames, or else one of {others}"
    )
