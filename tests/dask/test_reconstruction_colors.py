"""Videos of color mosaics and of three channels: the colors of `jotlight.reconstruct`."""

import warnings

import dask
import numpy as np
import pytest

import jotlight as jl
from jotlight.runs.estimator import choose_estimator
from jotlight.sensing.parameters.mosaic import Mosaic

SCENE = jl.datasets.photograph("astronaut")[40:160:4, 160:288:4].astype(np.float64)
RANDOM = Mosaic(np.random.default_rng(0).integers(4, size=SCENE.shape[:2]), "RGBW")
DIFFERENCES = {"demosaicing": "differences"}


def expose(mosaic="RGGB", **parameters):
    return jl.Sensor(frames=24, mosaic=mosaic, **parameters).expose(SCENE, rng=0)


def assert_equals_reconstruct(bits, window, step, **options):
    """Compare all images of a video with those of the counts of the same windows."""
    video = jl.dask.reconstruct(
        bits.to_dask(7), bits.sensor, window, step, width=bits.width, **options
    )
    estimates = video.compute()
    assert video.shape == estimates.shape
    assert (video.dtype, estimates.dtype) == (np.float32, np.float32)
    assert video.chunks[1:] == tuple((size,) for size in estimates.shape[1:])
    sensor = bits.sensor.replace(frames=window)
    axis = {"channel_axis": -1} if len(bits.shape) == 4 else {}
    for image, part in zip(estimates, bits.windows(window, step), strict=True):
        counts = part.counts(sensor.oversampling)
        expected = jl.reconstruct(counts, sensor, **axis, **options)
        np.testing.assert_array_equal(image, expected)
    return estimates


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mosaic", "options"),
    [
        ("RGGB", {}),
        pytest.param("RGGB", {"demosaicing": "network"}, marks=pytest.mark.slow),
        (RANDOM, {}),
        ("GBRG", DIFFERENCES),
        ("RGBW", {"method": "mle"}),
        ("RGGB", {"quality": "small"} | DIFFERENCES),
        ("RGGB", {"weight": 5.0, "tol": 0.01} | DIFFERENCES),
    ],
    ids=str,
)
def test_each_image_of_a_mosaic_is_that_of_reconstruct(mosaic, options):
    estimates = assert_equals_reconstruct(expose(mosaic), 12, 6, **options)
    assert estimates.shape == (3, *SCENE.shape)


@pytest.mark.slow
def test_menons_method_and_pixels_of_several_jots():
    with np.printoptions():  # the package changes those of NumPy
        pytest.importorskip("colour_demosaicing", reason="no Menon: pip install 'jotlight[color]'")
    assert_equals_reconstruct(expose(oversampling=2)[:16], 8, None, method="mle")


def test_dead_jots_behind_a_mosaic():
    mask = np.zeros(SCENE.shape[:2], bool)
    mask[3, 4:7] = True
    with pytest.warns(jl.JotlightWarning, match="have no valid bit"):
        assert_equals_reconstruct(expose(mask=mask), 12, None)


def test_a_network_of_the_caller_estimates_planes():
    network = jl.pretrained(jl.Sensor(frames=20), "small")
    assert_equals_reconstruct(expose(), 12, None, method=network, **DIFFERENCES)


@pytest.mark.slow
def test_networks_fall_back_behind_a_mosaic():
    assert_equals_reconstruct(expose(), 12, None, quality="small", fallback=True, **DIFFERENCES)


def test_the_best_method_of_many_trials_estimates_colors():
    for sensor, channels in ((jl.Sensor(mosaic="RGBW"), 1), (jl.Sensor(), 3)):
        estimator = choose_estimator(sensor.replace(frames=2000), channels=channels)
        assert (estimator.choice.method, estimator.is_color) == ("held-out", True)


@pytest.mark.parametrize("options", [{}, {"method": "mle"}, {"fallback": True}], ids=str)
def test_three_channels_are_estimated_as_by_reconstruct(options):
    bits = jl.Sensor(frames=24).expose(SCENE, rng=0, channel_axis=-1)
    assert_equals_reconstruct(bits, 12, None, **options)


@pytest.mark.slow
def test_colors_do_not_depend_on_chunks_or_threads():
    bits = expose()[:16]
    expected = jl.dask.reconstruct(bits.to_dask(24), bits.sensor, 8, 4, width=bits.width).compute()
    for frames, scheduler in ((1, "threads"), (5, "sync")):
        x = bits.to_dask(frames)
        with dask.config.set(scheduler=scheduler):
            video = jl.dask.reconstruct(x, bits.sensor, 8, 4, width=bits.width).compute()
        np.testing.assert_array_equal(video, expected)
    estimator = choose_estimator(bits.sensor.replace(frames=8))
    counts = np.stack([part.counts() for part in bits.windows(8, 4)])
    for threads in (1, 2, None):
        several = estimator.with_threads(threads)
        np.testing.assert_array_equal(several(counts), expected)
        np.testing.assert_array_equal(several(counts[2:3])[0], expected[2])


@pytest.mark.parametrize(
    "options",
    [{}, {"method": "mle"}, pytest.param({"method": "held-out"}, marks=pytest.mark.slow)],
    ids=str,
)
def test_threads_do_not_warn_about_pixels_behind_other_filters(options):
    # Planes by filter hide warnings, in several threads at once.
    bits = jl.Sensor(frames=8, mosaic="RGBW/BWRG").expose(SCENE[:8, :8], rng=0)
    filters = list(warnings.filters)
    with dask.config.set(scheduler="threads", num_workers=8):
        jl.dask.reconstruct(bits.to_dask(1), bits.sensor, 2, width=bits.width, **options).compute()
    assert warnings.filters == filters


def test_colors_are_estimated_as_a_whole():
    sensor = jl.Sensor(frames=16, mosaic="RGGB")
    for options in ({}, {"method": "mle"}, {"quality": "small"}):
        assert not choose_estimator(sensor, **options).is_pixelwise
    assert not choose_estimator(jl.Sensor(frames=16), channels=3).is_pixelwise


def test_weights_are_those_of_the_networks_that_run():
    mosaic = jl.Sensor(frames=16, mosaic="RGBW")
    joint = choose_estimator(mosaic)
    channels = choose_estimator(jl.Sensor(frames=16), channels=3)
    assert (joint.choice.method, channels.choice.method) == ("network-color", "network-color")
    assert len(joint.weights()) == len(channels.weights()) == 2
    assert joint.weights() != channels.weights()
    assert choose_estimator(mosaic, "mle").weights() is None
    # A clear pixel sees three times the light for which "small" has a network of its own.
    assert len(choose_estimator(mosaic, quality="small").weights()) == 2


def test_empty_counts_have_the_shape_of_colors():
    estimator = choose_estimator(jl.Sensor(frames=16, mosaic="RGGB"), "mle")
    assert estimator(np.empty((0, 4, 6), np.int32)).shape == (0, 4, 6, 3)


@pytest.mark.parametrize(
    ("mosaic", "options", "message"),
    [
        ("RGGB", {"demosaicing": "linear"}, "expected one of network, menon, differences, got"),
        ("RGBW", {"demosaicing": "menon"}, "menon is for RGGB"),
        ("RGGB", {"demosaicing": "network", "method": "mle"}, '"network" estimates colors without'),
        (None, {"demosaicing": "differences"}, "demosaicing: is for a sensor with a mosaic"),
        (RANDOM.crop(range(20), range(20)), {}, "expected a map of 30 x 32 pixels"),
        ("RGGB", {"method": jl.pretrained(jl.Sensor(frames=9), "small")}, "network"),
    ],
    ids=str,
)
def test_bad_options_are_refused_before_work(mosaic, options, message):
    bits = jl.Bits.from_array(np.zeros((16, *SCENE.shape[:2]), bool))
    with pytest.raises(ValueError, match=message):
        jl.dask.reconstruct(bits, jl.Sensor(frames=16, mosaic=mosaic), **options)


def test_bits_with_channels_have_no_mosaic():
    bits = jl.Bits.from_array(np.zeros((4, 6, 8, 3), bool))
    with pytest.raises(ValueError, match=r"expected gray frames.*got 3 channels; leave out"):
        jl.dask.reconstruct(bits, jl.Sensor(frames=4, mosaic="RGGB"))


def test_readings_of_several_gains_behind_a_mosaic_are_refused():
    sensor = jl.Sensor(frames=4, gain=[1.0, 8.0, 1.0, 8.0], mosaic="RGGB")
    with pytest.raises(ValueError, match=r"one gain and one threshold.*`jotlight film` a film"):
        jl.dask.reconstruct(jl.Bits.from_array(np.zeros((4, 6, 8), bool)), sensor)
