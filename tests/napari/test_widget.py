"""The dock widget of the napari plugin, in an offscreen Qt."""

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("magicgui", reason="no napari: pip install 'jotlight[napari]'")
pytest.importorskip("dask.array")
from jotlight.napari.lazy import make_layer, source_of
from jotlight.napari.widget import JotlightWidget
from jotlight.view.viewed import Viewed

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]

PHOTO = jl.datasets.photograph("camera")[100:164, 180:244]


@pytest.fixture
def viewer(empty_viewer):
    bits = jl.Sensor(frames=96, max_intensity=4.0).expose(PHOTO, rng=0)
    data, arguments, _ = make_layer(Viewed.from_data(bits, "scene"), 32)
    empty_viewer.add_image(data, **arguments)
    return empty_viewer


@pytest.fixture
def widget(viewer):
    widget = JotlightWidget(viewer)
    yield widget
    widget.native.close()


def bits_of(viewer):
    return source_of(viewer.layers[0]).viewed.data


def test_the_controls_show_the_active_layer(widget):
    assert (widget.window.value, widget.step.value, widget.method.value) == (32, 32, "mle")


def test_a_reconstruction_becomes_a_layer(viewer, widget, click):
    widget.method.value, widget.window.value, widget.step.value = "network-medium", 48, 24
    click(widget, widget.reconstruct, lambda: len(viewer.layers) == 2)
    layer = viewer.layers[-1]
    assert layer.data.shape == (3, 64, 64)
    expected = jl.reconstruct(bits_of(viewer)[24:72], quality="medium")
    np.testing.assert_array_equal(np.asarray(layer.data[1]), expected)
    assert widget.reconstruct.enabled


def test_the_displayed_window_is_aligned(viewer, widget, click):
    viewer.dims.set_current_step(0, 1)
    click(widget, widget.align, lambda: len(viewer.layers) == 2)
    assert viewer.layers[-1].name == "scene, frames 32 to 63, aligned, mle"


def test_the_displayed_image_is_measured(viewer, widget):
    viewer.dims.set_current_step(0, 2)
    widget.measure.native.click()
    mean = jl.mle(bits_of(viewer)[64:96]).astype(np.float64).mean()
    assert f"mean: {mean:.4g}" in widget.message.value


def test_a_rectangle_is_measured(viewer, widget):
    viewer.dims.set_current_step(0, 0)
    viewer.add_shapes([np.array([[10, 20], [10, 30], [14, 30], [14, 20]])])
    widget.measure.native.click()
    assert "pixels: 40" in widget.message.value


def test_a_color_layer_is_measured_as_intensities(viewer, widget, click):
    sensor = jl.Sensor(frames=64, max_intensity=20.0)
    scene = 3 * jl.datasets.photograph("coffee")[100:164, 180:244]
    bits = sensor.expose(scene, rng=0, channel_axis=-1)
    data, arguments, _ = make_layer(Viewed.from_data(bits, "colors"), 32)
    viewer.add_image(data, **arguments)
    viewer.dims.set_current_step(0, 1)
    widget.measure.native.click()
    image = jl.mle(bits[32:]).astype(np.float64)
    means = ", ".join(f"{mean:.4g}" for mean in image.mean(axis=(0, 1)))
    assert f"mean: {means}" in widget.message.value
    viewer.add_shapes([np.array([[10, 20], [10, 30], [14, 30], [14, 20]])])
    widget.measure.native.click()
    peaks = ", ".join(f"{peak:.4g}" for peak in image[10:14, 20:30].max(axis=(0, 1)))
    assert f"largest: {peaks}" in widget.message.value


def test_a_mosaic_becomes_a_layer_of_colors(viewer, widget, click):
    scene = jl.datasets.photograph("coffee")[100:164:2, 180:244:2]
    bits = jl.Sensor(frames=64, mosaic="RGGB").expose(scene, rng=0)
    data, arguments, _ = make_layer(Viewed.from_data(bits, "mosaic"), 32)
    viewer.add_image(data, **arguments)
    widget.method.value, widget.step.value = "network-color", 16
    click(widget, widget.reconstruct, lambda: len(viewer.layers) == 3)
    layer = viewer.layers[-1]
    assert layer.rgb
    assert layer.data.shape == (3, 32, 32, 3)
    expected = jl.reconstruct(bits[16:48])
    found = source_of(layer).image(1)
    np.testing.assert_array_equal(found, expected)
    white = np.percentile(source_of(layer).image(0), 99.5)
    np.testing.assert_allclose(layer.data[1], np.clip(found / white, 0, 1), rtol=1e-5)


def test_the_color_network_is_refused_for_a_gray_layer(viewer, widget, click):
    widget.method.value = "network-color"
    click(widget, widget.reconstruct, lambda: "of three channels" in widget.message.value)
    assert len(viewer.layers) == 1


def test_the_measured_image_is_that_of_the_layer_among_others(viewer, widget):
    viewer.add_image(np.zeros((5, 3, 64, 64)))
    viewer.layers.selection.active = viewer.layers[0]
    viewer.dims.set_current_step(0, 4)
    viewer.dims.set_current_step(1, 1)
    widget.measure.native.click()
    mean = jl.mle(bits_of(viewer)[32:64]).astype(np.float64).mean()
    assert f"mean: {mean:.4g}" in widget.message.value


def test_a_measurement_that_fails_is_shown(viewer, widget, monkeypatch):
    def fail(*_):
        raise RuntimeError("the disk is gone")

    monkeypatch.setattr("jotlight.napari.widget.measure_layer", fail)
    widget.measure.native.click()
    assert widget.message.value == "unexpected error, RuntimeError: the disk is gone"


def test_a_calibration_is_applied(viewer, widget, click, tmp_path):
    dark = jl.Sensor(frames=1000, dark_counts=0.01).expose(np.zeros((64, 64)), rng=1)
    jl.save(dark, tmp_path / "dark.npy")
    widget.dark.value = tmp_path / "dark.npy"
    click(widget, widget.calibrate, lambda: len(viewer.layers) == 2)
    sensor = source_of(viewer.layers[-1]).viewed.sensor_of_all
    assert np.median(sensor.dark_counts) == pytest.approx(0.01, rel=0.2)
    assert "dark counts: median" in widget.message.value


def test_errors_are_shown_not_raised(viewer, widget, click):
    widget.window.value = 1000
    click(widget, widget.reconstruct, lambda: "expected" in widget.message.value)
    assert len(viewer.layers) == 1
    assert widget.reconstruct.enabled
    viewer.add_image(np.zeros((4, 4)))
    widget.reconstruct.native.click()
    assert "expected one that jotlight made" in widget.message.value
