"""Files that appear whole or not at all."""

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system says when there is no room for a file."""


def refuse_overwrite(output: str | os.PathLike[str], inputs: Iterable[Path | None]) -> None:
    """Raise ValueError when a file to be written is one of those that are read."""
    output = Path(output)
    for path in inputs:
        if path is not None and path.exists() and output.exists() and output.samefile(path):
            raise ValueError(
                f"{output}: this file is read, so it is not overwritten; give another name"
            )


@contextlib.contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; it becomes `path` when the block ends.

    The temporary file is made on entry, so that a place that cannot be written to is found before
    any work is done. When the block raises, Ctrl-C included, the temporary file is removed and
    what stood at `path` before stays.

    Raises
    ------
    OSError
        When the folder does not exist, cannot be written to, or `path` is a folder.

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
        raise IsADirectoryError(f"cannot write {path}: it is a folder; give the name of a file")
    if not path.parent.is_dir():
        raise FileNotFoundError(
            f"cannot write {path}: there is no folder {path.parent}; make it first"
        )
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(f"cannot write {path}: the file is read-only")
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{path.stem[:32]}-", suffix=path.suffix, dir=path.parent
        )
    except OSError as error:
        raise type(error)(
            f"cannot write {path}: {error.strerror or error} in folder {path.parent}"
        ) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(_permissions(path))
        temporary.replace(path)
    except OSError as error:
        # Another file's may have come through here.
        if error.errno in _FULL and "cannot write" not in str(error.strerror):
            reason = os.strerror(error.errno)
            raise OSError(error.errno, f"cannot write {path}: {reason}") from error
        raise
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary folder beside `path` to fill; it becomes `path` when the block ends.

    Raises
    ------
    OSError
        When something stands at `path` already, or its folder cannot be written to.
    """
    path = Path(path)
    if path.exists():
        raise FileExistsError(f"cannot write {path}: it is there already; give another name")
    if not path.parent.is_dir():
        raise FileNotFoundError(
            f"cannot write {path}: there is no folder {path.parent}; make it first"
        )
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.stem[:32]}-", dir=path.parent))
    except OSError as error:
        raise type(error)(
            f"cannot write {path}: {error.strerror or error} in folder {path.parent}"
        ) from error
    try:
        yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o777 & ~mask)
        temporary.rename(path)
    except OSError as error:
        if error.errno in _FULL and "cannot write" not in str(error.strerror):
            reason = os.strerror(error.errno)
            raise OSError(error.errno, f"cannot write {path}: {reason}") from error
        raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _permissions(path: Path) -> int:
    """Those of the file that is replaced, or those that a new file would get."""
    if path.exists():
        return path.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
