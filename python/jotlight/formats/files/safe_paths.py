"""One rule for the files that jotlight opens although the user did not pass their paths.

The user passes the path of a file or folder, which may lead through symbolic links. jotlight opens
other files only because a folder contains them or a file names them. Such a file must lie in the
folder that was passed, or in the folder of the file that names it, or below. Symbolic links are
followed before this is checked. So a capture from a stranger cannot lead to private files.
"""

import collections
import errno
import os
from collections.abc import Iterator
from pathlib import Path

LINK_FOLDERS = "JOTLIGHT_LINK_FOLDERS"
"""Environment variable: further folders to which links may lead, separated as in PATH."""

_MAX_FOLDER_LINKS = 1000
"""Maximum number of links to folders in a capture."""

MAX_SEARCHED = 1000
"""When the format of a folder is detected, at most this many folders without a matching file are
searched. The folder of a capture has few. So a wrong folder, such as ``/``, is refused in less
than a second."""


def check_inside(file: Path, folder: Path) -> Path:
    """Return a file or folder if it lies in `folder` or below, after links are followed.

    Raises
    ------
    ValueError
        When it lies elsewhere, unless :data:`LINK_FOLDERS` allows that place.

    Examples
    --------
    >>> check_inside(Path("a/b.npy"), Path("a")).name
    'b.npy'
    """
    try:
        target = file.resolve()
        allowed = [part for part in os.environ.get(LINK_FOLDERS, "").split(os.pathsep) if part]
        if any(target.is_relative_to(place.resolve()) for place in (folder, *map(Path, allowed))):
            return file
    except (OSError, RuntimeError) as error:  # symbolic links can form a cycle
        raise ValueError(f"{file}: its symbolic links lead nowhere ({error})") from error
    raise ValueError(
        f"{file}: leads to {target}, which is outside of the folder {folder}; copy it into the "
        f"folder, or allow its place with the environment variable {LINK_FOLDERS}={target.parent}"
    )


def list_below(
    folder: Path, extensions: tuple[str, ...] = ("",), *, max_others: int | None = None
) -> Iterator[Path]:
    """Yield the files with these extensions, in lower case, in a folder and below it.

    Links are followed. A file that several paths lead to is yielded for each path. The files of a
    folder come before those of the folders in it.

    Parameters
    ----------
    folder : path
        The folder.
    extensions : tuple of str
        Extensions of the files in lower case. Default: all.
    max_others : int, optional
        Maximum number of folders that contain no such file. Default: any number.

    Raises
    ------
    OSError
        When a folder cannot be read.
    ValueError
        When a link leads out of the folder, links form a loop, or other folders are too many.
    """
    waiting, links, others = collections.deque([folder]), 0, 0
    while waiting:
        is_other = True
        for entry, is_folder in _entries(waiting.popleft(), folder):
            if not is_folder and not entry.name.lower().endswith(extensions):
                continue
            path = Path(entry.path)
            if entry.is_symlink():
                check_inside(path, folder)
                links += is_folder
                if links > _MAX_FOLDER_LINKS:
                    raise ValueError(
                        f"{path}: expected at most {_MAX_FOLDER_LINKS} links to folders; "
                        "remove links that form a loop"
                    )
            if is_folder:
                waiting.append(path)
            elif entry.is_file():
                is_other = False
                yield path
        others += is_other
        if max_others is not None and others > max_others:
            raise ValueError(
                f"{folder}: expected a capture: a file, or the folder of its files; got a folder "
                f"with more than {max_others} folders that contain no {' or '.join(extensions)}; "
                "pass the folder of the capture itself, or format= (--format)"
            )


def _entries(current: Path, folder: Path) -> Iterator[tuple[os.DirEntry[str], bool]]:
    """Yield what is in a folder, and whether each is a folder itself.

    Errors name the `folder` that was passed, if the current one lies below it.
    """
    try:
        with os.scandir(current) as entries:
            for entry in entries:
                yield entry, entry.is_dir()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise ValueError(f"{current}: remove links that form a loop") from error
        if current == folder:
            raise
        raise type(error)(
            f"{folder}: expected the folder of a capture, but {current} in it cannot be read "
            f"({error.strerror})"
        ) from error


def resolve_below(path: Path, name: object, parameter: str) -> Path:
    """Return the file of this name in the folder of `path` or below it.

    Raises
    ------
    ValueError
        When `name` is not a relative path, or leads out of the folder, directly or by a symbolic
        link. The message begins with `parameter`.
    """
    if isinstance(name, str) and name not in ("", ".") and "\0" not in name:
        relative = Path(name)
        if not relative.anchor and ".." not in relative.parts:
            try:
                return check_inside(path.parent / relative, path.parent)
            except ValueError as error:
                raise ValueError(f"{parameter}: {error}") from error
    raise ValueError(
        f"{parameter}: expected the name of a file in the same folder or below, got {name!r}"
    )
