"""Readers of the file formats of CIFAR-10, which never run code from a file."""

import io
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Levels
from jotlight.formats.files.safe_paths import check_inside
from jotlight.formats.npy.archives import read_npz
from jotlight.formats.npy.arrays import ARCHIVE_ERRORS
from jotlight.formats.npy.compressed import measure_gzip, open_gzip

ARCHIVE = "cifar-10-binary.tar.gz"
RECORDS = 10_000
"""Number of images in each original file."""

_BINARY, _PYTHON, _GRAY = "cifar-10-batches-bin", "cifar-10-batches-py", "cifar10_gray.npz"
_PIXELS = 3 * 32 * 32
_RECORD = 1 + _PIXELS
"""Bytes per image in the binary version: a label, then red, green, and blue, row by row."""

_MAX_OPCODES = 1_000_000
"""Maximum number of opcodes to search. An original pickle has fewer than twenty thousand."""


def read_folder(folder: Path, split: str, names: Sequence[str]) -> Iterator[Levels]:
    """Return an iterator over the gray levels of each file in a folder.

    Raises
    ------
    FileNotFoundError
        If the folder has no known form, or lacks some of the files `names`.
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder}")
    for form, ending, read in ((_BINARY, ".bin", _read_binary), (_PYTHON, "", _read_pickle)):
        for place in (folder / form, folder):
            paths = [place / f"{name}{ending}" for name in names]
            missing = [path.name for path in paths if not path.is_file()]
            if not missing:
                return map(read, [check_inside(path, folder) for path in paths])
            if place.is_dir() and (len(missing) < len(paths) or place.name == form):
                raise FileNotFoundError(
                    f"{place}: expected the files {', '.join(path.name for path in paths)} of "
                    f"CIFAR-10, did not find {', '.join(missing)}; unpack the archive again"
                )
    if (folder / ARCHIVE).is_file():
        return read_archive(check_inside(folder / ARCHIVE, folder), names)
    if (folder / _GRAY).is_file():
        return iter([_read_gray(check_inside(folder / _GRAY, folder), split)])
    raise FileNotFoundError(
        f"{folder}: expected CIFAR-10 as {_BINARY}/{names[0]}.bin, {_PYTHON}/{names[0]}, {ARCHIVE} "
        f"or {_GRAY}, found none of these; pass the folder that contains one, or no folder to "
        "fetch the data"
    )


def _read_binary(path: Path) -> Levels:
    size = path.stat().st_size
    _check_binary(str(path), size)
    return _decode_binary(path.read_bytes())


def _check_binary(name: str, size: int) -> None:
    if size % _RECORD or not 0 < size <= RECORDS * _RECORD:
        raise ValueError(
            f"{name}: expected up to {RECORDS} records of {_RECORD} bytes, got {size} bytes; the "
            "file is truncated or a different one; fetch it again"
        )


def _decode_binary(content: bytes) -> Levels:
    return gray_levels(np.frombuffer(content, np.uint8).reshape(-1, _RECORD)[:, 1:])


def gray_levels(pixels: npt.NDArray[np.uint8]) -> Levels:
    """Return gray levels (N, 32, 32) from red, green, and blue values (N, 3072)."""
    planes = pixels.reshape(-1, 3, 32, 32)
    levels = np.empty((len(planes), 32, 32), np.uint8)
    for start in range(0, len(planes), 1000):  # in parts, to save memory
        red, green, blue = np.moveaxis(planes[start : start + 1000].astype(np.int32), 1, 0)
        # Integer weights make the sum exact, so ties round alike on every machine.
        levels[start : start + 1000] = np.rint((299 * red + 587 * green + 114 * blue) / 1000)
    return levels


def _read_pickle(path: Path) -> Levels:
    """Return the pixels of a pickle from its opcodes. Unpickling could run any code."""
    import pickletools

    size, expected = path.stat().st_size, RECORDS * _PIXELS
    # Besides the pixels, a file has a label and a file name per image, about 32 bytes.
    if not expected < size <= RECORDS * 4096:
        raise ValueError(
            f"{path}: expected more than the {expected} bytes of {RECORDS} images, got "
            f"{size}; the file is truncated or a different one; fetch it again"
        )
    try:
        # A file would allocate as many bytes as an opcode claims to have; this buffer does not.
        with path.open("rb") as file:
            content = io.BytesIO(file.read(size))
        for _, argument, _ in itertools.islice(pickletools.genops(content), _MAX_OPCODES):
            # Python 2 wrote text where Python 3 writes bytes.
            if isinstance(argument, str) and len(argument) == expected:
                argument = argument.encode("latin-1")
            if isinstance(argument, bytes | bytearray) and len(argument) == expected:
                return gray_levels(np.frombuffer(argument, np.uint8).reshape(-1, _PIXELS))
    except (ValueError, OverflowError) as error:
        raise ValueError(
            f"{path}: expected a batch of CIFAR-10's Python version, but it is damaged or a "
            f"different file ({str(error)[:200]}); fetch it again"
        ) from error
    raise ValueError(
        f"{path}: expected a batch of CIFAR-10's Python version, with a string of {expected} bytes "
        "in it, found none; fetch it again"
    )


def read_archive(path: Path, names: Sequence[str]) -> Iterator[Levels]:
    """Yield the gray levels of each file in the archive, in the order of `names`."""
    import tarfile

    expected = [f"{_BINARY}/{name}.bin" for name in names]
    pending: dict[str, Levels] = {}
    yielded = 0
    try:
        measure_gzip(path)  # which compares the checksum before any image is returned
        with open_gzip(path) as file, tarfile.open(fileobj=file, mode="r:") as archive:
            # Read in the order of the archive: seeking back would decompress it from the start.
            for member in archive:
                if member.name not in expected[yielded:] or not member.isreg():
                    continue
                _check_binary(f"{path}: {member.name}", member.size)
                content = archive.extractfile(member)
                assert content is not None  # a regular file has content
                pending[member.name] = _decode_binary(content.read())
                while yielded < len(expected) and expected[yielded] in pending:
                    yield pending.pop(expected[yielded])
                    yielded += 1
                if yielded == len(expected):
                    return
    except (tarfile.TarError, EOFError, *ARCHIVE_ERRORS) as error:
        raise ValueError(f"{path}: the archive is damaged ({error}); fetch it again") from error
    raise FileNotFoundError(f"{path}: expected {expected[yielded]} in the archive, found none")


def _read_gray(path: Path, split: str) -> Levels:
    """Return the images of the gray copy that JPEG did not change."""
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
