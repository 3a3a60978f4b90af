"""The free space of disks, and a check before large results are computed or written."""

import shutil
from collections.abc import Iterable
from pathlib import Path

_ADVICE = "free some space, or choose another folder"


def check_disk_space(
    outputs: Iterable[tuple[Path, int]], *, reserve: int = 0, advice: str = _ADVICE
) -> None:
    """Raise OSError if outputs do not fit on their disks.

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
    OSError: the results need up to 1.074e+09 TiB, but ... has only ... of free space; free some ...
    """
    needed: dict[Path, int] = {}
    for output, size in outputs:
        folder = next(each for each in output.resolve().parents if each.exists())
        needed[folder] = needed.get(folder, 0) + size
    # Folders on the same disk share its free space.
    disks: dict[int, tuple[Path, int]] = {}
    for folder, size in needed.items():
        device = folder.stat().st_dev
        disks[device] = folder, disks.get(device, (folder, 0))[1] + size
    rest = f", and {format_bytes(reserve)} must stay free" if reserve else ""
    for folder, size in disks.values():
        free = shutil.disk_usage(folder).free
        if size + reserve > free:
            raise OSError(
                f"the results need up to {format_bytes(size)}{rest}, but {folder} has only "
                f"{format_bytes(free)} of free space; {advice}"
            )


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
