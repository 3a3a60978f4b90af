"""The fallback of networks to other methods."""

import sys

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.color import mosaics
from jotlight.evaluation.held_out import COLORS_NAME, NAMES, held_out
from jotlight.networks.pretrained import pretrained_conditional

SENSOR = jl.Sensor(frames=16)
PHOTOGRAPH = jl.datasets.photograph("camera")[100:196, 180:276]
ROW, COLUMN = np.mgrid[:96, :96]
CHECKERBOARD = 0.1 + 0.8 * ((ROW + COLUMN) % 2)


def reconstruct(image, **options):
    bits = SENSOR.expose(image, rng=0)
    return jl.reconstruct(bits, return_info=True, **options)


@pytest.mark.parametrize("quality", ["small", "medium"])
def test_a_scene_unlike_photographs_falls_back_to_the_bits(quality):
    plain, without = reconstruct(CHECKERBOARD, quality=quality)
    estimate, info = reconstruct(CHECKERBOARD, quality=quality, fallback=True)
    quality_of = [jl.metrics.psnr(each, CHECKERBOARD) for each in (plain, estimate)]
    assert quality_of[1] > quality_of[0] + 5
    assert without.shares is None
    assert list(info.shares) == list(NAMES)
    assert sum(info.shares.values()) == pytest.approx(1, abs=1e-5)
    assert info.shares["maximum likelihood"] > 0.5
    assert info.method == f"network-{quality}"


def test_a_photograph_keeps_the_estimate_of_the_network():
    plain, _ = reconstruct(PHOTOGRAPH)
    estimate, info = reconstruct(PHOTOGRAPH, fallback=True)
    assert info.shares["network"] > 0.6
    assert jl.metrics.psnr(estimate, PHOTOGRAPH) > jl.metrics.psnr(plain, PHOTOGRAPH) - 0.1


COFFEE = jl.datasets.photograph("coffee")[:64, 180:244].astype(float)


@pytest.mark.parametrize("mosaic", [None, "RGBW"])
def test_colors_fall_back_from_the_color_network(mosaic):
    sensor = jl.Sensor(frames=16, mosaic=mosaic)
    bits = sensor.expose(COFFEE, rng=0, channel_axis=-1 if mosaic is None else None)
    plain, without = jl.reconstruct(bits, return_info=True)
    estimate, info = jl.reconstruct(bits, fallback=True, return_info=True)
    assert without.method == "network-color"
    assert (info.method, info.reason) == ("held-out", "requested")
    assert list(info.shares) == [COLORS_NAME, *NAMES]
    assert info.shares[COLORS_NAME] > 0.5
    assert jl.metrics.psnr(estimate, COFFEE) > jl.metrics.psnr(plain, COFFEE) - 0.2
    assert estimate.shape == plain.shape


def test_stated_demosaicing_keeps_the_color_network_in_the_blend():
    bits = jl.Sensor(frames=16, mosaic="RGGB").expose(COFFEE[:16, :16], rng=0)
    _, info = jl.reconstruct(bits, fallback=True, demosaicing="differences", return_info=True)
    assert list(info.shares) == [COLORS_NAME, *NAMES]


def test_a_blend_of_a_bayer_mosaic_names_the_extra_before_it_starts(monkeypatch):
    monkeypatch.setitem(sys.modules, "colour_demosaicing", None)
    monkeypatch.setattr(mosaics, "count_image", None)
    bits = jl.Sensor(frames=16, mosaic="RGGB").expose(COFFEE[:16, :16], rng=0)
    message = r"pip install 'jotlight\[color\]', or pass demosaicing=\"differences\""
    with pytest.raises(jl.MissingExtraError, match=message):
        jl.reconstruct(bits, fallback=True)


def test_colors_unlike_photographs_fall_back_to_the_bits():
    image = CHECKERBOARD[:64, :64, None] * np.array([1.0, 0.5, 0.2])
    bits = jl.Sensor(frames=64).expose(image, rng=0, channel_axis=-1)
    plain, (estimate, info) = (
        jl.reconstruct(bits),
        jl.reconstruct(bits, fallback=True, return_info=True),
    )
    assert info.shares["maximum likelihood"] > 0.2
    assert jl.metrics.psnr(estimate, image) > jl.metrics.psnr(plain, image)


@pytest.mark.slow
def test_the_default_with_fallback_is_the_method_held_out():
    bits = SENSOR.expose(CHECKERBOARD, rng=0)
    expected = held_out(bits)
    np.testing.assert_array_equal(jl.reconstruct(bits, fallback=True), expected)
    estimate, info = jl.reconstruct(bits, method="held-out", return_info=True)
    np.testing.assert_array_equal(estimate, expected)
    assert info.shares is not None


def test_a_network_of_the_caller_falls_back_too():
    network = pretrained_conditional(SENSOR, "small")
    bits = SENSOR.expose(CHECKERBOARD, rng=0)
    expected = jl.reconstruct(bits, quality="small", fallback=True)
    np.testing.assert_array_equal(jl.reconstruct(bits, method=network, fallback=True), expected)


def test_the_intervals_of_a_blend_are_not_those_of_its_network():
    bits = jl.Sensor(frames=256).expose(CHECKERBOARD[:48, :48], rng=0)
    estimate = jl.reconstruct(bits, quality="medium", fallback=True)

    def limits(**options):
        known = jl.uncertainty(bits, **options, estimate=estimate)
        return known.low, known.high

    of_blend = limits(method="held-out")
    for options in (
        {},
        {"quality": "medium"},
        {"method": pretrained_conditional(SENSOR, "medium")},
    ):
        np.testing.assert_array_equal(limits(**options, fallback=True), of_blend)
    of_network = limits(quality="medium")
    assert np.mean(of_blend[1] - of_blend[0]) > 1.1 * np.mean(of_network[1] - of_network[0])


def test_the_intervals_of_a_blend_that_is_computed_are_those_of_a_known_one():
    bits = SENSOR.expose(CHECKERBOARD[:24, :24], rng=0)
    estimate = jl.reconstruct(bits, quality="large", fallback=True)
    computed = jl.uncertainty(bits, quality="large", fallback=True)
    known = jl.uncertainty(bits, quality="large", fallback=True, estimate=estimate)
    np.testing.assert_array_equal(computed.low, known.low)
    np.testing.assert_array_equal(computed.standard_error, known.standard_error)


@pytest.mark.slow
def test_a_stack_equals_its_images():
    bits = [SENSOR.expose(image, rng=0) for image in (PHOTOGRAPH, CHECKERBOARD)]
    stack = jl.reconstruct(bits, quality="small", fallback=True)
    for each, estimate in zip(bits, stack, strict=True):
        alone = jl.reconstruct(each, quality="small", fallback=True)
        np.testing.assert_array_equal(estimate, alone)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "mle"}, "fallback: is for networks, but the method is mle"),
        ({"method": lambda data: data.counts()}, "fallback: is for networks, but method is"),
        ({"method": jl.Network.initial(SENSOR)}, "fallback: expected a K-conditioned network"),
    ],
)
def test_only_conditional_networks_fall_back(options, message):
    bits = SENSOR.expose(PHOTOGRAPH, rng=0)
    for function in (jl.reconstruct, jl.uncertainty):
        with pytest.raises(ValueError, match=message):
            function(bits, fallback=True, **options)
