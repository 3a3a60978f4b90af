"""The base of the dock widgets: no error leaves its buttons disabled."""

import numpy as np
import pytest

pytest.importorskip("magicgui", reason="no napari: pip install 'jotlight[napari]'")
pytest.importorskip("dask.array")
from magicgui import widgets

from jotlight.napari.background import BackgroundWidget

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]


class Panic(BaseException):
    """An error that is no Exception, like that of a panic of the engine."""


@pytest.fixture
def widget(empty_viewer):
    """Return a widget with a button that starts `widget.work`, a function that a test replaces."""
    button = widgets.PushButton(text="Start")
    widget = BackgroundWidget(empty_viewer, [button])
    button.changed.connect(lambda: widget._start(widget._work))
    widget._button = button
    yield widget
    widget.native.close()


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (ValueError("window: expected 1 to 64"), "window: expected 1 to 64"),
        (MemoryError(), "MemoryError"),
        (KeyError("frames"), "unexpected error, KeyError: 'frames'"),
        (Panic("index out of bounds"), "unexpected error, Panic: index out of bounds"),
    ],
)
def test_an_error_of_the_work_is_shown_and_the_buttons_are_enabled(widget, click, error, message):
    enabled = []

    def work():
        enabled.append(widget._button.enabled)
        raise error

    widget._work = work
    click(widget, widget._button, lambda: widget._button.enabled)
    assert enabled == [False]
    assert widget.message.value == message


def test_a_layer_that_napari_refuses_is_shown_and_the_buttons_are_enabled(widget, click):
    layer = np.zeros((4, 4)), {"name": "a", "colormap": "no such colormap"}, "image"
    widget._work = lambda: ([layer], "done")
    click(widget, widget._button, lambda: widget._button.enabled)
    assert "no such colormap" in widget.message.value


def test_a_layer_whose_first_image_fails_is_shown_and_the_buttons_are_enabled(
    widget, click, empty_viewer, monkeypatch
):
    def fail(*_, **__):
        raise KeyError("chunk")

    monkeypatch.setattr(type(empty_viewer), "add_image", fail)
    widget._work = lambda: ([(np.zeros((4, 4)), {"name": "a"}, "image")], "done")
    click(widget, widget._button, lambda: widget._button.enabled)
    assert widget.message.value == "unexpected error, KeyError: 'chunk'"


def test_layers_are_added_with_their_names_or_a_text(widget, click, empty_viewer):
    layers = [(np.zeros((4, 4)), {"name": name}, "image") for name in "ab"]
    for text, expected in (("", "a\nb"), ("done", "done")):
        widget._work = lambda text=text: (layers, text)
        click(widget, widget._button, lambda: widget._button.enabled)
        assert widget.message.value == expected
    assert len(empty_viewer.layers) == 4
