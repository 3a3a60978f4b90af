"""The dock widget of napari: it reconstructs, calibrates, aligns, and measures."""

from collections.abc import Callable
from typing import Any

from magicgui import widgets

from jotlight.evaluation.methods import COLOR_NETWORK, METHODS
from jotlight.napari.background import BackgroundWidget, Result, describe_error, path_in
from jotlight.napari.lazy import LayerSource, source_of
from jotlight.napari.work import align_window, apply_calibration, change_method, measure_layer
from jotlight.view.state import COUNTS

_HIDDEN = {"mle-iterative", "network-initial"}


class JotlightWidget(BackgroundWidget):
    """The controls for the active layer.

    Parameters
    ----------
    viewer : napari.Viewer
        The window of napari. napari passes it by the name of this parameter.
    """

    def __init__(self, napari_viewer: Any) -> None:
        names = [
            name for name, method in METHODS.items() if name not in _HIDDEN and method.available
        ]
        choices = [COUNTS, COLOR_NETWORK, *names]
        self.method = widgets.ComboBox(label="method", choices=choices, value="mle")
        self.window = widgets.SpinBox(label="window in frames", value=64, min=1, max=2**31 - 1)
        self.step = widgets.SpinBox(label="step in frames", value=64, min=1, max=2**31 - 1)
        self.reconstruct = widgets.PushButton(text="Reconstruct")
        self.align = widgets.PushButton(text="Align this window")
        self.dark = widgets.FileEdit(label="dark capture", mode="r", nullable=True)
        self.flat = widgets.FileEdit(label="flat capture", mode="r", nullable=True)
        self.saved = widgets.FileEdit(label="or calibration file", mode="r", nullable=True)
        self.calibrate = widgets.PushButton(text="Calibrate")
        self.measure = widgets.PushButton(text="Measure")
        self.reconstruct.changed.connect(self._on_reconstruct)
        self.align.changed.connect(self._on_align)
        self.calibrate.changed.connect(self._on_calibrate)
        self.measure.changed.connect(self._on_measure)
        super().__init__(
            napari_viewer,
            [
                *(self.method, self.window, self.step, self.reconstruct, self.align),
                *(self.dark, self.flat, self.saved, self.calibrate, self.measure),
            ],
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

    def _index(self, layer: Any) -> tuple[int, ...]:
        """Return the place of the displayed image in a layer."""
        place = layer.world_to_data(self._viewer.dims.point)
        return tuple(round(float(each)) for each in place[:-2])

    def _on_reconstruct(self) -> None:
        method, window, step = self.method.value, self.window.value, self.step.value
        self._change(lambda source, _: ([change_method(source, method, window, step)], ""))

    def _on_align(self) -> None:
        self._change(lambda source, index: ([align_window(source, index)], ""))

    def _on_calibrate(self) -> None:
        paths = [path_in(field) for field in (self.dark, self.flat, self.saved)]

        def change(source: LayerSource, _: int) -> Result:
            layer, found = apply_calibration(source, *paths)
            return [layer], found

        self._change(change)

    def _change(self, change: Callable[[LayerSource, int], Result]) -> None:
        """Start a change of the active layer, which the displayed window may determine."""
        layer = self._viewer.layers.selection.active
        try:
            source = source_of(layer)
        except ValueError as error:
            self.message.value = str(error)
            return
        index = next(iter(self._index(layer)), 0)
        self._start(lambda: change(source, index))

    def _on_measure(self) -> None:
        try:
            image, rectangle = self._measured()
            self.message.value = measure_layer(image, self._index(image), rectangle)
        except Exception as error:  # to compute the image may raise any error
            self.message.value = describe_error(error)

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
