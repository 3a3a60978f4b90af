"""Errors and warnings of jotlight.

Bad values raise :class:`ValueError`, bad types :class:`TypeError`, and bad files :class:`OSError`
or :class:`ValueError`. This module defines only the cases that have no built-in class.

Messages name the parameter and, in brackets, its option of the command line, as in
``counts=True (--counts)``. The command line shows the option alone.
"""

import sys
import warnings


class JotlightWarning(UserWarning):
    """A warning about something that jotlight did, such as inpainting a dead pixel."""


class MissingExtraError(ImportError):
    """An error that says which optional package to install."""


def warn(message: str) -> None:
    """Warn at the first line of the call stack that is outside of jotlight."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] == "jotlight":
        level, frame = level + 1, frame.f_back
    warnings.warn(message, JotlightWarning, stacklevel=level)
