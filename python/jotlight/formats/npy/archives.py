"""Archives of arrays, `.npz`. Those that jotlight writes have a label and a checksum.

The checksum is the comment of the zip archive, which ends the file.
"""

import math
import os
import zipfile
from io import BufferedIOBase
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt

from jotlight.errors import SeveralArraysError
from jotlight.formats.files.checksums import (
    END_PLACEHOLDER,
    append_checksum,
    check_appended,
    missing_error,
)
from jotlight.formats.files.limits import check_claimed_size
from jotlight.formats.files.remote_files import open_binary, remote_file
from jotlight.formats.frames.labels import MAX_LABEL_BYTES
from jotlight.formats.npy.arrays import (
    ARCHIVE_ERRORS,
    HEADER_ERRORS,
    objects_error,
    open_npy_array,
    read_header,
    reason,
)
from jotlight.formats.npy.compressed import check_end, naming_file, stream_npy
from jotlight.sensing.bits.frames import Frames

_LABEL = "jotlight.json"
"""Name of the member that holds the label of counts."""

_MAX_MEMBERS = 1000
"""Maximum number of arrays in an archive, each of which takes time to describe."""


def _open_zip(path: Path) -> zipfile.ZipFile:
    """Return an open archive, which may be at a URL."""
    return zipfile.ZipFile(path if remote_file(path) is None else open_binary(path))


def read_npz(path: str | os.PathLike[str], key: str | None = None) -> npt.NDArray[Any]:
    """Return one array of a `.npz` archive.

    Parameters
    ----------
    path : path
    key : str, optional
        Name of the array. Default: the only array of the archive.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When the file is not such an archive, is damaged, holds Python objects, has no array
        `key`, or has several arrays and `key` is None.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "counts.npz"
    >>> np.savez(path, dark=np.arange(3), flat=np.ones(3))
    >>> read_npz(path, "dark").tolist()
    [0, 1, 2]
    """
    path = Path(path)
    key = select_npz_array(path, key)
    try:
        with _open_zip(path) as archive:
            shape, dtype = _read_member_header(archive, f"{key}.npy")
            size, stored = math.prod(shape) * dtype.itemsize, archive.getinfo(f"{key}.npy")
            check_claimed_size(key, size, stored.compress_size, frame_bytes=size)
            # Not numpy.load, which returns the bytes of a member that is not an array.
            with archive.open(f"{key}.npy") as member:
                array = np.asarray(np.lib.format.read_array(member, allow_pickle=False))
                check_end(cast(BufferedIOBase, member))
                return array
    except (*HEADER_ERRORS, *ARCHIVE_ERRORS) as error:
        if "Object arrays" in str(error):
            raise objects_error(f"{path}: {key}") from error
        raise ValueError(f"{path}: the array {key} is damaged ({reason(error)})") from error


def select_npz_array(path: Path, key: str | None) -> str:
    """Return `key` if a `.npz` archive has this array; for None, the name of its only array.

    Raises
    ------
    ValueError
        When there is no such array, or `key` is None and there are several.
    """
    names = list_npz_arrays(path)
    if key is None and len(names) == 1:
        return names[0]
    if key is None or key not in names:
        raise SeveralArraysError.of_file(path, names, key, "array")
    return key


def describe_npz_arrays(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype[Any]]]:
    """Return the shape and the type of each array in a `.npz` archive, from its header.

    Raises
    ------
    FileNotFoundError, ValueError
        As for :func:`list_npz_arrays`, and ValueError when a header is damaged, or an array holds
        Python objects.
    """
    described = {}
    names = list_npz_arrays(path)
    with naming_file(str(path)), _open_zip(path) as archive:
        for name in names:
            with naming_file(f"{path}: {name}"):
                described[name] = _read_member_header(archive, f"{name}.npy")
            if described[name][1].hasobject:
                raise objects_error(f"{path}: {name}")
    return described


def _read_member_header(
    archive: zipfile.ZipFile, name: str
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return a shape and a type. Raise ValueError when they claim more bytes than there are."""
    with archive.open(name) as member:
        shape, _, dtype = read_header(member)
    claimed, available = math.prod(shape) * dtype.itemsize, archive.getinfo(name).file_size
    if not dtype.hasobject and not 0 <= claimed <= available:
        raise ValueError(f"its header claims {claimed} bytes, but there are {available}")
    return shape, dtype


def _check_member(member: zipfile.ZipInfo, file_bytes: int) -> zipfile.ZipInfo:
    """Return a member of a file of `file_bytes` bytes if it is safe to read.

    Raises
    ------
    ValueError
        When the member claims to be larger than the file, or Python would decompress it without a
        limit.
    """
    if member.compress_size > file_bytes:
        raise ValueError(
            f"its member {member.filename} claims {member.compress_size} compressed bytes, but the "
            f"file has {file_bytes}"
        )
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(
            f"its member {member.filename} is compressed by a method that numpy does not use; "
            "save it with numpy.savez_compressed"
        )
    return member


def list_npz_arrays(path: Path) -> list[str]:
    """Return the names of the arrays in a `.npz` archive, in the order of the archive.

    Raises
    ------
    FileNotFoundError
        When there is no such file.
    ValueError
        When the file is not a zip archive, or has no arrays, too many, or two of one name.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        with _open_zip(path) as archive:
            size = path.stat().st_size
            members = [_check_member(member, size).filename for member in archive.infolist()]
    except (ValueError, *ARCHIVE_ERRORS) as error:
        raise ValueError(f"{path}: expected a .npz archive ({reason(error)})") from error
    if len(members) > _MAX_MEMBERS:
        raise ValueError(
            f"{path}: expected at most {_MAX_MEMBERS} arrays, got {len(members)}; save them in "
            "several archives"
        )
    names = [name.removesuffix(".npy") for name in members if name.endswith(".npy")]
    if not names:
        raise ValueError(f"{path}: expected a .npz archive of arrays, but it has none")
    if len(set(names)) < len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        raise ValueError(
            f"{path}: expected a different name for each array, got several arrays {repeated}; "
            "save them again under different names"
        )
    return names


def stream_npz(path: Path, key: str | None, *, verified: bool = False) -> npt.NDArray[Any] | Frames:
    """Return one array of a `.npz` archive as frames. If it is the only one, `key` can be None.

    An array in Fortran order cannot be streamed, so it is read into memory. See
    :func:`jotlight.formats.npy.compressed.stream_npy` for `verified`.
    """
    key = select_npz_array(path, key)
    if remote_file(path) is not None:
        verified = True  # not by reading everything before the first frame
        if (place := _stored_place(path, f"{key}.npy")) is not None:
            return open_npy_array(path, *place)

    def reopen() -> BufferedIOBase:
        return cast(BufferedIOBase, _open_zip(path).open(f"{key}.npy"))

    try:
        return stream_npy(reopen, path, f"{path}: {key}", verified=verified)
    except ValueError as error:
        if "Fortran" not in str(error):
            raise
        return read_npz(path, key)


def _stored_place(path: Path, name: str) -> tuple[int, int] | None:
    """Return the begin and the end of a member in its archive; None if it is compressed."""
    with naming_file(f"{path}: {name}"), _open_zip(path) as archive, open_binary(path) as file:
        member = archive.getinfo(name)
        if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & 1:
            return None
        file.seek(member.header_offset + 26)  # the lengths of the name and of an extra field
        lengths = file.read(4)
    begin = member.header_offset + 30
    begin += sum(int.from_bytes(lengths[at : at + 2], "little") for at in (0, 2))
    return begin, begin + member.file_size


def read_npz_label(path: Path) -> str | None:
    """Return the label that jotlight wrote into a `.npz` archive, or None if there is none.

    Raises
    ------
    ValueError
        When the file is not a zip archive, or the label is damaged.
    """
    with naming_file(str(path)):
        archive = _open_zip(path)
    with naming_file(f"{path}: {_LABEL}"), archive:
        if _LABEL not in archive.namelist():
            return None
        with archive.open(_LABEL) as member:
            label = member.read(MAX_LABEL_BYTES).decode()
            check_end(cast(BufferedIOBase, member))
            return label


def finish_npz(file: IO[bytes], label: str) -> None:
    """Add a label and the checksum of the whole file to a `.npz` archive.

    The file must be open for reading and writing.
    """
    with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as archive:
        # A ZipInfo has a fixed time, so equal data yield equal files.
        archive.writestr(zipfile.ZipInfo(_LABEL), label)
        archive.comment = END_PLACEHOLDER
    append_checksum(file, placeholder=False)


def verify_npz(path: Path) -> int:
    """Return 1 if a `.npz` archive matches its checksum, or 0 if jotlight did not write it.

    Raises
    ------
    OSError
        When the file cannot be read.
    ValueError
        When the archive differs from its checksum, or has a label but no checksum.
    """
    verified = check_appended(path)
    if not verified and read_npz_label(path) is not None:
        raise missing_error(path)
    return int(verified)
