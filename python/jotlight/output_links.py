"""Outputs that are symbolic links, and the files beside outputs."""

from pathlib import Path


def follow_link(path: Path) -> Path:
    """Return the path to which an output leads if it is a symbolic link, which need not exist.

    Other paths are returned as they are.

    Raises
    ------
    OSError
        When links form a loop.

    Examples
    --------
    >>> follow_link(Path("a/b.npy")).as_posix()
    'a/b.npy'
    """
    return resolve_output(path) if path.is_symlink() else path


def name_beside(output: Path, ending: str) -> Path:
    """Return the path of a file beside an output, whose name is that of the output and an ending.

    If the output is a symbolic link, the file lies beside the file to which it leads. So it is
    found by all names of the output, and describes no other file if the link is changed.

    Raises
    ------
    OSError
        When links form a loop.

    Examples
    --------
    >>> name_beside(Path("a/b.npy"), ".json").as_posix()
    'a/b.npy.json'
    """
    own = follow_link(output)
    return own.with_name(own.name + ending)


def resolve_output(path: Path) -> Path:
    """Return the absolute path of an output without symbolic links, which need not exist.

    Raises
    ------
    OSError
        When links form a loop.

    Examples
    --------
    >>> resolve_output(Path("a/../b.npy")) == Path.cwd() / "b.npy"
    True
    """
    try:
        target = path.resolve()
    except RuntimeError:
        is_loop = True
    else:  # Python 3.13 returns a path with the loop
        is_loop = any(part.is_symlink() for part in (target, *target.parents))
    if is_loop:
        raise OSError(f"cannot write {path}: its symbolic links form a loop; choose another name")
    return target
