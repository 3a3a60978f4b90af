"""Output to the terminal: results, warnings, errors, and progress."""

import contextlib
import os
import re
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import IO, Any, Protocol, TextIO

from rich.markup import escape
from rich.progress import (
    BarColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from jotlight.errors import JotlightWarning
from jotlight.estimators.iterative.convergence import Iteration, IterationCallback, follow_slowest
from jotlight.progress.bars import SafeConsole, console, make_bar
from jotlight.training import Record
from jotlight.training.reporting import StepDescriber


class _Output(SafeConsole):
    """The standard output."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as :class:`rich.console.Console`; errors name the standard output."""
        try:
            super().print(*objects, **options)
        except BrokenPipeError:
            raise
        except OSError as error:
            _discard(self.file)
            raise OSError(f"cannot write to the standard output: {error.strerror}") from error


def _discard(file: IO[str]) -> None:
    """Discard buffered text, which Python would otherwise try to write again when it ends."""
    with contextlib.suppress(OSError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, file.fileno())
        os.close(null)


out = _Output(highlight=False, emoji=False, markup=False)  # names may contain brackets
err = console

_LOG_SECONDS = 60.0
"""Time without a line after which a training prints one."""

shown_warnings: set[str] = set()

_NUMBER_OF_PIXELS = re.compile(r"^[\d,]+ of [\d,]+ pixels (is|are) ")

_PYTHON_ADVICE = re.compile(r"(?:jotlight\.\w+\(.*?\)|[\w.]+[=\[(]\S*) \((--[^()]+)\)")
"""Advice of the library, such as ``counts=True (--counts)``, or a whole call of jotlight."""


def with_options_only(message: str) -> str:
    """Return a message whose advice names the option instead of the Python parameter."""
    return _PYTHON_ADVICE.sub(r"\1", message)


def shape_text(shape: Iterable[int]) -> str:
    """Return the shape of an array as a text.

    Examples
    --------
    >>> shape_text((24, 30))
    '24 x 30'
    """
    return " x ".join(map(str, shape))


def report(*lines: str) -> None:
    """Print results to the standard output."""
    for line in lines:
        out.print(with_options_only(line), soft_wrap=True)


def caution(label: str, message: str) -> None:
    """Print a remark with a highlighted label to the standard error."""
    text = escape(with_options_only(message))
    err.print(f"[yellow]{escape(label)}:[/] {text}", soft_wrap=True)


def error(message: str) -> None:
    """Print an error in one line."""
    err.print(f"[bold red]error:[/] {escape(with_options_only(message))}", soft_wrap=True)


def show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print each warning of jotlight once, in one line, and others as Python does.

    Warnings that differ only in their number of pixels, as of the images of a film, are the same.
    The parameters are those of :func:`warnings.showwarning`.
    """
    if not issubclass(category, JotlightWarning):
        text = warnings.formatwarning(message, category, filename, lineno, line)
        err.print(escape(text), end="")
        return
    text = _NUMBER_OF_PIXELS.sub("", str(message))
    if text not in shown_warnings:
        shown_warnings.add(text)
        caution("warning", str(message))


@contextlib.contextmanager
def silenced(enabled: bool) -> Iterator[None]:
    """Suppress all output while the block runs, if enabled."""
    before = out.quiet, err.quiet
    out.quiet = err.quiet = enabled
    try:
        yield
    finally:
        out.quiet, err.quiet = before


class Begin(Protocol):
    """Begin the next step of a progress bar."""

    def __call__(self, name: str, size: float = 1.0) -> Callable[[float], None]:
        """Return a function that takes the fraction of the step that is done."""


@contextlib.contextmanager
def progress(total: float | None, *, remaining: bool = False) -> Iterator[Begin]:
    """Show a progress bar while the block runs.

    Parameters
    ----------
    total : float or None
        Number of steps. With None the bar moves to and fro, for work without progress reports.
    remaining : bool
        Whether to show the remaining time instead of the elapsed time.

    Yields
    ------
    Begin
        Takes the name of the next step, and the part of the total that it counts as.
    """
    time = [TimeRemainingColumn(), TextColumn("left")] if remaining else [TimeElapsedColumn()]
    text = TextColumn("{task.description}", markup=False)
    bar = make_bar(text, BarColumn(), TaskProgressColumn(), *time)
    with bar:
        task = bar.add_task("", total=total)
        next_start = 0.0

        def begin(name: str, size: float = 1.0) -> Callable[[float], None]:
            nonlocal next_start
            start, next_start = next_start, next_start + size
            bar.update(task, description=name, completed=start)
            return lambda fraction: bar.update(task, completed=start + size * fraction)

        yield begin


@contextlib.contextmanager
def live_iterations(title: str) -> Iterator[IterationCallback]:
    """Show the convergence of an iterative method: that of the slowest channel.

    Yields
    ------
    callable
        Takes each iteration.
    """
    bar = make_bar(TextColumn("{task.description}"), BarColumn(bar_width=16), TimeElapsedColumn())
    with bar:
        task = bar.add_task(title, total=1.0)

        def show(step: Iteration) -> None:
            text = f"iteration {step.number}, residual {step.residual:.1e} (to {step.tol:g})"
            bar.update(task, description=text, completed=step.progress)

        yield follow_slowest(show)


def print_steps(title: str, steps: int) -> Callable[[Record], None]:
    """Return a callback that prints a title.

    Unless a terminal has a bar, it also prints ten lines, and one each minute. It takes the record
    of each step.
    """
    describe, interval = StepDescriber(steps), max(1, steps // 10)
    titles, printed = [title], time.monotonic()

    def show(record: Record) -> None:
        nonlocal printed
        if titles:
            err.print(titles.pop(), soft_wrap=True, markup=False)
        text, now = describe(record), time.monotonic()
        is_due = record.step % interval == 0 or record.step == steps or now - printed > _LOG_SECONDS
        if not err.is_terminal and is_due:
            err.print(text, soft_wrap=True)
            printed = now

    return show
