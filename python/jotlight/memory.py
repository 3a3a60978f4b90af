"""The memory that is available, and a check before a large array is allocated."""

import os
from pathlib import Path

_MEMORY_INFO = Path("/proc/meminfo")

_MAX_BYTES = 1 << 34
"""Maximum size of an array if the system does not state its memory."""


def available_bytes() -> int:
    """Return the memory in bytes that programs can still use, or 16 GiB if it is unknown.

    Linux states the available memory. Other systems state at most the memory of the machine.
    """
    try:
        for line in _MEMORY_INFO.read_text("ascii").splitlines():
            name, _, value = line.partition(":")
            if name == "MemAvailable":
                return int(value.split()[0]) * 1024
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (OSError, ValueError, AttributeError):
        return _MAX_BYTES


def check_memory(what: str, size: int, remedy: str) -> None:
    """Raise MemoryError if an array has more bytes than the available memory.

    Systems often grant more memory than they have, and end a process that uses it.

    Parameters
    ----------
    what : str
        The array, for the message.
    size : int
        Number of bytes.
    remedy : str
        What to do instead.

    Examples
    --------
    >>> check_memory("bits", 1000, "take a slice")
    >>> check_memory("bits", 10**18, "take a slice")
    Traceback (most recent call last):
      ...
    MemoryError: bits: expected an array that fits into ..., got 1e+09 GB; take a slice
    """
    available = available_bytes()
    if size > available:
        raise MemoryError(
            f"{what}: expected an array that fits into the available {available / 1e9:.3g} GB of "
            f"memory, got {size / 1e9:.3g} GB; {remedy}"
        )
