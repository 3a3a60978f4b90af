"""Outputs that are symbolic links."""

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
