"""A thread that counts how often it can run."""

import contextlib
import sys
import threading


@contextlib.contextmanager
def ticking(work):
    """Yield a list with one number, which another thread increments before it calls `work`.

    Nothing but `work` and the engine lets the other thread run, or this one.
    """
    interval, count, stop = sys.getswitchinterval(), [0], threading.Event()

    def tick():
        while not stop.is_set():
            count[0] += 1
            work()

    thread = threading.Thread(target=tick)
    sys.setswitchinterval(1000)
    thread.start()
    try:
        yield count
    finally:
        stop.set()
        sys.setswitchinterval(interval)
        thread.join()
