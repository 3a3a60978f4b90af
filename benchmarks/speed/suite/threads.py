"""A limit on the threads and cores of every library."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from suite.machine import cores

TASKS = Path("/proc/self/task")
LIMITS: list[int] = []
"""The limits in force, of which the last one holds."""


@contextlib.contextmanager
def limited(threads: int) -> Iterator[None]:
    """Restrict all threads of this process to `threads` cores, where the system can do that.

    This also restricts libraries without a setting for it. The settings of the others are set too.
    """
    LIMITS.append(threads)
    set_library_threads(threads)
    before = os.sched_getaffinity(0) if TASKS.is_dir() else set()
    bind_threads(set(sorted(before)[:threads]))
    try:
        yield
    finally:
        bind_threads(before)
        LIMITS.pop()


def allowed_threads() -> int:
    """Return the number of threads that a program may use now."""
    return LIMITS[-1] if LIMITS else cores()


def set_library_threads(threads: int) -> None:
    with contextlib.suppress(ImportError):
        from threadpoolctl import threadpool_limits

        threadpool_limits(threads)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(threads)
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(threads)


def bind_threads(cores: set[int]) -> None:
    if not cores:
        return
    for task in TASKS.iterdir():
        with contextlib.suppress(ProcessLookupError):  # a thread may have ended just now
            os.sched_setaffinity(int(task.name), cores)
