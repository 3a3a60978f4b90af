"""Files and folders that are written completely or not at all."""

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

_DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Error numbers of the operating system that mean a lack of disk space."""


def refuse_overwrite(output: str | os.PathLike[str], inputs: Iterable[Path | None]) -> None:
    """Raise ValueError when the output file is one of the input files."""
    output = Path(output)
    for path in inputs:
        if path is not None and path.exists() and output.exists() and output.samefile(path):
            raise ValueError(
                f"{output}: this file is read, so it is not overwritten; choose another name"
            )


@contextlib.contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path in the same folder. When the block ends, it is renamed to `path`.

    The temporary file is created on entry. A folder without write permission therefore raises
    before any work is done. If the block raises, also because of Ctrl-C, the temporary file is
    deleted, and an existing file at `path` stays unchanged.

    Raises
    ------
    OSError
        When the folder does not exist or is not writable, or when `path` is a folder.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> with atomic_write(folder / "note.txt") as temporary:
    ...     _ = temporary.write_text("all of it")
    >>> (folder / "note.txt").read_text()
    'all of it'
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"cannot write {path}: it is a folder; pass the name of a file")
    _check_parent(path)
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(f"cannot write {path}: the file is read-only")
    with _explained_creation(path):
        handle, name = tempfile.mkstemp(
            prefix=f".{path.stem[:32]}-", suffix=path.suffix, dir=path.parent
        )
    os.close(handle)
    temporary = Path(name)
    try:
        with _explained_full_disk(path):
            yield temporary
            temporary.chmod(_permissions(path))
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder next to `path`. When the block ends, it is renamed to `path`.

    Raises
    ------
    OSError
        When `path` already exists, or the folder that contains it is not writable.
    """
    path = Path(path)
    if path.exists():
        raise FileExistsError(f"cannot write {path}: it already exists; choose another name")
    _check_parent(path)
    with _explained_creation(path):
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.stem[:32]}-", dir=path.parent))
    try:
        with _explained_full_disk(path):
            yield temporary
            temporary.chmod(0o777 & ~_umask())
            temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _check_parent(path: Path) -> None:
    if not path.parent.is_dir():
        raise FileNotFoundError(
            f"cannot write {path}: there is no folder {path.parent}; create it first"
        )


@contextlib.contextmanager
def _explained_creation(path: Path) -> Iterator[None]:
    """Raise an error that names `path` and its folder if the temporary file cannot be created."""
    try:
        yield
    except OSError as error:
        raise type(error)(
            f"cannot write {path}: {error.strerror or error} in folder {path.parent}"
        ) from error


@contextlib.contextmanager
def _explained_full_disk(path: Path) -> Iterator[None]:
    """Raise an error that names `path` if the disk is full, unless the error names another file."""
    try:
        yield
    except OSError as error:
        if error.errno in _DISK_FULL and "cannot write" not in str(error.strerror):
            reason = os.strerror(error.errno)
            raise OSError(error.errno, f"cannot write {path}: {reason}") from error
        raise


def _permissions(path: Path) -> int:
    """Return the permissions of the file at `path`, or those that a new file would get."""
    return path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask()


def _umask() -> int:
    # The only way to read the mask is to set it.
    mask = os.umask(0)
    os.umask(mask)
    return mask
