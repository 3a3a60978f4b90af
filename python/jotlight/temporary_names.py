"""Names of temporary files and folders, and the removal of what killed processes left."""

import contextlib
import errno
import itertools
import os
import platform
import re
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)
"""Error numbers of file systems that do not support locks."""


@contextlib.contextmanager
def reserve_temporary(path: Path) -> Iterator[Path]:
    """Yield a path beside `path` at which nothing exists. No other process gets the same path.

    A locked file beside the temporary path shows that its process is still running: the operating
    system unlocks the file when the process ends in any way. If the lock of a temporary path for
    `path` is free, a killed process left what lies there, so it is removed. Processes on other
    hosts use other names, because on some network file systems they do not see the locks. Where
    locks do not exist, the name is random, and nothing is removed.

    Raises
    ------
    OSError
        When the folder is not writable.
    """
    with contextlib.ExitStack() as locks:
        try:
            temporary = _lock_first_free(path, locks)
        except _NoLocksError:
            temporary = _temporary_path(path, secrets.token_hex(4))
            locks.callback(_remove, temporary)
        yield temporary


def has_temporaries(path: Path) -> bool:
    """Return whether a process on any host is writing a path, or was killed while it did."""
    beginning, end = _beginning(path), f"{path.suffix}.lock"
    names = (each.name for each in path.parent.iterdir())
    return any(name.startswith(beginning) and name.endswith(end) for name in names)


class _NoLocksError(Exception):
    """The file system or the operating system does not support locks."""


def _lock_first_free(path: Path, locks: contextlib.ExitStack) -> Path:
    """Return the first temporary path whose lock is free, locked until `locks` closes."""
    paths = (_temporary_path(path, str(number)) for number in itertools.count())
    temporary = next(each for each in paths if locks.enter_context(_locked(each)))
    # Several killed processes may have left files at the next paths.
    for leftover in itertools.takewhile(lambda each: os.path.lexists(_lock_file(each)), paths):
        with _locked(leftover):
            pass
    return temporary


@contextlib.contextmanager
def _locked(temporary: Path) -> Iterator[bool]:
    """Yield whether a temporary path could be locked. Remove what lies there, before and after."""
    lock = _lock_file(temporary)
    handle = _acquire(lock)
    if handle is None:
        yield False
        return
    try:
        _remove(temporary)
        yield not os.path.lexists(temporary)
    finally:
        _remove(temporary)
        lock.unlink(missing_ok=True)
        os.close(handle)


def _acquire(lock: Path) -> int | None:
    """Return the handle of a file that was locked, or None if this is not possible."""
    if fcntl is None:
        raise _NoLocksError
    while True:
        try:
            # A link that somebody planted in a shared folder is not followed.
            handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        except OSError:
            if os.path.lexists(lock):
                return None
            raise
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # The previous holder may have deleted the file after this process opened it.
            if lock.exists() and os.path.samestat(os.fstat(handle), lock.lstat()):
                return handle
        except OSError as error:
            os.close(handle)
            if error.errno not in _NO_LOCKS:
                return None
            lock.unlink(missing_ok=True)
            raise _NoLocksError from error
        os.close(handle)


def _remove(temporary: Path) -> None:
    if temporary.is_dir() and not temporary.is_symlink():
        shutil.rmtree(temporary, ignore_errors=True)
    else:
        with contextlib.suppress(FileNotFoundError, PermissionError):
            temporary.unlink()


def _temporary_path(path: Path, number: str) -> Path:
    host = re.sub(r"\W", "_", platform.node())[:24]
    return path.with_name(f"{_beginning(path)}{host}-{number}{path.suffix}")


def _beginning(path: Path) -> str:
    return f".{path.stem[:32]}.jotlight-"


def _lock_file(temporary: Path) -> Path:
    return temporary.with_name(f"{temporary.name}.lock")
