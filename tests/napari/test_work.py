"""What the dock widget measures."""

import types

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("dask.array", reason="no dask: pip install 'jotlight[napari]'")
from jotlight.napari.lazy import KEY, display_layer, make_layer
from jotlight.napari.work import measure, measure_layer
from jotlight.view.viewed import Viewed

PHOTO = jl.datasets.photograph("camera")[100:140, 180:240]
COLORS = jl.datasets.photograph("coffee")[100:140, 180:240]
SENSOR = jl.Sensor(frames=100, max_intensity=20.0, exposure_time=1e-5)


def layer_of(data, arguments, _="image"):
    """Return the attributes of a layer of napari that measurements use."""
    metadata = arguments.get("metadata", {})
    return types.SimpleNamespace(data=data, metadata=metadata, multiscale=False)


def numbers(text, line):
    """Return the numbers of a line of a measurement."""
    [found] = [each for each in text.splitlines() if each.startswith(f"{line}: ")]
    return [float(each) for each in found.partition(": ")[2].split(", ")]


def expose_colors(scale=5.0):
    return SENSOR.expose(scale * COLORS, rng=0, channel_axis=-1)


def test_a_rectangle_is_measured():
    image = np.arange(100.0).reshape(10, 10)
    text = measure(None, image, np.array([[2, 3], [2, 5], [4, 5], [4, 3]]))
    assert "pixels: 4" in text
    assert f"mean: {image[2:4, 3:5].mean():.4g}" in text
    with pytest.raises(ValueError, match="rectangle"):
        measure(None, image, np.array([[20, 20], [30, 30]]))


def test_photons_are_measured_in_both_units():
    bits = SENSOR.expose(PHOTO, rng=0)
    data, arguments, _ = make_layer(Viewed.from_data(bits))
    text = measure(arguments["metadata"][KEY], np.asarray(data[0]))
    mean = float(np.asarray(data[0], np.float64).mean())
    assert f"photons per pixel and frame: {mean:.4g}" in text
    assert f"photons per second: {mean * 1e5:.4g}" in text


def test_a_bracket_has_no_units_of_photons():
    bits = jl.Sensor(frames=40, gain=[0.5, 2.0] * 20).expose(PHOTO, rng=0)
    data, arguments, _ = make_layer(Viewed.from_data(bits))
    text = measure(arguments["metadata"][KEY], np.asarray(data[0]))
    assert "mean: " in text
    assert "photons" not in text


def test_the_intensities_of_colors_are_measured():
    bits = expose_colors()
    layer = layer_of(*make_layer(Viewed.from_data(bits), 50))
    text = measure_layer(layer, (1,))
    expected = jl.mle(bits[50:]).astype(np.float64)
    assert "channels: red, green, blue" in text
    assert numbers(text, "mean") == pytest.approx(expected.mean(axis=(0, 1)), rel=1e-3)
    assert numbers(text, "largest") == pytest.approx(expected.max(axis=(0, 1)), rel=1e-3)
    assert max(numbers(text, "largest")) > 3  # neither clipped nor divided
    rate = expected.mean(axis=(0, 1)) * 1e5
    assert numbers(text, "mean in photons per second") == pytest.approx(rate, rel=1e-3)


def test_an_aligned_color_image_is_measured_as_intensities():
    image = np.linspace(0, 9, 60, dtype=np.float32).reshape(4, 5, 3)
    text = measure_layer(layer_of(*display_layer(image, image, "aligned")), ())
    assert numbers(text, "largest") == pytest.approx(image.max(axis=(0, 1)), rel=1e-3)


def test_data_derived_from_clipped_colors_are_refused():
    data, arguments, _ = make_layer(Viewed.from_data(expose_colors()), 50)
    with pytest.raises(ValueError, match="measure the color layer itself"):
        measure_layer(layer_of(data[..., 0], arguments), (0,))


def test_a_projection_has_no_units_of_photons():
    data, arguments, _ = make_layer(Viewed.from_data(SENSOR.expose(PHOTO, rng=0)), 50)
    projection = layer_of(np.asarray(data).sum(axis=0), arguments)
    assert "photons" not in measure_layer(projection, ())


def test_colors_of_other_layers_are_measured_as_they_are():
    image = np.arange(2 * 3 * 4, dtype=np.uint8).reshape(2, 3, 4)
    text = measure_layer(layer_of(image, {}), ())
    assert "channels: red, green, blue, alpha" in text
    assert numbers(text, "smallest") == [0, 1, 2, 3]


@pytest.mark.parametrize("index", [-1, 2])
def test_an_image_beyond_the_layer_is_refused(index):
    layer = layer_of(*make_layer(Viewed.from_data(SENSOR.expose(PHOTO, rng=0)), 50))
    with pytest.raises(ValueError, match="expected one of the 2 images"):
        measure_layer(layer, (index,))
