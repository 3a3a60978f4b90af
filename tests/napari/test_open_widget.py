"""The dock widget that opens captures whose format or array the user names."""

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("magicgui", reason="no napari: pip install 'jotlight[napari]'")
pytest.importorskip("dask.array")
from jotlight.napari.lazy import source_of
from jotlight.napari.open_widget import OpenWidget

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]

RNG = np.random.default_rng(0)


@pytest.fixture
def widget(empty_viewer):
    widget = OpenWidget(empty_viewer)
    yield widget
    widget.native.close()


def press_open(widget, click):
    click(widget, widget.open, lambda: widget.open.enabled and widget.message.value != "working")
    return [source_of(layer).viewed.data for layer in widget._viewer.layers]


def test_raw_frames_of_a_file_and_of_a_folder(widget, click, tmp_path):
    folder = tmp_path / "frames"
    folder.mkdir()
    (folder / "1.bin").write_bytes(RNG.bytes(2 * 32768))
    (tmp_path / "capture.raw").write_bytes(RNG.bytes(32768))
    widget.show_path(tmp_path / "capture.raw")
    assert "choose its format" in widget.message.value
    widget.format.value = "spad512s"
    [bits] = press_open(widget, click)
    expected = jl.open(tmp_path / "capture.raw", format="spad512s")
    np.testing.assert_array_equal(bits.packed, expected.packed)
    widget.show_path(folder)
    widget.format.value = "swissspad2-full"
    [_, bits] = press_open(widget, click)
    assert bits.shape == (2, 512, 512)


def test_raw_frames_of_a_stated_layout(widget, click, tmp_path):
    frames = RNG.random((3, 6, 13)) < 0.5
    (tmp_path / "camera.raw").write_bytes(b"HEAD" + np.packbits(frames, axis=2).tobytes())
    widget.show_path(tmp_path / "camera.raw")
    assert "or state its layout" in widget.message.value
    widget.raw_layout.value = "6x13,file_header=4"
    [bits] = press_open(widget, click)
    np.testing.assert_array_equal(bits.to_array(), frames)


def test_color_filters_of_a_capture_that_does_not_state_them(widget, click, tmp_path):
    bits = jl.Bits.from_array(RNG.random((16, 6, 8)) < 0.4)
    jl.save(bits, tmp_path / "capture.npy")
    widget.file.value = tmp_path / "capture.npy"
    widget.mosaic.value = "RXGB"
    click(widget, widget.open, lambda: "got X" in widget.message.value)
    widget.mosaic.value = " GRBG "
    press_open(widget, click)
    [layer] = widget._viewer.layers
    assert layer.rgb
    assert layer.data.shape == (1, 6, 8, 3)


def test_an_array_by_its_name(widget, click, tmp_path):
    arrays = {name: RNG.integers(0, 9, (6, 8)) for name in ("dark", "flat")}
    np.savez(tmp_path / "a.npz", **arrays)
    widget.file.value = tmp_path / "a.npz"
    widget.key.value = "flat"
    [stack] = press_open(widget, click)
    np.testing.assert_array_equal(stack.sum(), arrays["flat"])
    widget.key.value = ""
    assert len(press_open(widget, click)) == 3
    assert widget.message.value == "a.npz: dark, mle\na.npz: flat, mle"


def test_errors_are_shown(widget, click, tmp_path):
    press_open(widget, click)
    assert widget.message.value == "path: expected either a file or a folder"
    (tmp_path / "a.txt").write_text("text")
    widget.file.value = tmp_path / "a.txt"
    press_open(widget, click)
    assert "expected a capture, got a .txt, which holds text" in widget.message.value
    assert widget.open.enabled


def test_a_stack_that_does_not_state_the_bits_of_its_readings(widget, click, tmp_path):
    array = RNG.integers(0, 16, (8, 6, 8), dtype=np.uint8)
    np.save(tmp_path / "stack.npy", array)
    widget.file.value = tmp_path / "stack.npy"
    widget.bit_depth.value = 4
    [readings] = press_open(widget, click)
    assert readings.bit_depth == 4
    np.testing.assert_array_equal(readings.to_array(), array)
