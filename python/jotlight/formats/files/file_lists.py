"""The files of a capture that is a folder, in natural order."""

import re
from pathlib import Path

from jotlight.formats.files.safe_paths import list_below

_MAX_FILES = 1_000_000
"""Maximum number of files in a capture."""

_MAX_SHOWN = 5
"""Maximum number of extensions in a message."""

NUMBER = ".NUMBER"
"""The extension of files such as `a.001`, which differ in the number."""


def natural_sort_key(path: Path) -> tuple[tuple[int, int, str], ...]:
    """Return a key that sorts `RAW2.bin` before `RAW10.bin`, in each folder of the path.

    Examples
    --------
    >>> [path.name for path in sorted(map(Path, ["a10", "a9", "b1"]), key=natural_sort_key)]
    ['a9', 'a10', 'b1']
    """
    return tuple(
        (1, 0, word) if index % 2 == 0 else (0, int(word), "")
        for part in path.parts
        for index, word in enumerate(re.split(r"([0-9]+)", part))
        if word
    )


def file_extension(path: Path) -> str:
    """Return the extension of a file in lower case. All numbers are the same extension.

    Some programs count files by numbers as extensions.

    Examples
    --------
    >>> [file_extension(Path(name)) for name in ("a.RAW", "a.001", "a.1000", "a")]
    ['.raw', '.NUMBER', '.NUMBER', '']
    """
    return re.sub(r"^\.[0-9]+$", NUMBER, path.suffix.lower())


def list_files(
    path: Path, extensions: tuple[str, ...], kind: str, *, or_others: bool = False
) -> list[Path]:
    """Return the file itself, or all files in a folder and below it, in natural order.

    Parameters
    ----------
    path : path
        A file or a folder.
    extensions : tuple of str
        Extensions of the files in a folder, in lower case. Hidden files are ignored.
    kind : str
        Kind of the files, for messages.
    or_others : bool
        Whether a folder without such files may hold files of one other extension. All numbers
        count as one extension.

    Raises
    ------
    FileNotFoundError
        When there is nothing at the path.
    ValueError
        When a folder has no such file, or too many, or a link in it leads out of it.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise FileNotFoundError(f"there is no file or folder {path}")
    found = _find_files(path, extensions)
    if not found and or_others:
        found = _find_files(path, ("",))
        others = sorted({file_extension(file) or "none" for file in found})
        if len(others) > 1:
            raise ValueError(
                f"{path}: expected a folder with {kind} files ({', '.join(extensions)}), or with "
                f"files of one other extension, got {', '.join(others[:_MAX_SHOWN])}; move all "
                "other files out of it"
            )
    if not found:
        raise ValueError(
            f"{path}: expected a folder with {kind} files ({', '.join(extensions)}), got none in it"
        )
    return sorted(found, key=lambda file: natural_sort_key(file.relative_to(path)))


def _find_files(folder: Path, extensions: tuple[str, ...]) -> list[Path]:
    found = []
    for file in list_below(folder, extensions):
        if file.name[0] != ".":
            found.append(file)
        if len(found) > _MAX_FILES:
            raise ValueError(f"{folder}: expected at most {_MAX_FILES} files, got more")
    return found
