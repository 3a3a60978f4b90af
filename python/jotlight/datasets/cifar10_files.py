"""The forms in which CIFAR-10 lies on disks, read without running anything that is in them."""

import itertools
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.formats.arrays import read_npz

ARCHIVE = "cifar-10-binary.tar.gz"
RECORDS = 10_000
"""Pictures in each original file."""

_BINARY, _PYTHON, _GRAY = "cifar-10-batches-bin", "cifar-10-batches-py", "cifar10_gray.npz"
_PIXELS = 3 * 32 * 32
_RECORD = 1 + _PIXELS
"""Bytes of the binary version: a label, then red, green and blue, each row by row."""

_MOST_OPCODES = 1_000_000
"""The pixels of an original pickle come within twenty thousand."""

Levels = npt.NDArray[np.uint8]


def found(folder: Path, split: str, names: Sequence[str]) -> Iterator[Levels]:
    """Look which form a folder holds, and give the grey levels file by file.

    Raises
    ------
    FileNotFoundError
        When it holds none, or only a part of the files `names`.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    for form, ending, read in ((_BINARY, ".bin", _read_binary), (_PYTHON, "", _read_pickle)):
        for place in (folder / form, folder):
            paths = [place / f"{name}{ending}" for name in names]
            missing = [path.name for path in paths if not path.is_file()]
            if not missing:
                return map(read, paths)
            if place.is_dir() and (len(missing) < len(paths) or place.name == form):
                raise FileNotFoundError(
                    f"{place}: expected the files {', '.join(path.name for path in paths)} of "
                    f"CIFAR-10, did not find {', '.join(missing)}; unpack the archive anew"
                )
    if (folder / ARCHIVE).is_file():
        return from_archive(folder / ARCHIVE, names)
    if (folder / _GRAY).is_file():
        return iter([_read_gray(folder / _GRAY, split)])
    raise FileNotFoundError(
        f"{folder}: expected CIFAR-10 as {_BINARY}/{names[0]}.bin, {_PYTHON}/{names[0]}, {ARCHIVE} "
        f"or {_GRAY}, found none of these; give the folder that holds one, or leave it out and "
        "the data are fetched"
    )


def _read_binary(path: Path) -> Levels:
    size = path.stat().st_size
    _check_binary(str(path), size)
    return _records(path.read_bytes())


def _check_binary(name: str, size: int) -> None:
    if size % _RECORD or not 0 < size <= RECORDS * _RECORD:
        raise ValueError(
            f"{name}: expected up to {RECORDS} records of {_RECORD} bytes, got {size} bytes; the "
            "file is truncated or another; fetch it anew"
        )


def _records(content: bytes) -> Levels:
    return _gray(np.frombuffer(content, np.uint8).reshape(-1, _RECORD)[:, 1:])


def _gray(pixels: npt.NDArray[np.uint8]) -> Levels:
    """Grey levels (N, 32, 32) of records (N, 3072)."""
    planes = pixels.reshape(-1, 3, 32, 32)
    levels = np.empty((len(planes), 32, 32), np.uint8)
    for begin in range(0, len(planes), 1000):  # for the sake of memory
        red, green, blue = np.moveaxis(planes[begin : begin + 1000].astype(np.int32), 1, 0)
        # In thousandths the sum is exact, so that halves round alike on every machine.
        levels[begin : begin + 1000] = np.rint((299 * red + 587 * green + 114 * blue) / 1000)
    return levels


def _read_pickle(path: Path) -> Levels:
    """The pixels of a pickle, which is taken apart and not run: unpickling can run any code."""
    import pickletools

    size, expected = path.stat().st_size, RECORDS * _PIXELS
    # The rest are a label and a file name for each picture, some 32 bytes.
    if not expected < size <= RECORDS * 4096:
        raise ValueError(
            f"{path}: expected some more than the {expected} bytes of {RECORDS} pictures, got "
            f"{size}; the file is truncated or another; fetch it anew"
        )
    try:
        with path.open("rb") as file:
            for _, argument, _ in itertools.islice(pickletools.genops(file), _MOST_OPCODES):
                # Python 2 wrote text where Python 3 writes bytes.
                if isinstance(argument, str) and len(argument) == expected:
                    argument = argument.encode("latin-1")
                if isinstance(argument, bytes | bytearray) and len(argument) == expected:
                    return _gray(np.frombuffer(argument, np.uint8).reshape(-1, _PIXELS))
    except (ValueError, OverflowError) as error:
        raise ValueError(
            f"{path}: expected a batch of CIFAR-10's Python version, but it is damaged or another "
            f"file ({str(error)[:200]}); fetch it anew"
        ) from error
    raise ValueError(
        f"{path}: expected a batch of CIFAR-10's Python version, with a string of {expected} bytes "
        "in it, found none; fetch it anew"
    )


def from_archive(path: Path, names: Sequence[str]) -> Iterator[Levels]:
    """Give the files of the binary version in turn out of their archive; nothing is unpacked."""
    import tarfile

    wanted = [f"{_BINARY}/{name}.bin" for name in names]
    waiting: dict[str, Levels] = {}
    due = 0
    try:
        with tarfile.open(path, "r:gz") as archive:
            # In the archive's own order, since going back would unpack it from the start.
            for member in archive:
                if member.name not in wanted[due:] or not member.isreg():
                    continue
                _check_binary(f"{path}: {member.name}", member.size)
                file = archive.extractfile(member)
                assert file is not None  # it is a regular one
                waiting[member.name] = _records(file.read())
                while due < len(wanted) and wanted[due] in waiting:
                    yield waiting.pop(wanted[due])
                    due += 1
                if due == len(wanted):
                    return
    except (tarfile.TarError, zlib.error, EOFError, OSError) as error:
        raise ValueError(f"{path}: the archive is damaged ({error}); fetch it anew") from error
    raise FileNotFoundError(f"{path}: expected {wanted[due]} in the archive, which is not there")


def _read_gray(path: Path, split: str) -> Levels:
    """Those pictures of the copy in grey that never were a JPEG."""
    images, lossless = read_npz(path, f"x_{split}"), read_npz(path, f"{split}_lossless")
    if images.dtype != np.uint8 or images.ndim != 3 or images.shape[1:] != (32, 32):
        raise ValueError(
            f"{path}: expected x_{split} as uint8 (N, 32, 32), got {images.dtype} of shape "
            f"{images.shape}"
        )
    if lossless.dtype != np.bool_ or lossless.shape != images.shape[:1] or not lossless.any():
        raise ValueError(
            f"{path}: expected {split}_lossless as bool ({len(images)},) with some True, got "
            f"{lossless.dtype} of shape {lossless.shape}"
        )
    return np.asarray(images[lossless])
