"""Keep every library to a number of threads."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

TASKS = Path("/proc/self/task")


@contextlib.contextmanager
def limited(threads: int) -> Iterator[None]:
    """Let all threads of this process share `threads` cores, where the system can do that.

    That holds for libraries too which cannot be told; those that can are told besides.
    """
    tell(threads)
    before = os.sched_getaffinity(0) if TASKS.is_dir() else set()
    keep_to(set(sorted(before)[:threads]))
    try:
        yield
    finally:
        keep_to(before)


def tell(threads: int) -> None:
    with contextlib.suppress(ImportError):
        from threadpoolctl import threadpool_limits

        threadpool_limits(threads)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(threads)
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(threads)


def keep_to(cores: set[int]) -> None:
    if not cores:
        return
    for task in TASKS.iterdir():
        with contextlib.suppress(ProcessLookupError):  # a thread may have ended just now
            os.sched_setaffinity(int(task.name), cores)
