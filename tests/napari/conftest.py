"""Fixtures of the tests of dock widgets, in an offscreen Qt."""

import os
import time
import warnings

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")


@pytest.fixture(scope="session")
def application():
    """Return the application of Qt."""
    with warnings.catch_warnings():  # napari uses features of pydantic that will change
        warnings.simplefilter("ignore")
        pytest.importorskip("napari.components", reason="no napari")
        widgets = pytest.importorskip("qtpy.QtWidgets")
    return widgets.QApplication.instance() or widgets.QApplication([])


@pytest.fixture
def empty_viewer(application):
    """Return a viewer without a window."""
    from napari.components import ViewerModel

    return ViewerModel()


@pytest.fixture
def click(application):
    """Return a function that presses a button and waits until a condition is true."""

    def click(widget, button, done):
        button.native.click()
        end = time.monotonic() + 30
        while not done():
            assert time.monotonic() < end, widget.message.value
            application.processEvents()
            time.sleep(0.01)

    return click
