"""The dock widget of napari: it reconstructs, calibrates, aligns, and measures."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from magicgui import widgets

from jotlight.evaluation.methods import METHODS
from jotlight.napari.lazy import LayerData, LayerSource, source_of
from jotlight.napari.work import align_window, apply_calibration, change_method, measure
from jotlight.view.state import COUNTS

_HIDDEN = {"mle-iterative", "network-initial"}


class JotlightWidget(widgets.Container):
    """The controls for the active layer.

    Parameters
    ----------
    viewer : napari.Viewer
        The window of napari. napari passes it by the name of this parameter.
    """

    def __init__(self, napari_viewer: Any) -> None:
        self._viewer = napari_viewer
        names = [
            name for name, method in METHODS.items() if name not in _HIDDEN and method.available
        ]
        self.method = widgets.ComboBox(label="method", choices=[COUNTS, *names], value="mle")
        self.window = widgets.SpinBox(label="window in frames", value=64, min=1, max=2**31 - 1)
        self.step = widgets.SpinBox(label="step in frames", value=64, min=1, max=2**31 - 1)
        self.reconstruct = widgets.PushButton(text="Reconstruct")
        self.align = widgets.PushButton(text="Align this window")
        self.dark = widgets.FileEdit(label="dark capture", mode="r", nullable=True)
        self.flat = widgets.FileEdit(label="flat capture", mode="r", nullable=True)
        self.saved = widgets.FileEdit(label="or calibration file", mode="r", nullable=True)
        self.calibrate = widgets.PushButton(text="Calibrate")
        self.measure = widgets.PushButton(text="Measure")
        self.message = widgets.TextEdit(value="")
        self.message.read_only = True
        self.reconstruct.changed.connect(self._on_reconstruct)
        self.align.changed.connect(self._on_align)
        self.calibrate.changed.connect(self._on_calibrate)
        self.measure.changed.connect(self._on_measure)
        super().__init__(
            widgets=[
                *(self.method, self.window, self.step, self.reconstruct, self.align),
                *(self.dark, self.flat, self.saved, self.calibrate, self.measure, self.message),
            ]
        )
        self._take_layer()
        napari_viewer.layers.selection.events.active.connect(lambda _: self._take_layer())

    def _take_layer(self) -> None:
        """Show the window of the active layer, if it is one of jotlight."""
        try:
            source = source_of(self._viewer.layers.selection.active)
        except ValueError:
            return
        self.window.value, self.step.value = source.window, source.step
        self.method.value = source.method

    def _source(self) -> LayerSource:
        return source_of(self._viewer.layers.selection.active)

    def _index(self) -> int:
        """Return the number of the displayed image."""
        return int(self._viewer.dims.current_step[0])

    def _on_reconstruct(self) -> None:
        method, window, step = self.method.value, self.window.value, self.step.value
        self._start(lambda: (change_method(self._source(), method, window, step), ""))

    def _on_align(self) -> None:
        index = self._index()
        self._start(lambda: (align_window(self._source(), index), ""))

    def _on_calibrate(self) -> None:
        dark, flat, saved = (_path(each) for each in (self.dark, self.flat, self.saved))
        self._start(lambda: apply_calibration(self._source(), dark, flat, saved))

    def _on_measure(self) -> None:
        try:
            image, rectangle = self._measured()
            stack = image.data
            has_time = stack.ndim - bool(image.rgb) > 2
            values = np.asarray(stack[self._index()] if has_time else stack)
            try:
                source: LayerSource | None = source_of(image)
            except ValueError:
                source = None
            self.message.value = measure(source, values, rectangle)
        except (ValueError, IndexError) as error:
            self.message.value = str(error)

    def _measured(self) -> tuple[Any, Any]:
        """Return the image to measure, and a rectangle of it or None for the whole image."""
        from napari.layers import Image, Shapes

        layers, active = self._viewer.layers, self._viewer.layers.selection.active
        if isinstance(active, Image):
            return active, None
        images = [layer for layer in layers if isinstance(layer, Image)]
        if not (isinstance(active, Shapes) and len(active.data) and images):
            raise ValueError("layer: expected an image, or a rectangle in a layer of shapes")
        return images[-1], active.data[-1]

    def _start(self, work: Callable[[], tuple[LayerData, str]]) -> None:
        """Run work in a thread of napari, then add its layer."""
        from napari.qt.threading import create_worker

        try:
            self._source()
        except ValueError as error:
            self.message.value = str(error)
            return
        self._enable(False)
        self.message.value = "working"

        def run() -> tuple[LayerData | None, str]:
            try:
                return work()
            except (ValueError, TypeError, OSError, ImportError, MemoryError) as error:
                return None, str(error)  # napari would print a traceback of the error

        create_worker(run, _connect={"returned": self._add})

    def _add(self, result: tuple[LayerData | None, str]) -> None:
        self._enable(True)
        layer, text = result
        if layer is None:
            self.message.value = text
            return
        data, arguments, _ = layer
        self.message.value = text or arguments["name"]
        self._viewer.add_image(data, **arguments)

    def _enable(self, is_enabled: bool) -> None:
        for button in (self.reconstruct, self.align, self.calibrate, self.measure):
            button.enabled = is_enabled


def _path(field: Any) -> Path | None:
    """Return the path in a field, or None if the field is empty."""
    value = field.value
    return None if value is None or str(value) in ("", ".") else Path(value)
