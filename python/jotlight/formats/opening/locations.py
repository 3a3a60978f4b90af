"""Paths, URLs, and globs of captures."""

import contextlib
import errno
import glob
import os
import re
from pathlib import Path
from typing import Any

from jotlight.formats.files.file_systems import expand_url, url_state
from jotlight.formats.npy.description import companion_files
from jotlight.paths import complete_path, pattern_advice, url_of
from jotlight.sensing.parameters.maps import MAPS

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.\-]+(::[A-Za-z0-9+.\-/]+)*://")

_TAKEN = "`jotlight reconstruct`, `jotlight convert`, and jotlight.open with a text take {}"
"""What takes other names of captures than paths."""

STANDARD_INPUT = Path("-")
"""The path that stands for standard input."""


def is_url(path: object) -> bool:
    """Return whether a path is a URL.

    Examples
    --------
    >>> is_url("s3://bucket/a.npy"), is_url("C:/data/a.npy"), is_url("a.npy")
    (True, False, False)
    """
    return isinstance(path, str) and _URL.match(path) is not None


def check_exists(path: Path) -> None:
    """Raise an error unless a path is a folder, or a file that is not empty.

    Raises
    ------
    FileNotFoundError
        When there is no such file.
    ValueError
        When it is an empty file, or a stream, such as standard input.

    Examples
    --------
    >>> check_exists(Path("-"))
    Traceback (most recent call last):
      ...
    ValueError: -: is a stream; write it to a file first, or show it by `jotlight view - --follow`
    """
    if path.is_file() or path.is_dir():
        if path.is_file() and path.stat().st_size == 0:
            raise ValueError(f"{path}: expected a capture, got an empty file")
        return
    if path == STANDARD_INPUT or path.exists():
        raise ValueError(
            f"{path}: is a stream; write it to a file first, or show it by "
            f"`jotlight view {STANDARD_INPUT} --follow`"
        )
    url = url_of(path)
    if url is not None:
        raise FileNotFoundError(f"there is no file {url}; {_TAKEN.format('a URL')}")
    _refuse_lost_links(path)
    advice = pattern_advice(path, f"name one; {_TAKEN.format('a pattern')}")
    raise FileNotFoundError(f"there is no file {path}{advice}")


def _refuse_lost_links(path: Path) -> None:
    """Raise FileNotFoundError when a path leads to no file through symbolic links."""
    try:
        path.stat()
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise FileNotFoundError(
                f"there is no file {path}: the symbolic links that lead to it form a loop"
            ) from error
    if path.is_symlink():
        raise FileNotFoundError(
            f"there is no file {path}: it is a symbolic link to {path.readlink()}, which is missing"
        )


def is_glob(path: str) -> bool:
    """Return whether a path or URL is a pattern of several, unless a file has this very name.

    Examples
    --------
    >>> is_glob("captures/*.npy"), is_glob("https://host/a.npy?version=2")
    (True, False)
    """
    if is_url(path):
        return re.search(r"[*\[]", path) is not None
    return glob.has_magic(path) and not Path(complete_path(path)).exists()


def expand(path: str, storage_options: dict[str, Any] | None = None) -> list[str]:
    """Return what a pattern matches, as :func:`find_matches`, without descriptions and maps.

    :func:`without_companions` says which ones are left out.
    """
    return without_companions(find_matches(path, storage_options))


def find_matches(path: str, storage_options: dict[str, Any] | None = None) -> list[str]:
    """Return the paths or URLs that a pattern matches, sorted; or else the path itself.

    Raises
    ------
    FileNotFoundError
        When a pattern matches nothing.
    """
    if not is_glob(path):
        return [path]
    if is_url(path):
        found = expand_url(path, storage_options)
    else:
        found = sorted(glob.glob(complete_path(path), recursive=True))  # noqa: PTH207
    if not found:
        raise FileNotFoundError(f"there is no file {path}: the pattern matches nothing")
    return found


def without_companions(paths: list[str]) -> list[str]:
    """Return paths without the descriptions and maps that belong to captures.

    Left out are the descriptions and maps of another one of the paths, and maps that a description
    beside them names, unless there is nothing else. URLs are all kept, because their descriptions
    would have to be fetched.

    Examples
    --------
    >>> without_companions(["a.npy", "a.json", "b.npy"])
    ['a.npy', 'b.npy']
    """
    files = {path: Path(path).absolute() for path in paths if not is_url(path)}
    companions = set[Path]().union(*map(companion_files, files.values()))
    kept = [path for path in paths if files.get(path) not in companions]
    captures = [path for path in kept if path not in files or not _is_map(files[path])]
    return captures or kept


def _is_map(file: Path) -> bool:
    """Return whether a description beside a file names it as a map of its sensor."""
    for ending in (f".{name}.npy" for name in MAPS):
        if file.name.endswith(ending):
            stem = file.name.removesuffix(ending)
            cubes = (file.with_name(stem), file.with_name(f"{stem}.npy"))
            return any(file in companion_files(cube) for cube in cubes)
    return False


def file_state(path: str, storage_options: dict[str, Any] | None = None) -> tuple[int, int]:
    """Return the size of a capture in bytes, and its last change in nanoseconds (0: unknown).

    Raises
    ------
    OSError
        When there is no such capture.
    """
    if is_url(path):
        return url_state(path, storage_options)
    _, size, latest = files_state(Path(path))
    return size, latest


def files_state(path: Path) -> tuple[int, int, int]:
    """Return the number, the total size, and the latest change of the files of a capture.

    In a folder, links to nothing and files that vanish meanwhile do not count.
    """
    if not path.is_dir():
        states = [path.stat()]
    else:
        files = [Path(folder, name) for folder, _, names in os.walk(path) for name in names]
        states = []
        for file in files:
            with contextlib.suppress(FileNotFoundError):
                states.append(file.stat())
    latest = max((state.st_mtime_ns for state in states), default=0)
    return len(states), sum(state.st_size for state in states), latest
