"""Errors and warnings of jotlight.

Bad values raise :class:`ValueError`, bad types :class:`TypeError`, and bad files :class:`OSError`
or :class:`ValueError`. This module defines only the cases that have no built-in class.

A message names the Python parameter and, in parentheses, the option of the command line, as in
``counts=True (--counts)``. The command line shows only the option.
"""

import sys
import warnings


class JotlightWarning(UserWarning):
    """A warning about something that jotlight did, such as inpainting a dead pixel."""


class PeriodicRatesWarning(JotlightWarning):
    """A warning about rates of jots that repeat, as under a color filter mosaic.

    Data are tested unless :meth:`jotlight.Sensor.expose` simulated them. If the sensor is gray:

    >>> warnings.filterwarnings("ignore", category=PeriodicRatesWarning)
    """


class MissingExtraError(ImportError):
    """An error for a missing optional package. The message says how to install it."""


def warn(message: str, category: type[JotlightWarning] = JotlightWarning) -> None:
    """Issue a warning that points to the line of code which called jotlight."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] == "jotlight":
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
