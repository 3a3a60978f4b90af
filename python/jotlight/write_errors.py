"""Errors of failed writes, which name the output and the reason."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

_FAILED_WRITE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors that only a failed write causes: a full disk, an exceeded quota, and too large a file."""


@contextlib.contextmanager
def explained_creation(path: Path) -> Iterator[None]:
    """Raise an error that names `path` and its folder if the temporary file cannot be created."""
    try:
        yield
    except OSError as error:
        raise type(error)(
            f"cannot write {path}: {error.strerror or error} in folder {path.parent}"
        ) from error


@contextlib.contextmanager
def explained_failure(path: Path, temporary: Path) -> Iterator[None]:
    """Raise an OSError that names `path` if a write to its temporary file or folder failed."""
    try:
        yield
    except Exception as error:
        cause = _failed_write(error, temporary)
        if cause is None:
            raise
        # Libraries describe some of these errors in many lines.
        known = cause.errno in _FAILED_WRITE
        reason = os.strerror(cause.errno or 0) if known else cause.strerror
        raise OSError(cause.errno, f"cannot write {path}: {reason}") from error


def _failed_write(error: BaseException | None, temporary: Path) -> OSError | None:
    """Return the failed write to a temporary path that led to an error, or None without one."""
    while error is not None:
        if isinstance(error, OSError) and error.errno is not None:
            if str(error.strerror).startswith("cannot write"):
                return None  # A block for another file has already explained this error.
            if not isinstance(error.filename, str | bytes | os.PathLike):
                if error.errno in _FAILED_WRITE:
                    return error
            elif Path(os.fsdecode(error.filename)).is_relative_to(temporary):
                return error
        error = error.__cause__ or error.__context__
    return None
