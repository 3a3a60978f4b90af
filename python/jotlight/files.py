"""Files and folders that are written completely or not at all."""

import contextlib
import errno
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from jotlight.output_files import open_output
from jotlight.output_links import follow_link, resolve_output
from jotlight.paths import url_of
from jotlight.temporary_names import has_temporaries, reserve_temporary
from jotlight.write_errors import explained_creation, explained_failure

_unfinished: set[Path] = set()
"""Temporary files of blocks that have not ended."""


def _refuse_url(output: Path) -> None:
    """Raise ValueError when an output is a URL.

    Examples
    --------
    >>> _refuse_url(Path("s3://bucket/a.zarr"))
    Traceback (most recent call last):
      ...
    ValueError: s3://bucket/a.zarr: results are written to files of this machine, not to URLs
    """
    url = url_of(output)
    if url is not None:
        raise ValueError(f"{url}: results are written to files of this machine, not to URLs")


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path | None]) -> None:
    """Raise ValueError when an output is a URL, another output, or one of the input files.

    If symbolic links form a loop, raise OSError. None stands for a file that is not requested.

    Examples
    --------
    >>> check_outputs([Path("a.npy"), None, Path("./a.npy")], [])
    Traceback (most recent call last):
      ...
    ValueError: a.npy: expected a different name for each output, got this one twice
    """
    read = {_identity(path) for path in inputs if path is not None and path.exists()}
    written = set()
    for output in filter(None, outputs):
        _refuse_url(output)
        identity = _identity(output)
        if identity in read:
            raise ValueError(
                f"{output}: this file is read, so it is not overwritten; choose another name"
            )
        if identity in written:
            raise ValueError(
                f"{output}: expected a different name for each output, got this one twice"
            )
        written.add(identity)


def _identity(path: Path) -> Path | tuple[int, int]:
    """Return what two names of the same file have in common, which need not exist."""
    if not path.exists():
        return resolve_output(path)
    state = path.stat()
    return state.st_dev, state.st_ino


def refuse_folder(path: Path, example: str, *, may_be_new: bool = False) -> None:
    """Raise IsADirectoryError for a folder that exists, with an example of a file in it.

    If the output `may_be_new`, the message also proposes a new folder.
    """
    if path.is_dir():
        raise IsADirectoryError(
            f"cannot write {path}: it is a folder; name a file in it, such as {path / example}"
            f"{', or a new folder' * may_be_new}"
        )


def write_file(
    path: str | os.PathLike[str],
    content: bytes | str,
    *,
    durable: bool = True,
    output: Path | None = None,
) -> None:
    """Write bytes, or text in UTF-8, as a file, completely or not at all.

    `durable` and `output` are those of :func:`atomic_write`.
    """
    with (
        atomic_write(path, durable=durable, output=output) as temporary,
        open_output(temporary) as file,
    ):
        file.write(content.encode() if isinstance(content, str) else content)


def delete_file(path: Path) -> None:
    """Delete a file, and the temporary files for it that killed processes left.

    If `path` is a symbolic link, this is about the file to which it leads. The link remains.
    """
    follow_link(path).unlink(missing_ok=True)
    remove_leftovers(path)


def remove_leftovers(path: Path) -> None:
    """Delete the temporary files for a path that killed processes left.

    If `path` is a symbolic link, they are those for the file to which it leads.
    """
    path = follow_link(path)
    if path.parent.is_dir() and has_temporaries(path):
        with reserve_temporary(path):
            pass


@contextlib.contextmanager
def atomic_write(
    path: str | os.PathLike[str], *, durable: bool = True, output: Path | None = None
) -> Iterator[Path]:
    """Yield a temporary path in the folder of `path`, and rename it to `path` when the block ends.

    The temporary file is created on entry. So if the folder is not writable, an error is raised
    before any work is done. If the block raises, also because of Ctrl-C, the temporary file is
    deleted, and an existing file at `path` stays unchanged. If `path` is a symbolic link, this is
    about the file to which it leads. If `path` is itself a temporary path of a surrounding block,
    it is yielded unchanged.

    Parameters
    ----------
    path : path
        The file.
    durable : bool
        Whether the content is on the disk before the file is renamed, so that it also survives a
        power failure. This takes milliseconds.
    output : path, optional
        The output that errors name, if the file lies beside one. Default: the file.

    Raises
    ------
    OSError
        When the folder does not exist or is not writable, when `path` is a folder, a device, or a
        pipe, or when a write failed, for example because the disk is full.

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
    if path in _unfinished:
        yield path
        return
    path = follow_link(path)
    with atomic_write_together([], [path], durable=durable, output=output or path) as (temporary,):
        yield temporary


@contextlib.contextmanager
def atomic_write_together(
    outputs: Sequence[Path],
    beside: Sequence[Path] = (),
    *,
    durable: bool = True,
    output: Path | None = None,
) -> Iterator[list[Path]]:
    """Yield a temporary path for each output and each file beside them, and rename all at the end.

    No file is renamed before the contents of all files are on the disk. So the renames together
    take microseconds. Only a process that is killed during this time leaves old files beside new
    ones: the outputs appear last. Errors about a file beside them, such as a record, name `output`,
    which is the first one by default. In all other respects, this function is like
    :func:`atomic_write`.

    Raises
    ------
    OSError
        See :func:`atomic_write`.
    """
    paths = [follow_link(path) for path in [*outputs, *beside]]
    with contextlib.ExitStack() as stack:
        named = [*paths[: len(outputs)], *[output or paths[0]] * len(beside)]
        temporaries = [
            stack.enter_context(_temporary_file(*each)) for each in zip(paths, named, strict=True)
        ]
        yield temporaries
        for path, temporary in zip(paths, temporaries, strict=True):
            if (permissions := _permissions(path)) is not None:
                temporary.chmod(permissions)
            if durable:
                flush_to_disk(temporary)
        pairs = list(zip(paths, temporaries, strict=True))
        for path, temporary in pairs[len(outputs) :] + pairs[: len(outputs)]:
            temporary.replace(path)
        for folder in {path.parent for path in paths if durable}:
            flush_to_disk(folder)


@contextlib.contextmanager
def _temporary_file(path: Path, named: Path) -> Iterator[Path]:
    """Yield a new temporary file for a path. It is deleted at the end, if it still exists.

    Errors of the disk or the folder name the path `named`.
    """
    if path.is_dir():
        raise IsADirectoryError(f"cannot write {path}: it is a folder; pass the name of a file")
    if path.exists() and not path.is_file():  # such as /dev/null, which root could replace
        raise OSError(f"cannot write {path}: it is a device or a pipe; pass the name of a file")
    _check_parent(named)
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(f"cannot write {path}: the file is read-only")
    with _reserved(path, named) as temporary:
        with explained_creation(named):
            # The system applies the mask of new files. Only changing it would read it.
            permissions = _permissions(path)
            mode = 0o666 if permissions is None else 0o600 | permissions
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, mode))
        _unfinished.add(temporary)
        try:
            with explained_failure(named, temporary):
                yield temporary
        finally:
            _unfinished.discard(temporary)


@contextlib.contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder next to `path`, and rename it to `path` when the block ends.

    Raises
    ------
    OSError
        When `path` already exists, the folder that contains it is not writable, or a write failed.
    """
    path = follow_link(Path(path))
    _refuse_existing(path)
    _check_parent(path)
    with _reserved(path, path) as temporary:
        with explained_creation(path):
            temporary.mkdir()
        with explained_failure(path, temporary):
            yield temporary
            for folder, _, names in os.walk(temporary):
                for name in names:
                    flush_to_disk(Path(folder, name))
                flush_to_disk(Path(folder))
            _refuse_existing(path)  # which another process may have written meanwhile
            temporary.rename(path)
            flush_to_disk(path.parent)


def _refuse_existing(path: Path) -> None:
    if path.exists():
        kind = "folder" if path.is_dir() else "file"
        raise FileExistsError(
            f"cannot write {path}: this {kind} already exists; choose another name"
        )


@contextlib.contextmanager
def _reserved(path: Path, named: Path) -> Iterator[Path]:
    """Yield a temporary path. Errors of its reservation name the path `named`."""
    with contextlib.ExitStack() as stack:
        with explained_creation(named):
            temporary = stack.enter_context(reserve_temporary(path))
        yield temporary


def flush_to_disk(path: Path) -> None:
    """Wait until the content of a file, or the list of the names in a folder, is on the disk."""
    on_windows = os.name == "nt"
    if on_windows and path.is_dir():
        return  # Windows has no such function for folders.
    handle = os.open(path, os.O_RDWR if on_windows else os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # Some file systems have nothing to wait for.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        os.close(handle)


def _check_parent(path: Path) -> None:
    if not path.parent.is_dir():
        _refuse_url(path)
        raise FileNotFoundError(
            f"cannot write {path}: there is no folder {path.parent}; create it first"
        )


def create_parent(path: Path) -> None:
    """Create the folder of an output, and the folders that contain it.

    If `path` is a symbolic link, this is about the file or folder to which it leads.

    Raises
    ------
    OSError
        When that is impossible. The error names the output.
    """
    with explained_creation(path):
        follow_link(path).parent.mkdir(parents=True, exist_ok=True)


def _permissions(path: Path) -> int | None:
    """Return the permissions of the file at `path`, or None if there is none."""
    return path.stat().st_mode & 0o777 if path.exists() else None
