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
    if not path.is_symlink():
        return path
    try:
        target = path.resolve()
    except (OSError, RuntimeError):
        target = path
    if target.is_symlink():
        raise OSError(f"cannot write {path}: its symbolic links form a loop; choose another name")
    return target
