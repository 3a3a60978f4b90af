"""The base of the dock widgets: it works in a thread, and states the result or the error."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from magicgui import widgets

from jotlight.errors import error_message
from jotlight.napari.lazy import LayerData

Result = tuple[list[LayerData], str]
"""Layers to add, and a text about them, or "" for their names."""

_EXPECTED_ERRORS = (ValueError, TypeError, OSError, ImportError, MemoryError)
"""Errors whose message says what to do. All others come from a mistake in the program."""


class BackgroundWidget(widgets.Container):
    """A dock widget whose buttons are disabled while it works.

    Parameters
    ----------
    viewer : Viewer
        The window of napari.
    controls : list of widgets
        The controls. A message follows them.
    """

    def __init__(self, viewer: Any, controls: list[Any]) -> None:
        self._viewer = viewer
        self._buttons = [each for each in controls if isinstance(each, widgets.PushButton)]
        self.message = widgets.TextEdit(value="")
        self.message.read_only = True
        super().__init__(widgets=[*controls, self.message])

    def _start(self, work: Callable[[], Result]) -> None:
        """Do work in a thread of napari, then add its layers."""
        from napari.qt.threading import create_worker

        def run() -> Result | BaseException:
            try:
                return work()
            except BaseException as error:  # a panic of the engine is no Exception
                return error

        self._enable(False)
        self.message.value = "working"
        # For a function that returns an Exception, napari emits "errored".
        create_worker(run, _connect={"returned": self._finish, "errored": self._finish})

    def _finish(self, result: Result | BaseException) -> None:
        self._enable(True)
        if isinstance(result, BaseException):
            self.message.value = describe_error(result)
            return
        layers, text = result
        try:
            for data, arguments, _ in layers:
                self._viewer.add_image(data, **arguments)
        except Exception as error:  # napari computes the first image of a layer, which may fail
            text = describe_error(error)
        self.message.value = text or "\n".join(arguments["name"] for _, arguments, _ in layers)

    def _enable(self, is_enabled: bool) -> None:
        for button in self._buttons:
            button.enabled = is_enabled


def describe_error(error: BaseException) -> str:
    """Return a message about an error. The traceback of an unexpected one is printed.

    Examples
    --------
    >>> describe_error(ValueError("window: expected at most 64 frames"))
    'window: expected at most 64 frames'
    >>> describe_error(MemoryError())
    'MemoryError'
    """
    if isinstance(error, _EXPECTED_ERRORS):
        return error_message(error)
    traceback.print_exception(error)
    return f"unexpected error, {type(error).__name__}: {error}"


def path_in(field: Any) -> Path | None:
    """Return the path in a field for files, or None if the field is empty."""
    value = field.value
    return None if value is None or str(value) in ("", ".") else Path(value)
