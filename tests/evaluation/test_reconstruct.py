"""One call for all methods: what it chooses, and what it refuses."""

import functools
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation import reconstruct as reconstruct_module
from jotlight.evaluation import uncertainty as uncertainty_module
from jotlight.evaluation.methods import METHODS
from jotlight.evaluation.reconstruct import reconstruct

IMAGE = jl.datasets.photograph()[:64:2, :96:2]
SENSOR = jl.Sensor(oversampling=2, frames=4)
BITS = SENSOR.expose(IMAGE, rng=0)
COUNTS = BITS.counts()
ALL_ARE_BRIGHT = r"([\d,]+) of \1 pixels are brighter than the largest intensity, 1, "


def test_the_best_method_is_the_default():
    estimate, info = reconstruct(BITS, return_info=True)
    network = jl.pretrained(SENSOR)
    np.testing.assert_array_equal(estimate, network.reconstruct(BITS))
    assert (info.method, info.title) == ("network-medium", "network, medium")
    assert info.reason == "recommended for 16 trials per pixel"
    assert info.seconds > 0
    np.testing.assert_array_equal(reconstruct(BITS), estimate)
    np.testing.assert_array_equal(reconstruct(COUNTS, SENSOR), estimate)
    np.testing.assert_array_equal(reconstruct(COUNTS, SENSOR, trials=16), estimate)


@pytest.mark.parametrize("name", ["mle", "mle-iterative", "noniterative-tv", "admm-tv"])
def test_a_method_is_chosen_by_its_name(name):
    estimate, info = reconstruct(BITS, method=name, return_info=True)
    np.testing.assert_array_equal(estimate, METHODS[name].run(BITS, SENSOR))
    assert (info.method, info.reason) == (name, "requested")
    assert (info.history is not None) == METHODS[name].iterative
    assert len(repr(info)) < 200


@pytest.mark.parametrize("quality", ["two-layer", "small", "medium", "large"])
def test_a_network_is_chosen_by_its_size(quality):
    estimate, info = reconstruct(BITS, quality=quality, return_info=True)
    assert info.method == f"network-{quality}"
    np.testing.assert_array_equal(estimate, jl.pretrained(SENSOR, quality)(BITS))


def test_an_option_chooses_its_method():
    estimate, info = reconstruct(BITS, weight=3.0, return_info=True)
    assert info.method == "admm-tv"
    np.testing.assert_array_equal(estimate, jl.admm_tv(BITS, weight=3.0))
    steps = []
    reconstruct(BITS, method="admm-tv", callback=steps.append)
    assert steps


def test_a_network_and_functions_of_the_caller():
    network = jl.Network.initial(SENSOR)
    estimate, info = reconstruct(BITS, method=network, return_info=True)
    np.testing.assert_array_equal(estimate, network.reconstruct(BITS))
    assert info.method == "network"

    def mine(data, sensor, power=1):
        return np.asarray(jl.mle(data, sensor)) ** power

    estimate, info = reconstruct(COUNTS, SENSOR, method=mine, power=2, return_info=True)
    np.testing.assert_allclose(estimate, jl.mle(COUNTS, SENSOR) ** 2)
    assert (info.method, info.title, info.reason) == ("mine", "mine", "requested")
    np.testing.assert_array_equal(reconstruct(BITS, method=lambda bits: jl.mle(bits)), jl.mle(BITS))
    np.testing.assert_array_equal(reconstruct(BITS, method=jl.mle), jl.mle(BITS))
    assert reconstruct(BITS, method=lambda _: IMAGE.tolist()).dtype == np.float32


def test_functions_receive_the_sensor_only_if_they_ask_for_it():
    def keyword_only(bits, *, sensor):
        return jl.mle(bits, sensor)

    class Mine:
        def __call__(self, bits):
            return jl.mle(bits)

        def estimate(self, bits, sensor):
            return jl.mle(bits, sensor)

    expected = jl.mle(BITS)
    for method in (
        keyword_only,
        Mine(),
        Mine().estimate,
        functools.partial(jl.mle, threads=1),
        lambda bits, clip=False: jl.mle(bits) * (np.nan if clip else 1),
        lambda bits, s: jl.mle(bits, s),
        lambda *data: jl.mle(*data),
        lambda bits, **_: jl.mle(bits),
    ):
        np.testing.assert_array_equal(reconstruct(BITS, method=method), expected)
    np.testing.assert_allclose(
        reconstruct(COUNTS, SENSOR, method=np.sqrt), np.sqrt(COUNTS), rtol=1e-6
    )
    np.testing.assert_array_equal(
        reconstruct(COUNTS, SENSOR, method=jl.denoise.tv), jl.denoise.tv(COUNTS)
    )


def test_functions_receive_checked_data():
    def share(data):
        return (data.counts() if isinstance(data, jl.Bits) else data) / 16

    expected = np.float32(COUNTS / 16)
    plain = jl.Bits(BITS.packed, BITS.width)
    for data in (COUNTS.tolist(), plain, BITS):
        np.testing.assert_array_equal(reconstruct(data, SENSOR, method=share), expected)
    with pytest.raises(TypeError, match="an image of counts in whole numbers"):
        reconstruct(COUNTS + 0.5, SENSOR, method=share)
    with pytest.raises(ValueError, match="bits: expected the sensor's 2 frames"):
        reconstruct(BITS, SENSOR.replace(frames=2), method=share)
    with pytest.raises(TypeError, match="expected an image of numbers"):
        reconstruct(BITS, method=lambda _: IMAGE * 1j)


def test_a_network_brings_its_sensor():
    network = jl.pretrained(SENSOR)
    np.testing.assert_array_equal(reconstruct(COUNTS, method=network), network(COUNTS))


def test_merged_counts_and_color():
    merged = jl.Merged(COUNTS, np.full(COUNTS.shape, 16.0), SENSOR)
    np.testing.assert_allclose(reconstruct(merged), reconstruct(BITS), atol=1e-6)
    assert reconstruct(merged, method=lambda data: data.ones / 16).shape == COUNTS.shape
    color = SENSOR.expose(np.stack([IMAGE] * 3), rng=0, channel_axis=0)
    assert reconstruct(color).shape == (*IMAGE.shape, 3)
    assert reconstruct(color, method=lambda bits: bits.counts() / 16).shape == (*IMAGE.shape, 3)


def test_the_network_serves_smooth_kernels():
    smooth = jl.Sensor(oversampling=2, frames=4, kernel="cubic")
    bits = smooth.expose(IMAGE, rng=0)
    estimate, info = reconstruct(bits, return_info=True)
    assert info.method == "network-medium"
    np.testing.assert_array_equal(estimate, jl.pretrained(smooth).reconstruct(bits))
    with pytest.raises(ValueError, match="box kernel for a blend on held-out bits, got cubic"):
        reconstruct(bits, fallback=True)


@pytest.mark.parametrize("quality", ["small", "medium", "extra-large"])
def test_the_requested_precision_runs(quality):
    network = jl.pretrained(SENSOR, quality)
    expected = network.with_precision("bf16").reconstruct(BITS)
    assert (expected != network.reconstruct(BITS)).any()
    for arguments in (
        {"quality": quality, "precision": "bf16"},
        {"method": network, "precision": "bf16"},
        {"method": network.with_precision("bf16")},
        {"method": network.with_precision("f32"), "precision": "bf16"},
    ):
        np.testing.assert_array_equal(reconstruct(BITS, **arguments), expected)
    for arguments in (
        {"quality": quality},
        {"quality": quality, "precision": "f32"},
        {"method": network.with_precision("bf16"), "precision": "f32"},
    ):
        np.testing.assert_array_equal(reconstruct(BITS, **arguments), network.reconstruct(BITS))


@pytest.mark.parametrize("mosaic", [None, "RGGB"])
def test_colors_have_both_precisions(mosaic):
    sensor = jl.Sensor(frames=16, mosaic=mosaic)
    colors = np.repeat(IMAGE[..., None], 3, axis=2)
    bits = sensor.expose(colors, rng=0, channel_axis=-1)
    f32, bf16 = (reconstruct(bits, precision=name) for name in ("f32", "bf16"))
    np.testing.assert_array_equal(f32, reconstruct(bits))
    assert 0 < abs(bf16 - f32).max() < 0.02
    planes = {"quality": "small", "demosaicing": "differences" if mosaic else None}
    f32, bf16 = (reconstruct(bits, precision=name, **planes) for name in ("f32", "bf16"))
    assert 0 < abs(bf16 - f32).max() < 0.02


def test_many_trials_have_another_default():
    sensor = jl.Sensor(frames=2000)
    counts = sensor.expose(IMAGE, rng=0).counts()
    assert reconstruct(counts, sensor, return_info=True)[1].method == "held-out"


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"quality": "huge"}, ValueError, "quality: expected one of two-layer"),
        ({"method": "best"}, ValueError, "method: there is no 'best'; expected one of mle"),
        ({"method": 3}, TypeError, "method: expected the name of a method, a network, or a func"),
        ({"method": "n.safetensors"}, TypeError, r"got a path; pass jotlight\.Network\.load\('n"),
        ({"method": Path("n.safetensors")}, TypeError, r"got a path; pass jotlight\.Network\.load"),
        (
            {"method": jl.FilmNetwork.initial()},
            TypeError,
            r"film network; .*FilmEstimates\(network",
        ),
        ({"method": "mle", "quality": "small"}, ValueError, "quality: selects a pretrained"),
        ({"method": jl.mle, "quality": "small"}, ValueError, "quality: selects a pretrained"),
        ({"method": "mle", "weight": 1.0}, ValueError, "weight: is an option of admm-tv"),
        ({"weigth": 1.0}, TypeError, "weigth: without a method, expected one of the options"),
        ({"qualty": "small"}, TypeError, "qualty: without a method, .*; did you mean quality?"),
        ({"method": "mle", "treads": 1}, TypeError, "mle has no options; did you mean threads?"),
        ({"method": jl.pretrained(SENSOR), "treads": 1}, ValueError, "network; did you mean thr"),
        (
            {"method": "admm-tv", "wieght": 1.0},
            TypeError,
            "options weight, .* mean weight",
        ),
        ({"method": "mle", "inverse_": 1}, TypeError, "inverse_: mle has no options; leave it out"),
        ({"method": "noniterative-tv", "denoiser": "nlm"}, TypeError, "has the options inverse;"),
        ({"motion": True}, TypeError, r"moving scene, pass jotlight\.merge\(bits\)"),
        ({"method": "mle", "motion": True}, TypeError, r"pass jotlight\.merge\(bits\)"),
        ({"quality": "small", "sigma": 1}, TypeError, "sigma: network-small has no options"),
        ({"method": "network-mediun"}, ValueError, "did you mean network-medium"),
        ({"method": "mle:denoise"}, ValueError, "in Python pass the function itself"),
        ({"uncertainty": True}, TypeError, "uncertainty: without a method"),
        ({"method": jl.pretrained(SENSOR), "weight": 1.0}, ValueError, "weight: is not an option"),
        ({"method": lambda _: np.zeros(3)}, ValueError, r"shape \(32, 48\) from <lambda>, got"),
        ({"method": lambda _: IMAGE * np.nan}, ValueError, "expected finite intensities"),
        ({"precision": "f16"}, ValueError, "precision: expected one of f32, bf16, got 'f16'"),
        ({"precision": "bf16", "method": "mle"}, ValueError, "expected f32 for mle, got bf16; lea"),
        ({"precision": "bf16", "method": "held-out"}, ValueError, "expected f32 for held-out"),
        ({"precision": "bf16", "method": "network-initial"}, ValueError, "for network-initial"),
        ({"precision": "bf16", "fallback": True}, ValueError, "for a network with fallback, got"),
        ({"precision": "bf16", "method": lambda x: IMAGE}, ValueError, "f32 for a function, got"),
        ({"precision": "bf16", "quality": "two-layer"}, ValueError, "expected f32, because no lay"),
        ({"return_history": True}, TypeError, "return_history: pass return_info=True"),
        ({"sensor": 16}, TypeError, "sensor: expected a jotlight.Sensor"),
    ],
)
def test_requests_that_contradict_each_other_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        reconstruct(BITS, **arguments)


@pytest.mark.parametrize("quality", ["two-layer", "small", "medium", "large"])
@pytest.mark.parametrize("sensor", [jl.Sensor(frames=20), jl.Sensor(frames=16, kernel="cubic")])
def test_networks_of_every_size_serve_every_sensor(quality, sensor):
    expected = jl.pretrained(sensor, quality).reconstruct(COUNTS)
    np.testing.assert_array_equal(reconstruct(COUNTS, sensor, quality=quality), expected)


@pytest.mark.parametrize("method", ["mle", "network-medium", lambda bits: bits.counts() / 4])
def test_units_scale_the_estimate_by_any_method(method):
    sensor = jl.Sensor(oversampling=2, gain=6, efficiency=0.5, exposure_time=1e-4)
    bits = sensor.expose(IMAGE, rng=0)
    intensity = reconstruct(bits, method=method)
    photons = reconstruct(bits, method=method, units="photons")
    np.testing.assert_allclose(photons, 3 * intensity, rtol=1e-6)
    per_second = reconstruct(bits, method=method, units="photons-per-second")
    np.testing.assert_allclose(per_second, 3e4 * intensity, rtol=1e-6)
    assert per_second.dtype == np.float32


def test_photons_per_second_need_an_exposure_time():
    with pytest.raises(ValueError, match="photons per second need the exposure time"):
        reconstruct(BITS, units="photons-per-second")
    with pytest.raises(ValueError, match="units: expected one of intensity, photons, photons-per"):
        reconstruct(BITS, units="lux")


def test_counts_need_a_sensor():
    with pytest.raises(TypeError, match=r"sensor: expected a jotlight\.Sensor, because counts"):
        reconstruct(COUNTS)
    with pytest.raises(TypeError, match=r"sensor: expected a jotlight\.Sensor, because counts"):
        reconstruct(np.ones((8, 8), int), method=jl.Network.conditional("small", rng=0))


def test_a_largest_intensity_that_clips_most_pixels_is_reported():
    sensor = jl.Sensor(frames=64)
    bits = jl.Sensor(frames=64, max_intensity=9.0).expose(np.full((16, 16), 2.0), rng=0)
    with pytest.warns(
        jl.JotlightWarning, match=r"([\d,]+) of \1 .* intensity, 1, .*max_intensity=4\.85"
    ):
        jl.reconstruct(bits, sensor)
    jl.reconstruct(bits)
    jl.reconstruct(sensor.expose(np.full((16, 16), 0.9), rng=0))


@pytest.mark.parametrize("kind", ["dead time", "bracket", "bits"])
def test_the_advice_about_clipped_counts_fits_the_way_they_were_merged(kind):
    scene = np.full((16, 16), 3.0)
    if kind == "dead time":
        pixel = jl.FreeRunning(dead_time=0.01)
        merged = pixel.merge(pixel.draw(400 * scene, rng=0), light=400.0)
    else:
        gain = 48.0 if kind == "bits" else np.repeat([2.0, 0.25, 0.03], 16)
        bits = jl.Sensor(frames=48, gain=gain).expose(scene, rng=0)
        merged = jl.merge_readings(bits)
    advice = r"merge the readings again" if kind != "bits" else r"replace\(max_intensity=4\.56"
    with pytest.warns(
        jl.JotlightWarning, match=rf"^([\d,]+) of \1 .* largest intensity, 1, .*{advice}"
    ):
        jl.reconstruct(merged, method="mle")
    smaller = merged.sensor.replace(max_intensity=0.5)
    with pytest.warns(jl.JotlightWarning, match=r"intensity, 0\.5, .*replace\(max_intensity="):
        jl.reconstruct(merged, smaller, method="mle")


@pytest.mark.parametrize("options", [{}, {"method": "mle"}], ids=str)
def test_clipping_behind_a_mosaic_is_reported(options):
    sensor = jl.Sensor(frames=64, mosaic="RGGB", max_intensity=9.0)
    bits = sensor.expose(np.full((16, 16, 3), 2.0), rng=0)
    with pytest.warns(
        jl.JotlightWarning, match=r"([\d,]+) of \1 .* intensity, 1, .*max_intensity=4\.85"
    ):
        jl.reconstruct(bits, sensor.replace(max_intensity=1.0), **options)
    jl.reconstruct(bits, **options)


def test_the_report_of_clipping_names_the_white_balance():
    mosaic = jl.Mosaic("RGGB", white_balance=[1.5, 1, 2])
    sensor = jl.Sensor(frames=64, mosaic=mosaic, max_intensity=9.0)
    bits = sensor.expose(np.full((16, 16, 3), 2.0), rng=0)
    with pytest.warns(jl.JotlightWarning, match=r"intensity, 0\.5 times the white balance, which"):
        jl.reconstruct(bits, sensor.replace(max_intensity=0.5))


@pytest.mark.parametrize("run", [jl.reconstruct, jl.uncertainty])
@pytest.mark.parametrize("units", ["lux", "photons-per-second"])
def test_wrong_units_are_refused_before_the_work_behind_a_mosaic(monkeypatch, run, units):
    bits = jl.Sensor(frames=64, mosaic="RGGB").expose(np.full((16, 16, 3), 0.5), rng=0)

    def fail(*_args, **_options):
        raise AssertionError("the reconstruction began")

    monkeypatch.setattr(reconstruct_module, "_of_mosaic", fail)
    monkeypatch.setattr(uncertainty_module, "mosaic_uncertainty", fail)
    with pytest.raises(ValueError, match="units: "):
        run(bits, units=units)
