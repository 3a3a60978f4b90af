"""What all connections of a server share: the capture, two threads, and what was computed once."""

import contextlib
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.view.overlays import JotMap
from jotlight.view.state import ViewState
from jotlight.view.timeline import firing_rates
from jotlight.view.viewed import Check, Viewable

_WEIGHT = 0.3
"""Weight of the most recent time in the expected time of a method."""

MAX_SAVES = 4
"""Maximum number of files that wait to be computed."""


class Workshop:
    """The capture of a server, and the threads that compute.

    One thread counts and runs maximum likelihood, which takes milliseconds. Another one refines, so
    that a slow method never delays the counts.
    """

    def __init__(self, viewed: Viewable) -> None:
        self.viewed = viewed
        self.quick = ThreadPoolExecutor(1, "jotlight-view-quick")
        self.slow = ThreadPoolExecutor(1, "jotlight-view-slow")
        self.jots = JotMap(viewed)
        self._rates: tuple[npt.NDArray[np.float32], int] | None = None
        self._seconds: dict[Any, float] = {}
        self._saves = threading.Semaphore(MAX_SAVES)

    def close(self) -> None:
        """Stop the threads after what they compute now."""
        self.quick.shutdown(wait=False, cancel_futures=True)
        self.slow.shutdown(wait=False, cancel_futures=True)

    def rates(self, check: Check) -> tuple[npt.NDArray[np.float32], int]:
        """Return the firing rates of a complete capture, which are computed once."""
        if self._rates is None:
            self._rates = firing_rates(self.viewed, check)
        return self._rates

    def expected_seconds(self, state: ViewState) -> float | None:
        """Return the expected time of a refinement, or None before the first one."""
        return self._seconds.get(_key(state))

    def record_seconds(self, state: ViewState, seconds: float) -> None:
        """Record the time of a refinement."""
        before = self._seconds.get(_key(state), seconds)
        self._seconds[_key(state)] = before + _WEIGHT * (seconds - before)

    @contextlib.contextmanager
    def saving(self) -> Iterator[bool]:
        """Yield whether another file may be computed now."""
        is_free = self._saves.acquire(blocking=False)
        try:
            yield is_free
        finally:
            if is_free:
                self._saves.release()


def _key(state: ViewState) -> Any:
    """Return what the time of a refinement depends on. The lengths of windows are grouped."""
    length = state.window.bit_length() if state.align else 0
    return state.method, state.compare, state.align, length
