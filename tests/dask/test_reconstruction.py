import numpy as np
import pytest

import jotlight as jl
from jotlight.dask import reconstruction
from jotlight.evaluation.methods import METHODS
from jotlight.runs import estimator

pytestmark = pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")


@pytest.fixture(scope="module")
def bits():
    image = jl.datasets.photograph("camera")[::8, ::8]
    return jl.Sensor(frames=64).expose(image, rng=0)


@pytest.mark.parametrize(
    "method", ["mle", "network-small", "network-medium", "noniterative-gaussian"]
)
@pytest.mark.parametrize("chunk", [7, 64])
def test_each_image_is_that_of_reconstruct(bits, method, chunk):
    x = bits.to_dask(chunk)
    video = jl.dask.reconstruct(x, bits.sensor, 16, 12, method=method, width=bits.width).compute()
    sensor = bits.sensor.replace(frames=16)
    for image, part in zip(video, bits.windows(16, 12), strict=True):
        expected = jl.reconstruct(part.counts(), sensor, method=method)
        np.testing.assert_array_equal(image, expected)


def test_videos_have_both_precisions(bits):
    sensor = bits.sensor.replace(frames=16)
    network = jl.pretrained(sensor, "small")
    for arguments in ({"method": network}, {"quality": "small"}):
        video = jl.dask.reconstruct(bits, window=16, precision="bf16", **arguments).compute()
        for image, part in zip(video, bits.windows(16), strict=True):
            expected = network.with_precision("bf16").reconstruct(part.counts(), sensor)
            np.testing.assert_array_equal(image, expected)
            assert (image != network.reconstruct(part.counts(), sensor)).any()
    with pytest.raises(ValueError, match="precision: expected f32 for mle, got bf16"):
        jl.dask.reconstruct(bits, window=16, method="mle", precision="bf16")


def test_color_videos_have_channels_last():
    rng = np.random.default_rng(0)
    bits = jl.Bits.from_array(rng.random((16, 24, 32, 3)) < 0.4, jl.Sensor(frames=16))
    video = jl.dask.reconstruct(bits, window=8, quality="medium").compute()
    counts = bits[:8].counts()
    expected = jl.reconstruct(counts, jl.Sensor(frames=8), quality="medium", channel_axis=-1)
    np.testing.assert_array_equal(video[0], expected)


def test_tiles_of_large_images_are_those_of_the_image(bits, monkeypatch):
    whole = jl.dask.reconstruct(bits, window=16, method="mle").compute()
    monkeypatch.setattr(reconstruction, "_MAX_PIXELS", 100)
    monkeypatch.setattr(reconstruction, "_TILE", 48)
    tiled = jl.dask.reconstruct(bits, window=16, method="mle")
    assert len(tiled.chunks[1]) == 2
    np.testing.assert_array_equal(tiled.compute(), whole)
    again = jl.dask.reconstruct(bits.to_dask(9), bits.sensor, 16, method="mle", width=bits.width)
    np.testing.assert_array_equal(again.compute(), whole)


def test_networks_get_large_images_as_a_whole(monkeypatch):
    # The brightest pixels decide how the dark regions of a dim scene are estimated.
    monkeypatch.setattr(reconstruction, "_MAX_PIXELS", 100)
    monkeypatch.setattr(reconstruction, "_TILE", 48)
    image = np.full((96, 96), 0.05)
    image[70:90, 70:90] = 1.0
    sensor = jl.Sensor(frames=64, gain=4.0)
    bits = sensor.expose(image, rng=0)
    lazy = jl.dask.reconstruct(bits, quality="small")
    np.testing.assert_array_equal(lazy[0].compute(), jl.reconstruct(bits, quality="small"))


def test_sensors_with_maps_are_not_tiled(monkeypatch, bits):
    monkeypatch.setattr(reconstruction, "_MAX_PIXELS", 100)
    mask = np.zeros((64, 64), bool)
    mask[20, 30] = True
    sensor = bits.sensor.replace(mask=mask)
    video = jl.dask.reconstruct(bits, sensor, 32, method="mle").compute()
    expected = jl.mle(bits[:32].counts(), sensor.replace(frames=32))
    np.testing.assert_array_equal(video[0], expected)


def test_a_network_of_the_caller(bits):
    network = jl.pretrained(jl.Sensor(frames=16), "small")
    video = jl.dask.reconstruct(bits, window=16, method=network).compute()
    named = jl.dask.reconstruct(bits, window=16, quality="small").compute()
    np.testing.assert_array_equal(video, named)


def test_networks_fall_back_on_request(bits):
    video = jl.dask.reconstruct(bits, window=16, quality="small", fallback=True)
    expected = jl.reconstruct(bits[16:32], quality="small", fallback=True)
    np.testing.assert_array_equal(video[1].compute(), expected)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "network-smal"}, "did you mean"),
        ({"method": "mle", "quality": "small"}, "quality"),
        ({"quality": "tiny"}, "expected one of"),
        ({"method": "mle", "weight": 1.0}, "weight"),
        ({"method": max}, "method: expected"),
        ({"method": "mle", "fallback": True}, "fallback: is for networks"),
        ({"window": 65}, "window"),
        ({"foo": 1}, "foo: without a method, expected one of the options inverse"),
        ({"method": "admm-tv", "wieght": 1}, "wieght: admm-tv has .*; did you mean weight?"),
    ],
)
def test_bad_options_are_refused_before_work(bits, options, message):
    with pytest.raises((TypeError, ValueError), match=message):
        jl.dask.reconstruct(bits, **{"window": 16, **options})


def test_bits_without_a_sensor_are_refused(bits):
    with pytest.raises(TypeError, match="sensor: expected a jotlight"):
        jl.dask.reconstruct(bits.to_dask(), window=16)


@pytest.mark.parametrize("has_sensor", [True, False])
def test_readings_of_several_bits_are_refused(has_sensor):
    sensor = jl.Sensor(frames=8, bit_depth=4)
    readings = sensor.expose(np.full((8, 8), 0.5), rng=0)
    message = r"^x: expected jotlight.Bits, .* got readings of several bits, which jotlight.dask"
    with pytest.raises(TypeError, match=message):
        jl.dask.reconstruct(readings, sensor if has_sensor else None, window=4)
    with pytest.raises(TypeError, match=message):
        jl.dask.count(readings, window=4)
    with pytest.raises(TypeError, match=message):
        jl.dask.calibrate(readings)


def test_masks_of_jots_need_pixels_of_one_jot():
    mask = np.zeros((8, 8), bool)
    mask[0, 0] = True
    sensor = jl.Sensor(oversampling=2, frames=4, mask=mask)
    bits = jl.Bits.from_array(np.ones((4, 8, 8), bool), sensor)
    with pytest.raises(ValueError, match="oversampling=1"):
        jl.dask.reconstruct(bits, window=2)


def test_only_methods_that_estimate_each_pixel_by_itself_are_tiled():
    sensor = jl.Sensor(frames=16)
    assert estimator.choose_estimator(sensor, "mle").is_pixelwise
    for name in ("network-small", "network-two-layer", "held-out"):
        assert not estimator.choose_estimator(sensor, name).is_pixelwise
    assert set(METHODS) >= {"mle", "held-out"}


@pytest.mark.parametrize("method", ["mle", "noniterative-tv", "mle-iterative", "admm-tv"])
@pytest.mark.parametrize("oversampling", [1, 2])
def test_counts_are_enough_for_smooth_kernels_unless_a_method_needs_places(method, oversampling):
    sensor = jl.Sensor(frames=16, kernel="linear", oversampling=oversampling)
    bits = sensor.expose(np.linspace(0.2, 0.8, 64).reshape(8, 8), rng=0)
    if oversampling > 1 and method in ("mle-iterative", "admm-tv"):
        with pytest.raises(
            ValueError, match=f"{method} needs bits for the kernel linear, .* 2 x 2"
        ):
            jl.dask.reconstruct(bits, window=8, method=method)
        return
    video = jl.dask.reconstruct(bits, window=8, method=method).compute(scheduler="sync")
    expected = [jl.reconstruct(part, method=method) for part in bits.windows(8)]
    np.testing.assert_array_equal(video, expected)


@pytest.mark.parametrize("changes", [{"gain": [1.0, 8.0] * 4}, {"read_noise": 0.3}])
def test_readings_whose_counts_are_not_enough_are_sent_to_other_commands(changes):
    bits = jl.Sensor(frames=8, **changes).expose(np.full((8, 8), 0.5), rng=0)
    with pytest.raises(
        ValueError, match=r"sensor: expected .*single bits .*`jotlight film` a film"
    ):
        jl.dask.reconstruct(bits, window=4)
