"""Errors and warnings of jotlight.

Bad values raise :class:`ValueError`, bad types :class:`TypeError`, and bad files :class:`OSError`
or :class:`ValueError`. This module defines only the cases that have no built-in class.

A message names the Python parameter and, in parentheses, the option of the command line, as in
``counts=True (--counts)``. The command line shows only the option.
"""

import contextlib
import importlib
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

_hidden: ContextVar[tuple[str, ...]] = ContextVar("hidden", default=())
"""Texts whose warnings this thread hides."""

_recorded: ContextVar[list[str] | None] = ContextVar("recorded", default=None)
"""Where this thread collects the messages of warnings, if it does."""


class JotlightWarning(UserWarning):
    """A warning about something that jotlight did, such as inpainting a dead pixel."""


class PeriodicRatesWarning(JotlightWarning):
    """A warning about rates of jots that repeat, as under a color filter mosaic.

    jotlight also raises it if the sensor that the data carry has a mosaic, but the caller passes a
    gray sensor. It tests all data except those of :meth:`jotlight.Sensor.expose`. If the sensor is
    gray:

    >>> warnings.filterwarnings("ignore", category=PeriodicRatesWarning)
    """


class SeveralArraysError(ValueError):
    """An error for a file of several arrays of which the caller has to name one.

    Parameters
    ----------
    message : str
        The message.
    names : sequence of str
        The names of the arrays.
    """

    def __init__(self, message: str, names: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.names = tuple(names)

    @classmethod
    def of_file(
        cls,
        path: object,
        names: Sequence[str],
        key: str | None,
        kind: str,
        unreadable: Mapping[str, str] = MappingProxyType({}),
    ) -> Self:
        """Return the error for a file of some arrays, and a key that is none of their names.

        `unreadable` holds the names of arrays that cannot be read, and for each a word that says
        why.

        Examples
        --------
        >>> str(SeveralArraysError.of_file("a.npz", ["x", "y"], "z", "array"))
        "a.npz: expected key= (--key) to name one of its arrays: x, y; got 'z'"
        """
        texts = (f"{name} ({unreadable[name]})" if name in unreadable else name for name in names)
        listed = ", ".join(texts) or f"it has no numeric {kind}"
        got = "" if key is None else f"; got {key!r}"
        text = f"{path}: expected key= (--key) to name one of its {kind}s: {listed}{got}"
        return cls(text, names)


class ChangedFileError(OSError):
    """An error for a file that has changed since it was opened.

    Parameters
    ----------
    message : str
        The message, which names the file.
    """

    @classmethod
    def of_file(cls, path: object) -> Self:
        """Return the error for a file that was written, replaced, or resized.

        Examples
        --------
        >>> print(ChangedFileError.of_file("a.npy"))
        a.npy: the file has changed since it was opened, so its bits are not reliable; open it \
again when no program writes to it
        """
        return cls(
            f"{path}: the file has changed since it was opened, so its bits are not reliable; open "
            "it again when no program writes to it"
        )


class MissingExtraError(ImportError):
    """An error for a missing optional package. The message says how to install it."""


def error_message(error: BaseException) -> str:
    """Return the message of an error, which names the file if there is one, and its notes.

    Examples
    --------
    >>> error_message(ValueError("window: expected at most 64 frames"))
    'window: expected at most 64 frames'
    >>> error_message(PermissionError(13, "Permission denied", "a.npy"))
    'cannot access a.npy: Permission denied'
    >>> error_message(MemoryError())
    'MemoryError'
    """
    text, notes = str(error) or type(error).__name__, getattr(error, "__notes__", [])
    if isinstance(error, OSError) and error.strerror:
        # The text of Python begins with the number of the error, which helps nobody.
        if error.filename is None:
            text = _lost_folder() or error.strerror
        elif isinstance(error, FileNotFoundError):
            text = f"there is no file {error.filename}"
        else:
            text = f"cannot access {error.filename}: {error.strerror}"
    return "; ".join([text, *notes])


def _lost_folder() -> str | None:
    """Return that the current folder is gone, and what to do, or None if it exists."""
    try:
        Path.cwd()
    except FileNotFoundError:
        return (
            "the current folder does not exist any more; change to another folder, or create it "
            "again and change to it"
        )
    return None


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, which is plural unless the number is 1.

    Examples
    --------
    >>> counted(1, "capture"), counted(0, "capture")
    ('1 capture', '0 captures')
    """
    return f"{number} {plural(number, noun)}"


def plural(number: float, noun: str) -> str:
    """Return the noun of a number that is written in another way, such as "1,000".

    Examples
    --------
    >>> f"{1000:,} {plural(1000, 'frame')}"
    '1,000 frames'
    """
    return noun if number == 1 else f"{noun}s"


@contextlib.contextmanager
def needs_module(name: str, message: str) -> Iterator[None]:
    """Raise MissingExtraError with a message if the code inside imports a module that is missing.

    If the module is installed, but its import fails, the error states the cause.

    Examples
    --------
    >>> with needs_module("magic", "spells need magic: pip install 'jotlight[magic]'"):
    ...     import magic
    Traceback (most recent call last):
      ...
    jotlight.errors.MissingExtraError: spells need magic: pip install 'jotlight[magic]'
    """
    try:
        yield
    except MissingExtraError:
        raise  # the code inside needs another one
    except ImportError as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if missing and f"{name}.".startswith(f"{missing}."):
            raise MissingExtraError(message) from error
        raise ImportError(
            f"{name} is installed, but its import failed ({error}); repair its installation"
        ) from error


def import_extra(name: str, extra: str, purpose: str, instead: str = "") -> Any:
    """Return an optional module.

    `instead` says what the caller can do without the package.

    Raises
    ------
    MissingExtraError
        When the module is not installed. The message states the purpose and the extra.
    ImportError
        When the module is installed, but its import fails. The message states the cause.

    Examples
    --------
    >>> import_extra("magic.wand", "magic", "spells")
    Traceback (most recent call last):
      ...
    jotlight.errors.MissingExtraError: spells need magic: pip install 'jotlight[magic]'
    """
    package = name.partition(".")[0]
    advice = ", ".join(filter(None, (f"pip install 'jotlight[{extra}]'", instead)))
    with needs_module(name, f"{purpose} need {package}: {advice}"):
        return importlib.import_module(name)


def warn(message: str, category: type[JotlightWarning] = JotlightWarning) -> None:
    """Issue a warning that points to the line of code which called jotlight.

    Calls of modules pass through PyTorch, whose lines are left out, too.
    """
    if any(text in message for text in _hidden.get()):
        return
    if (recorded := _recorded.get()) is not None:
        recorded.append(message)
        return
    level, frame = 1, sys._getframe()
    inside = "jotlight", "torch"
    while frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] in inside:
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


@contextlib.contextmanager
def hide_warnings(text: str = "") -> Iterator[None]:
    """Hide the warnings of jotlight whose message contains a text, in this thread only.

    ``warnings.catch_warnings`` changes the filters of all threads, and threads of dask that use it
    at the same time leave wrong ones.

    Examples
    --------
    >>> with hide_warnings("no valid bit"):
    ...     warn("2 of 64 pixels have no valid bit")
    """
    token = _hidden.set((*_hidden.get(), text))
    try:
        yield
    finally:
        _hidden.reset(token)


@contextlib.contextmanager
def record_warnings() -> Iterator[list[str]]:
    """Collect the messages of jotlight's warnings in place of issuing them, in this thread only.

    Examples
    --------
    >>> with record_warnings() as messages:
    ...     warn("2 of 64 pixels have no valid bit")
    >>> messages
    ['2 of 64 pixels have no valid bit']
    """
    messages: list[str] = []
    token = _recorded.set(messages)
    try:
        yield messages
    finally:
        _recorded.reset(token)


def percent_advice(value: float, minimum: float) -> str:
    """Return advice for a number that looks like a percentage in place of a fraction.

    A fraction has a `minimum`, and is below 1.

    Examples
    --------
    >>> percent_advice(95, 0.5), percent_advice(1.5, 0.5)
    ('; write 0.95 for 95 %', '')
    """
    is_percentage = value > 1 and 100 * minimum <= value < 100
    return f"; write {value / 100:g} for {value:g} %" if is_percentage else ""
