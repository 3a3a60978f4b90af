"""What the user sees while and after a command works."""

import contextlib
import re
import warnings
from collections.abc import Callable, Iterator
from typing import Protocol, TextIO

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from jotlight.errors import JotlightWarning
from jotlight.estimators.convergence import Iteration
from jotlight.training import Record

# What stands between colons, as in a range of frames, is no emoji.
out = Console(highlight=False, emoji=False)
err = Console(stderr=True, highlight=False, emoji=False)


class Begin(Protocol):
    """Begins a step of a bar."""

    def __call__(self, name: str, size: float = 1.0) -> Callable[[float], None]:
        """Give the function that takes the share that is done."""


_said: set[str] = set()

_ADVICE = re.compile(r"[\w.]+[=\[(]\S* \((--[^()]+)\)")


def _of_options(message: str) -> str:
    """Advice such as ``counts=True (--counts)`` with the option alone."""
    return _ADVICE.sub(r"\1", message)


def error(message: str) -> None:
    """Say in one line what went wrong."""
    err.print(f"[bold red]error:[/] {escape(_of_options(message))}", soft_wrap=True)


def show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print our own warnings in one line, each once, and others as Python does."""
    if issubclass(category, JotlightWarning):
        if str(message) in _said:
            return
        _said.add(str(message))
        err.print(f"[yellow]warning:[/] {escape(_of_options(str(message)))}", soft_wrap=True)
    else:
        err.print(escape(warnings.formatwarning(message, category, filename, lineno, line)), end="")


@contextlib.contextmanager
def silent(wanted: bool) -> Iterator[None]:
    """Print nothing while the block runs, if so wanted; an error that ends it is said."""
    before = out.quiet, err.quiet
    out.quiet = err.quiet = wanted
    try:
        yield
    finally:
        out.quiet, err.quiet = before


@contextlib.contextmanager
def progress(total: float | None, *, remaining: bool = False) -> Iterator[Begin]:
    """Show a bar over a number of steps while the block runs, on a terminal only.

    Without a total the bar moves to and fro, for work that does not tell how far it is.

    Gives a function that begins the next step, by name, and returns a function that takes
    the share of it that is done. A step counts as 1 of the total, or as much as it is given.
    For long work it can show how much time remains.
    """
    time = [TimeRemainingColumn(), TextColumn("left")] if remaining else [TimeElapsedColumn()]
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        *time,
        console=err,
        transient=True,
        disable=not err.is_terminal,
    )
    with bar:
        task = bar.add_task("", total=total)
        begun = 0.0

        def begin(name: str, size: float = 1.0) -> Callable[[float], None]:
            nonlocal begun
            first, begun = begun, begun + size
            bar.update(task, description=name, completed=first)
            return lambda share: bar.update(task, completed=first + size * share)

        yield begin


@contextlib.contextmanager
def live_iterations(title: str) -> Iterator[Callable[[Iteration], None]]:
    """Show how an iterative method comes nearer, on a terminal only.

    Gives a function that takes each iteration.
    """
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=16),
        TimeElapsedColumn(),
        console=err,
        transient=True,
        disable=not err.is_terminal,
    )
    with bar:
        task = bar.add_task(title, total=1.0)

        def show(step: Iteration) -> None:
            words = f"iteration {step.number}, residual {step.residual:.1e} (to {step.tol:g})"
            bar.update(task, description=words, completed=step.progress)

        yield show


@contextlib.contextmanager
def live_training(steps: int) -> Iterator[Callable[[Record], None]]:
    """Show a run: a live line on a terminal, and elsewhere a line at each tenth of the way.

    Gives a function that takes the record of each step.
    """
    bar = Progress(
        SpinnerColumn(),
        TextColumn("step {task.completed:.0f}/{task.total:.0f}"),
        BarColumn(bar_width=24),
        TextColumn("{task.description}"),
        TimeRemainingColumn(),
        TextColumn("left"),
        console=err,
        transient=True,
        disable=not err.is_terminal,
    )
    with bar:
        task = bar.add_task("starting", total=steps)
        test = ""

        def show(record: Record) -> None:
            nonlocal test
            if record.test_psnr is not None:
                test = f"  test {record.test_psnr:.2f} dB"
            if record.held_out is not None:
                test = f"  held out {record.held_out:.5f} nats per bit"
            words = f"cost {record.loss:.4g}  gradient {record.gradient_norm:.3g}{test}"
            bar.update(task, completed=record.step, description=words)
            every = max(1, steps // 10)
            if not err.is_terminal and (record.step % every == 0 or record.step == steps):
                err.print(f"step {record.step}/{steps}  {words}", soft_wrap=True)

        yield show
