"""The free space of disks, and a check before large results are computed or written."""

import errno
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from jotlight.errors import counted
from jotlight.output_links import resolve_output

_ADVICE = "free some space, or choose another folder"


def check_disk_space(
    outputs: Iterable[tuple[Path, int]], *, reserve: int = 0, advice: str = _ADVICE
) -> None:
    """Raise OSError if outputs do not fit on their disks, as a failed write of the first one would.

    Parameters
    ----------
    outputs : iterable of (path, int)
        The path of each output, and its number of bytes.
    reserve : int
        The number of bytes of each disk that must stay free.
    advice : str
        What to do instead.

    Examples
    --------
    >>> check_disk_space([(Path("new/a.npy"), 1000)])
    >>> check_disk_space([(Path("new/a.npy"), 1 << 70)])
    Traceback (most recent call last):
      ...
    OSError: [Errno 28] cannot write new/a.npy: No space left on device; the results need up to ...
    """
    # Folders on the same disk share its free space.
    disks: dict[int, dict[Path, int]] = {}
    for output, size in outputs:
        disks.setdefault(_folder_of(output).stat().st_dev, {})[output] = size
    rest = f", and {format_bytes(reserve)} must stay free" if reserve else ""
    for sizes in disks.values():
        first, size = next(iter(sizes)), sum(sizes.values())
        folder = _folder_of(first)
        usage = shutil.disk_usage(folder)
        is_known = usage.total > 0  # some network file systems state no sizes
        if is_known and size + reserve > usage.free:
            others = f" and {counted(len(sizes) - 1, 'other output')}" if len(sizes) > 1 else ""
            raise OSError(
                errno.ENOSPC,
                f"cannot write {first}{others}: {os.strerror(errno.ENOSPC)}; the results need up "
                f"to {format_bytes(size)}{rest}, but {folder} has only {format_bytes(usage.free)} "
                f"of free space; {advice}",
            )


def _folder_of(output: Path) -> Path:
    """Return the folder that will contain an output, or the first one above it that exists."""
    return next(each for each in resolve_output(output).parents if each.exists())


def format_bytes(size: float) -> str:
    """Return a number of bytes as a text.

    Examples
    --------
    >>> format_bytes(3 << 30), format_bytes(1000)
    ('3 GiB', '1000 B')
    """
    for unit in ("B", "KiB", "MiB", "GiB"):
        if size < 1024:
            return f"{size:.4g} {unit}"
        size /= 1024
    return f"{size:.4g} TiB"
