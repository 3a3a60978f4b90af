"""Termination signals, raised as exceptions so that temporary files are removed."""

import contextlib
import logging
import os
import signal
import sys
import warnings
from collections.abc import Callable
from typing import Any, NoReturn

_SIGNALS = ("SIGTERM", "SIGHUP")
"""A closing terminal sends SIGHUP, which Windows does not have."""

STOPPED_BY_SIGNAL = 128
"""Exit code of a process that a signal stopped, less the number of the signal."""

_DELAY = 0.01
"""Seconds until an exception that Python dropped is raised again."""


class StoppedBySignalError(SystemExit):
    """The end of the process by a signal, unlike a SystemExit that other code raises."""


def exit_on_signals() -> None:
    """Raise StoppedBySignalError on each signal, with the exit code that a shell reports for it."""
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        # nohup sets SIGHUP to be ignored, and it must stay ignored.
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _exit)
    if not getattr(sys.unraisablehook, "raises_again", False):
        sys.unraisablehook = _raise_again_after(sys.unraisablehook)


def end_at_once(status: int) -> NoReturn:
    """End the process without waiting for other threads, after all files are closed or removed.

    A library may still compute in another thread. Some libraries abort if Python ends meanwhile.
    """
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(status)


def silence_pending_tasks() -> None:
    """Suppress messages about tasks that zarr has not begun or finished."""
    warnings.filterwarnings("ignore", "coroutine .* was never awaited", RuntimeWarning)
    logging.getLogger("asyncio").setLevel(logging.CRITICAL + 1)


def _exit(number: int, frame: object) -> None:
    for name in _SIGNALS:
        if hasattr(signal, name):
            # A further signal must not interrupt the removal of files.
            signal.signal(getattr(signal, name), lambda *_: None)
    silence_pending_tasks()
    raise StoppedBySignalError(STOPPED_BY_SIGNAL + number)


def _raise_again_after(hook: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a hook that raises our exceptions again where Python drops them, as in destructors."""

    def raising_hook(dropped: Any) -> None:
        reason = dropped.exc_value
        if not isinstance(reason, SystemExit | KeyboardInterrupt) or sys.platform == "win32":
            hook(dropped)
            return

        def again(*_: object) -> None:
            raise type(reason)(*reason.args)

        signal.signal(signal.SIGALRM, again)
        signal.setitimer(signal.ITIMER_REAL, _DELAY)

    vars(raising_hook)["raises_again"] = True
    return raising_hook
