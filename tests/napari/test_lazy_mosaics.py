"""Layers of captures behind a color mosaic."""

import numpy as np
import pytest

import jotlight as jl

pytest.importorskip("dask.array", reason="no dask: pip install 'jotlight[napari]'")
from jotlight.napari import reader
from jotlight.napari.lazy import INTENSITIES, KEY, make_layer
from jotlight.napari.work import align_window, apply_calibration, change_method, measure_layer
from jotlight.view.viewed import Viewed

SCENE = jl.datasets.photograph("astronaut")[40:160:4, 160:288:4].astype(np.float64)
SENSOR = jl.Sensor(frames=48, mosaic="RGGB", max_intensity=3.0, exposure_time=1e-5)
BITS = SENSOR.expose(SCENE, rng=0)
DIFFERENCES = {"method": "mle", "demosaicing": "differences"}


class Layer:
    """The attributes of a layer of napari that measurements use."""

    multiscale = False

    def __init__(self, data, arguments, _):
        self.data, self.metadata = data, arguments["metadata"]


def intensities(layer):
    return np.asarray(layer[1]["metadata"][INTENSITIES])


def test_a_layer_of_a_mosaic_has_colors():
    data, arguments, kind = make_layer(Viewed.from_data(BITS), 16)
    assert (kind, arguments["rgb"]) == ("image", True)
    assert (data.shape, data.dtype) == ((3, *SCENE.shape), np.float32)
    shown = np.asarray(data)
    assert shown.shape == data.shape
    assert 0 <= shown.min() < shown.max() <= 1
    found = intensities((data, arguments, kind))
    for image, part in zip(found, BITS.windows(16), strict=True):
        np.testing.assert_array_equal(
            image, jl.reconstruct(part.counts(), part.sensor, **DIFFERENCES)
        )


@pytest.mark.slow
def test_methods_of_the_dock_widget_show_colors():
    source = make_layer(Viewed.from_data(BITS), 16)[1]["metadata"][KEY]
    part = BITS[8:24]
    joint = intensities(change_method(source, "network-color", 16, 8))
    np.testing.assert_array_equal(joint[1], jl.reconstruct(part.counts(), part.sensor))
    small = intensities(change_method(source, "network-small", 16, 8))
    options = {"quality": "small", "demosaicing": "differences"}
    np.testing.assert_array_equal(small[1], jl.reconstruct(part.counts(), part.sensor, **options))


def test_counts_of_a_mosaic_are_gray():
    data, arguments, _ = make_layer(Viewed.from_data(BITS), 16, method="counts")
    assert data.shape == (3, *SCENE.shape[:2])
    assert "rgb" not in arguments
    np.testing.assert_allclose(np.asarray(data[1]), BITS[16:32].counts() / 16, rtol=1e-6)


def test_a_gray_capture_has_no_color_network():
    gray = jl.Sensor(frames=16).expose(SCENE[..., 0], rng=0)
    with pytest.raises(ValueError, match=r"a color network takes .* got other data"):
        make_layer(Viewed.from_data(gray), 16, method="network-color")


def test_a_mosaic_is_stated_when_a_capture_is_opened(tmp_path):
    path = tmp_path / "capture.npy"
    jl.save(jl.Bits.from_array(np.asarray(BITS)), path)
    [(gray, _, _)] = reader.read(path)
    assert gray.shape == (1, *SCENE.shape[:2])
    [layer] = reader.read(path, mosaic="RGGB")
    sensor = jl.Sensor(frames=48, mosaic="RGGB")
    source = layer[1]["metadata"][KEY]
    assert source.viewed.sensor_of_all == sensor
    saturated = sensor.replace(max_intensity=np.log(2 * 48))  # the range is unknown
    expected = jl.reconstruct(BITS.counts(), saturated, **DIFFERENCES)
    np.testing.assert_allclose(intensities(layer)[0], expected, rtol=1e-5)
    with pytest.raises(ValueError, match="got X"):
        reader.read(path, mosaic="RXGB")


def test_colors_are_measured():
    layer = make_layer(Viewed.from_data(BITS), 48)
    text = measure_layer(Layer(*layer), (0,))
    means = intensities(layer)[0].astype(np.float64).mean(axis=(0, 1))
    assert "channels: red, green, blue" in text
    assert f"mean: {', '.join(f'{mean:.4g}' for mean in means)}" in text
    assert "mean in photons per second" in text


def test_a_still_window_is_shown_as_it_is():
    source = make_layer(Viewed.from_data(BITS), 16, method="counts")[1]["metadata"][KEY]
    layer = align_window(source, 1)
    part = BITS[16:32]
    expected = jl.reconstruct(part.counts(), part.sensor, **DIFFERENCES)
    np.testing.assert_array_equal(intensities(layer), expected)


@pytest.mark.slow
def test_a_moving_window_is_merged_along_the_motion():
    coffee = jl.datasets.photograph("coffee")
    sensor = jl.Sensor(frames=96, mosaic="RGGB")
    moving = jl.datasets.moving(coffee, sensor=sensor, shape=(128, 192), photons=0.5, rng=0)
    viewed = Viewed.from_data(moving.bits)
    source = make_layer(viewed, 48, method="network-color")[1]["metadata"][KEY]
    found = intensities(align_window(source, 1))
    bits = moving.bits[48:]
    motion = jl.align(bits)
    assert motion.model != "none"
    np.testing.assert_array_equal(found, jl.reconstruct(jl.merge(bits, motion=motion)))


def test_a_calibration_tells_filters_from_jots(tmp_path):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(frames=256, mosaic="RGGB", dark_counts=0.01)
    shape = (20, 24)
    dark = sensor.expose(np.zeros((*shape, 3)), rng=rng)
    flat = sensor.expose(np.full((*shape, 3), [0.8, 0.3, 0.5]), rng=rng)
    for name, bits in (("dark", dark), ("flat", flat)):
        jl.save(jl.Bits.from_array(np.asarray(bits)), tmp_path / f"{name}.npy")
    bits = sensor.expose(np.full((*shape, 3), 0.5), rng=rng)
    source = make_layer(Viewed.from_data(bits), 256)[1]["metadata"][KEY]
    layer, _ = apply_calibration(source, tmp_path / "dark.npy", tmp_path / "flat.npy", None)
    expected = jl.calibrate(dark, flat).applied_to(sensor)
    assert layer[1]["metadata"][KEY].viewed.sensor_of_all == expected
    assert layer[1]["rgb"]


@pytest.mark.slow
def test_a_calibration_of_pixels_with_several_jots(tmp_path):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(frames=256, oversampling=2, mosaic="RGGB", dark_counts=0.01)
    dark = sensor.expose(np.zeros((20, 24, 3)), rng=rng)
    flat = sensor.expose(np.full((20, 24, 3), [0.8, 0.3, 0.5]), rng=rng)
    for name, bits in (("dark", dark), ("flat", flat)):
        jl.save(jl.Bits.from_array(np.asarray(bits)), tmp_path / f"{name}.npy")
    source = make_layer(Viewed.from_data(flat), 256)[1]["metadata"][KEY]
    layer, _ = apply_calibration(source, tmp_path / "dark.npy", tmp_path / "flat.npy", None)
    expected = jl.calibrate(dark, flat).applied_to(sensor)
    assert layer[1]["metadata"][KEY].viewed.sensor_of_all == expected
