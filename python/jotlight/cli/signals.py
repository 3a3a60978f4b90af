"""Signals that end a command: as exceptions, so that temporary files are removed."""

import logging
import signal
import sys
from collections.abc import Callable
from typing import Any

_SIGNALS = ("SIGTERM", "SIGHUP")
"""The second is what a closing terminal sends; Windows does not have it."""

_SOON = 0.01
"""Seconds."""


def stop_by_exceptions() -> None:
    """Make the signals raise SystemExit, with the status that a shell makes of them too."""
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        # What the caller ignores, as nohup does, stays so.
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _stop)
    if not getattr(sys.unraisablehook, "raises_again", False):
        sys.unraisablehook = _raising_again(sys.unraisablehook)


def quiet_tasks() -> None:
    """Let nothing be said of tasks that zarr has not ended."""
    logging.getLogger("asyncio").setLevel(logging.CRITICAL + 1)


def _stop(number: int, frame: object) -> None:
    for name in _SIGNALS:
        if hasattr(signal, name):
            # Nothing is to interrupt the removal of files; to ignore the signal would say so.
            signal.signal(getattr(signal, name), lambda *_: None)
    quiet_tasks()
    sys.exit(128 + number)


def _raising_again(before: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """A hook for exceptions that Python drops, as it does in destructors, to raise ours again."""

    def hook(dropped: Any) -> None:
        reason = dropped.exc_value
        if not isinstance(reason, SystemExit | KeyboardInterrupt) or sys.platform == "win32":
            before(dropped)
            return

        def again(*_: object) -> None:
            raise type(reason)(*reason.args)

        signal.signal(signal.SIGALRM, again)
        signal.setitimer(signal.ITIMER_REAL, _SOON)

    vars(hook)["raises_again"] = True
    return hook
