"""Termination signals, raised as exceptions so that temporary files are removed."""

import logging
import signal
import sys
from collections.abc import Callable
from typing import Any

_SIGNALS = ("SIGTERM", "SIGHUP")
"""A closing terminal sends SIGHUP, which Windows does not have."""

_DELAY = 0.01
"""Seconds until an exception that Python dropped is raised again."""


def exit_on_signals() -> None:
    """Raise SystemExit on each signal, with the exit code that a shell reports for it."""
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        # nohup sets SIGHUP to be ignored, and it must stay ignored.
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _exit)
    if not getattr(sys.unraisablehook, "raises_again", False):
        sys.unraisablehook = _raise_again_after(sys.unraisablehook)


def silence_pending_tasks() -> None:
    """Suppress messages about tasks that zarr has not finished."""
    logging.getLogger("asyncio").setLevel(logging.CRITICAL + 1)


def _exit(number: int, frame: object) -> None:
    for name in _SIGNALS:
        if hasattr(signal, name):
            # A further signal must not interrupt the removal of files.
            signal.signal(getattr(signal, name), lambda *_: None)
    silence_pending_tasks()
    sys.exit(128 + number)


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
