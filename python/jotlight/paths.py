"""Paths as arguments: their checks, complete paths, and URLs."""

import glob
import os
import re
from pathlib import Path


def refuse_path(data: object) -> None:
    """Raise TypeError for a path in place of data."""
    if isinstance(data, str | os.PathLike):
        raise TypeError(
            f"data: expected bits or counts, got the path {os.fspath(data)!r}; pass "
            "jotlight.open(path) for a capture, and sensor.expose(jotlight.read_image(path)) for a "
            "photograph"
        )


def as_path(path: object, call: str) -> Path:
    """Return a path as :func:`complete_path` completes it.

    Refuse an empty text and other arguments, with an example of the call.
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(
            f"path: expected the name of a file, as in {call}, got {type(path).__name__}"
        )
    if not os.fspath(path):
        raise ValueError(f"path: expected the name of a file, as in {call}, got an empty text")
    return Path(complete_path(os.fspath(path)))


def complete_path(path: str) -> str:
    """Return the text of a path with a name, in which a leading ``~`` is the home folder.

    The paths ``.`` and ``..`` have no name of their own, but results and messages state one.

    Examples
    --------
    >>> complete_path("~/a.npy") == str(Path.home() / "a.npy"), complete_path("a~.npy")
    (True, 'a~.npy')
    >>> complete_path(".") == str(Path.cwd())
    True
    """
    expanded = os.path.expanduser(path)  # noqa: PTH111  Path.expanduser refuses unknown users.
    has_name = not expanded or Path(expanded).name not in ("", "..")
    return expanded if has_name else str(Path(expanded).resolve())


def url_of(path: Path) -> str | None:
    """Return the URL that a path was made from, or None. A path has one slash in place of its two.

    Examples
    --------
    >>> url_of(Path("s3://bucket/a.npy")), url_of(Path("C:/data/a.npy"))
    ('s3://bucket/a.npy', None)
    """
    if not path.parts or not re.fullmatch(r"[A-Za-z][A-Za-z0-9+.\-]+:", path.parts[0]):
        return None
    return "//".join((path.parts[0], "/".join(path.parts[1:])))


def pattern_advice(path: str | os.PathLike[str], advice: str) -> str:
    """Return advice for a path that does not exist, if it is a pattern of several files.

    Examples
    --------
    >>> pattern_advice("photos/*.png", "name one image")
    '; a pattern of several files is not taken here: name one image'
    >>> pattern_advice("photo.png", "name one image")
    ''
    """
    is_pattern = glob.has_magic(os.fspath(path))
    return f"; a pattern of several files is not taken here: {advice}" if is_pattern else ""


def as_tensors_path(path: object, call: str) -> Path:
    """Return the path of a file of tensors to write. Refuse a name with another ending.

    Examples
    --------
    >>> as_tensors_path("mine.npy", 'network.save("mine.safetensors")')
    Traceback (most recent call last):
      ...
    ValueError: mine.npy: expected a name that ends in .safetensors, as in network.save(...)
    """
    path = as_path(path, call)
    if path.suffix.lower() != ".safetensors":
        raise ValueError(f"{path}: expected a name that ends in .safetensors, as in {call}")
    return path
