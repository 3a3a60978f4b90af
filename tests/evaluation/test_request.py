"""A request chooses the method for some data, in Python, in runs, and on the command line alike."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.request import Request
from jotlight.networks.pretrained import MOSAIC_FILE, pretrained_color
from jotlight.runs.estimator import choose_estimator

GRAY = jl.Sensor(frames=16)
MOSAIC = jl.Sensor(frames=16, mosaic="RGGB")
NETWORK = jl.pretrained(GRAY, "two-layer")


@pytest.mark.parametrize(
    ("settings", "sensor", "takes_colors", "expected"),
    [
        ({}, GRAY, False, "network-medium"),
        ({}, GRAY, True, "network-color"),
        ({}, MOSAIC, True, "network-color"),
        ({}, MOSAIC, False, "network-medium"),
        ({"demosaicing": "differences"}, MOSAIC, True, "network-medium"),
        ({}, MOSAIC.replace(frames=2000), True, "held-out"),
        ({}, GRAY.replace(frames=2000), True, "held-out"),
        ({"fallback": True}, GRAY, False, "held-out"),
        ({"fallback": True}, GRAY, True, "held-out"),
        ({"fallback": True}, MOSAIC, True, "held-out"),
        ({"fallback": True, "demosaicing": "differences"}, MOSAIC, True, "held-out"),
        ({"demosaicing": "network"}, MOSAIC.replace(frames=2000), True, "network-color"),
        ({"method": "network-color"}, GRAY, True, "network-color"),
        ({"method": "network-color"}, GRAY.replace(frames=2000), True, "network-color"),
        ({"method": "network-color"}, MOSAIC, True, "network-color"),
        ({"method": "network-color", "demosaicing": "network"}, MOSAIC, True, "network-color"),
        ({"quality": "small"}, MOSAIC, True, "network-small"),
        ({"options": {"weight": 2.0}}, GRAY, True, "admm-tv"),
        ({"method": NETWORK}, GRAY, True, "network"),
    ],
    ids=str,
)
def test_the_method_of_a_request(settings, sensor, takes_colors, expected):
    request = Request(**settings)
    choice = request.choose(sensor, takes_colors=takes_colors)
    assert choice.method == expected
    named = "network-small", "admm-tv", "network"
    is_requested = bool({"fallback", "method"} & settings.keys()) or expected in named
    assert choice.is_requested == is_requested
    assert choice.is_color == (takes_colors and expected in ("network-color", "held-out"))
    pinned = request.of_choice(choice)
    assert pinned.quality is None
    again = pinned.choose(sensor, takes_colors=takes_colors)
    assert (again.method, again.quality) == (choice.method, choice.quality)
    assert again.is_color == choice.is_color


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"method": "mle", "quality": "small"}, "quality: selects a"),
        ({"method": NETWORK, "quality": "small"}, "quality: is not an option of a network"),
        ({"demosaicing": "menon"}, "demosaicing: is for a sensor with a mosaic"),
        ({"method": "mle", "precision": "bf16"}, "precision: expected f32 for mle"),
        ({"method": "network-color"}, "a color network takes .* got other data; name another"),
        ({"method": "network-color", "quality": "small"}, "quality: selects a"),
        ({"method": "network-color", "fallback": True}, "fallback: method='held-out' blends the"),
        (
            {"method": "network-color", "options": {"weight": 1.0}},
            "weight: is an option of admm-tv, not of network-color",
        ),
    ],
    ids=str,
)
def test_settings_that_do_not_belong_together_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Request(**settings).choose(GRAY, takes_colors=False)


def test_the_demosaicing_by_the_color_network_needs_data_that_it_takes():
    message = 'demosaicing: "network" estimates colors without'
    with pytest.raises(ValueError, match=message):
        Request(demosaicing="network").choose(MOSAIC, takes_colors=False)
    with pytest.raises(ValueError, match=f"{message} another method: it takes no .* fallback"):
        Request(demosaicing="network", fallback=True).choose(MOSAIC, takes_colors=True)


@pytest.mark.parametrize("method", ["network-color", pretrained_color(MOSAIC_FILE)], ids=type)
def test_a_color_network_takes_no_planes(method):
    with pytest.raises(ValueError, match="demosaicing: is not an option of a color network"):
        Request(method, demosaicing="menon").choose(MOSAIC, takes_colors=True)


@pytest.mark.parametrize("method", ["network-color", pretrained_color(MOSAIC_FILE)], ids=type)
def test_a_color_network_needs_colors_and_the_box_kernel(method):
    with pytest.raises(ValueError, match="got other data; name another method"):
        Request(method).choose(GRAY, takes_colors=False)
    smooth = GRAY.replace(kernel="cubic")
    with pytest.raises(ValueError, match="got the kernel cubic; name another method"):
        Request(method).choose(smooth, takes_colors=True)


def test_the_color_network_has_no_options_of_its_own():
    with pytest.raises(TypeError, match="denoiser: network-color has no options"):
        Request("network-color", options={"denoiser": "tv"}).choose(MOSAIC, takes_colors=True)


def test_a_color_network_of_the_caller_is_the_network_of_the_demosaicing():
    own = Request(pretrained_color(MOSAIC_FILE), demosaicing="network")
    assert own.choose(MOSAIC, takes_colors=True).method == "network"


def test_the_settings_of_a_record_are_those_that_were_set():
    settings = Request("mle", "small", fallback=True, options={"tol": 0.1}, threads=2).settings()
    assert settings == {"tol": 0.1, "fallback": True}
    assert Request().settings() == {}


def test_the_recommended_color_network_stays_the_default():
    recommended, named = Request(), Request("network-color")
    choices = [each.choose(MOSAIC, takes_colors=True) for each in (recommended, named)]
    assert recommended.of_choice(choices[0]).method is None
    assert named.of_choice(choices[1]).method == "network-color"


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("settings", [{}, {"method": "mle"}, {"quality": "two-layer"}], ids=str)
def test_reconstruct_and_runs_choose_the_same_method(channels, settings):
    shape = (8, 8) if channels == 1 else (8, 8, channels)
    axis = None if channels == 1 else -1
    counts = np.random.default_rng(0).integers(0, 17, shape)
    _, info = jl.reconstruct(counts, GRAY, channel_axis=axis, return_info=True, **settings)
    choice = choose_estimator(GRAY, **settings, channels=channels).choice
    assert (info.method, info.reason) == (choice.method, choice.reason)
