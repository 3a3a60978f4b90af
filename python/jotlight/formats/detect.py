"""Which format a file or folder is of, by its content."""

from pathlib import Path

from jotlight.formats.magic import read_signature
from jotlight.formats.raw import ENDINGS as RAW_ENDINGS
from jotlight.formats.raw import natural_sort_key
from jotlight.formats.spad512s import has_trailer, looks_sparse
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


def detect_format(path: Path) -> str:
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
    >>> detect_format(path)
    'spad512s'
    """
    if path.is_dir():
        return _of_folder(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    if path.name == TRANSFORMS:
        return "visionsim"
    name = read_signature(path)
    if name == "npy.gz" and path.name.lower().endswith(RAW_ENDINGS):
        raise _unknown(path)
    if name is not None:
        return name
    if has_trailer(path):
        return "spad512s-sparse" if looks_sparse(path) else "spad512s"
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
    raw = sorted(path.rglob("*.bin"), key=natural_sort_key)
    ended = next(filter(has_trailer, raw), None)
    if ended is not None:
        return "spad512s-sparse" if looks_sparse(ended) else "spad512s"
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
