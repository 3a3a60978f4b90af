"""File names that a description states, checked so that they cannot point elsewhere."""

import contextlib
from pathlib import Path


def resolve_below(path: Path, name: object, parameter: str) -> Path:
    """Return the file of this name in the folder of `path` or below it.

    Raises
    ------
    ValueError
        When `name` is not a relative path, or leads out of the folder, directly or by a symbolic
        link. The message begins with `parameter`.
    """
    folder = path.parent
    if isinstance(name, str) and name not in ("", ".") and "\0" not in name:
        relative, found = Path(name), folder / name
        with contextlib.suppress(OSError, RuntimeError):  # symbolic links can form a cycle
            within = found.resolve().is_relative_to(folder.resolve())
            if within and not relative.anchor and ".." not in relative.parts:
                return found
    raise ValueError(
        f"{parameter}: expected the name of a file in the same folder or below, got {name!r}"
    )


def resolve_sibling(path: Path, name: object) -> Path:
    """Return the file of this name in the folder of `path`.

    Raises
    ------
    ValueError
        When `name` is not a plain file name.
    """
    if (
        not isinstance(name, str)
        or Path(name).name != name
        or name in ("", ".", "..")
        or "\0" in name
    ):
        raise ValueError(f"maps: expected the name of a file in the same folder, got {name!r}")
    return path.parent / name
