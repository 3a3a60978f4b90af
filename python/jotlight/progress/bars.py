"""Progress bars in terminals and in notebooks. Import this module late, because rich is large."""

import re
from collections.abc import Iterable
from time import monotonic
from typing import Any

from rich.console import Console
from rich.progress import Progress, ProgressColumn, SpinnerColumn, TaskID
from rich.segment import Segment

_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Control characters except tabs and ends of lines."""


def printable(text: str) -> str:
    r"""Return a text with escapes in place of control characters.

    Names and notes in files from strangers could otherwise command the terminal, for example to
    clear the screen, or to hide what follows.

    Examples
    --------
    >>> print(printable("\x1b[2Jname"))
    \x1b[2Jname
    """
    return _CONTROLS.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


class SafeConsole(Console):
    """A console that prints no control characters but those of rich itself."""

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """Yield the parts of an object to print."""
        for part in super().render(*arguments, **options):
            yield part if part.control else Segment(printable(part.text), part.style)


# Without emoji=False, rich replaces text between colons, as in a range of frames, by an emoji.
console = SafeConsole(stderr=True, highlight=False, emoji=False)
"""The console that shows bars. Other messages on it appear above a bar."""

_DELAY, _INTERVAL = 0.5, 0.1
"""Seconds until a bar appears in a notebook, and between its changes."""


def make_bar(*columns: ProgressColumn) -> Progress:
    """Return a progress bar that shows on a terminal or in a notebook, and nowhere else.

    On a terminal it vanishes at the end. In a notebook it stays, and short work has none.
    """
    if console.is_jupyter:
        return _NotebookBar(*columns)
    return Progress(
        SpinnerColumn(),
        *columns,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


class _NotebookBar(Progress):
    """A bar in the output of a cell. Unlike the bars of rich, it works without ipywidgets."""

    def __init__(self, *columns: ProgressColumn) -> None:
        super().__init__(*columns, auto_refresh=False)
        self._next = monotonic() + _DELAY
        self._output: Any = None

    def start(self) -> None:
        """Do nothing: the bar appears later."""

    def refresh(self) -> None:
        """Do nothing: :meth:`update` shows changes."""

    def update(self, task_id: TaskID, **changes: Any) -> None:
        """Change the task, and show it if some time has passed."""
        super().update(task_id, **changes)
        if monotonic() >= self._next:
            self._show()

    def stop(self) -> None:
        """Show the last state, if the bar has appeared."""
        if self._output is not None:
            self._show()

    def _show(self) -> None:
        from IPython.display import display

        if self._output is None:
            self._output = display(self, display_id=True)
        else:
            self._output.update(self)
        self._next = monotonic() + _INTERVAL
