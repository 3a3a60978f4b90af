"""The progress of long work: a bar (`bars`), or a function of the caller."""

import contextlib
import contextvars
import sys
from collections.abc import Callable, Iterator
from typing import Protocol

Progress = bool | Callable[[float], object] | None
"""Whether to show a progress bar; or a function that takes the completed fraction, from 0 to 1.

None shows a bar in a notebook only.
"""


class Update(Protocol):
    """Report the completed fraction of some work."""

    def __call__(self, fraction: float, text: str | None = None) -> object:
        """Take the fraction, from 0 to 1, and optionally a new text beside the bar."""


_is_part = contextvars.ContextVar("_is_part", default=False)
"""Whether the work is a part of work whose progress is already shown."""


def check_progress(progress: object) -> None:
    """Raise TypeError unless this is a value that :func:`shown_progress` takes.

    Examples
    --------
    >>> check_progress("yes")
    Traceback (most recent call last):
      ...
    TypeError: progress: expected True, False, or a function of the fraction, got 'yes'
    """
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise TypeError(
            f"progress: expected True, False, or a function of the fraction, got {progress!r}"
        )


@contextlib.contextmanager
def shown_progress(progress: Progress, title: str) -> Iterator[Update]:
    """Show the progress of some work while the block runs, and yield a function that reports it.

    Parameters
    ----------
    progress : bool or callable, optional
        Whether to show a bar on a terminal or in a notebook; or a function that takes the completed
        fraction. None: a bar in a notebook, except for a part of work that has a bar.
    title : str
        The text beside the bar.

    Raises
    ------
    TypeError
        When `progress` is something else.

    Examples
    --------
    >>> with shown_progress(print, "counting") as update:
    ...     update(0.5)
    0.5
    """
    check_progress(progress)
    if progress is None:
        progress = _in_notebook() and not _is_part.get()
    token = _is_part.set(True)
    try:
        if progress is False:
            yield lambda fraction, text=None: None
        elif callable(progress):
            report = progress
            yield lambda fraction, text=None: report(fraction)
        else:
            with _bar(title) as update:
                yield update
    finally:
        _is_part.reset(token)


@contextlib.contextmanager
def _bar(title: str) -> Iterator[Update]:
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn

    from jotlight.progress.bars import make_bar

    text = TextColumn("{task.description}", markup=False)
    time = TimeRemainingColumn(elapsed_when_finished=True)
    with make_bar(text, BarColumn(bar_width=24), TaskProgressColumn(), time) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda fraction, text=None: bar.update(task, completed=fraction, description=text)


def equal_steps(update: Update, number: int) -> Callable[[str], Callable[[float], object]]:
    """Return a function that begins the next of some equal steps.

    It takes the text of the step, and returns a function that takes the completed fraction of it.

    Examples
    --------
    >>> begin = equal_steps(lambda fraction, text: print(fraction, text), 2)
    >>> _ = begin("first")
    0.0 first
    >>> begin("second")(0.5)
    0.5 second
    0.75 second
    """
    begun = 0

    def begin(text: str) -> Callable[[float], object]:
        nonlocal begun
        start, begun = begun / number, begun + 1
        update(start, text)
        return lambda fraction: update(start + fraction / number, text)

    return begin


def _in_notebook() -> bool:
    # rich is imported only where a kernel runs.
    if "ipykernel" not in sys.modules:
        return False
    from jotlight.progress.bars import console

    return console.is_jupyter
