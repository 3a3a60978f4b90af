"""What goes wrong, said in the user's words.

Bad values raise :class:`ValueError`, bad types :class:`TypeError`, files :class:`OSError` or
:class:`ValueError`; only what has no built-in name is named here.

Advice names the parameter with its option in brackets, as in ``counts=True (--counts)``; the
command line shows the option alone.
"""

import sys
import warnings


class JotlightWarning(UserWarning):
    """Something was done that the user should know of, such as a dead pixel filled in."""


class MissingExtraError(ImportError):
    """An optional package is needed and not installed."""


def warn(message: str) -> None:
    """Warn at the line outside of jotlight that led here."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] == "jotlight":
        level, frame = level + 1, frame.f_back
    warnings.warn(message, JotlightWarning, stacklevel=level)
