"""Locks between threads that a fork of the process does not inherit."""

import os
import threading


class ProcessLock:
    """A lock between the threads of each process.

    A fork copies a lock in its state, and the thread that would release it does not exist there.
    So each process has its own lock.

    Examples
    --------
    >>> lock = ProcessLock()
    >>> with lock:
    ...     print("only one thread is here")
    only one thread is here
    """

    def __init__(self) -> None:
        self._locks: dict[int, threading.Lock] = {}

    def __enter__(self) -> None:
        self._locks.setdefault(os.getpid(), threading.Lock()).acquire()

    def __exit__(self, *_: object) -> None:
        self._locks[os.getpid()].release()
