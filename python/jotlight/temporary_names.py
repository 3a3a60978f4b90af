"""Names of temporary files and folders, and the removal of those that killed processes left."""

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

    A locked file beside the temporary path shows that its process exists: the operating system
    unlocks it when the process ends, however it ends. What lies at a temporary path for `path`
    without a lock was left by a killed process, so it is removed. Processes on other hosts use
    other names, because some network file systems keep locks to themselves. Where locks do not
    exist, the name is random, and nothing is removed.

    Raises
    ------
    OSError
        When the folder is not writable.
    """
    with contextlib.ExitStack() as locks:
        try:
            temporary = _lock_first_free(path, locks)
        except _NoLocksError:
            temporary = _name(path, secrets.token_hex(4))
            locks.callback(_remove, temporary)
        yield temporary


class _NoLocksError(Exception):
    """The file system or the operating system does not support locks."""


def _lock_first_free(path: Path, locks: contextlib.ExitStack) -> Path:
    """Return the first name without a living process, and keep it locked until `locks` closes."""
    names = (_name(path, str(number)) for number in itertools.count())
    temporary = next(name for name in names if locks.enter_context(_locked(name)))
    # Processes that wrote the same file at the same time may have left the next names.
    for leftover in itertools.takewhile(lambda name: os.path.lexists(_lock_file(name)), names):
        with _locked(leftover):
            pass
    return temporary


@contextlib.contextmanager
def _locked(temporary: Path) -> Iterator[bool]:
    """Lock a name and remove what lies there, before and after. Yield whether it was possible."""
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
    """Return the handle of a locked file, or None if another process has it."""
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
            # The previous holder may have deleted the file after it was opened here.
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


def _name(path: Path, number: str) -> Path:
    host = re.sub(r"\W", "_", platform.node())[:24]
    return path.with_name(f".{path.stem[:32]}.jotlight-{host}-{number}{path.suffix}")


def _lock_file(temporary: Path) -> Path:
    return temporary.with_name(f"{temporary.name}.lock")
