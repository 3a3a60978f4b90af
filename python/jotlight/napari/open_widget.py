"""The dock widget of napari for captures of which the user states the format or other facts."""

from pathlib import Path
from typing import Any

from magicgui import widgets

from jotlight.formats.registry import FORMATS
from jotlight.napari.background import BackgroundWidget, path_in
from jotlight.napari.reader import read

_DETECT = "detected"


class OpenWidget(BackgroundWidget):
    """The fields for a capture.

    Parameters
    ----------
    viewer : napari.Viewer
        The window of napari. napari passes it by the name of this parameter.
    """

    def __init__(self, napari_viewer: Any) -> None:
        self.file = widgets.FileEdit(label="file", mode="r", nullable=True)
        self.folder = widgets.FileEdit(label="or folder", mode="d", nullable=True)
        self.format = widgets.ComboBox(label="format", choices=[_DETECT, *FORMATS], value=_DETECT)
        self.raw_layout = widgets.LineEdit(label="layout of raw frames, such as 256x512")
        self.key = widgets.LineEdit(label="array, if there are several")
        self.mosaic = widgets.LineEdit(label="color filters, such as RGGB")
        self.bit_depth = widgets.SpinBox(label="bits of a reading", value=1, min=1, max=16)
        self.open = widgets.PushButton(text="Open")
        self.open.changed.connect(self._on_open)
        fields = [self.file, self.folder, self.format, self.raw_layout, self.key, self.mosaic]
        super().__init__(napari_viewer, [*fields, self.bit_depth, self.open])

    def show_path(self, path: Path) -> None:
        """Fill in the path of a capture whose format the user has to choose."""
        self.file.value = None if path.is_dir() else path
        self.folder.value = path if path.is_dir() else None
        self.message.value = f"{path.name}: choose its format, or state its layout, then press Open"

    def _on_open(self) -> None:
        paths = [path for path in (path_in(self.file), path_in(self.folder)) if path is not None]
        if len(paths) != 1:
            self.message.value = "path: expected either a file or a folder"
            return
        name = None if self.format.value == _DETECT else self.format.value
        layout = self.raw_layout.value.strip() or None
        key = self.key.value.strip() or None
        mosaic = self.mosaic.value.strip() or None
        # Files may state several bits, so 1 stands for what the file states.
        depth = self.bit_depth.value if self.bit_depth.value > 1 else None
        self._start(lambda: (read(paths[0], name, key, mosaic, depth, layout), ""))
