"""The choice of method, network size, and range for a sensor."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.choice import OWN_NETWORK, choose_method
from jotlight.evaluation.methods import (
    BLEND_METHOD,
    DEFAULT_METHOD,
    METHODS,
)
from jotlight.sensing.likelihood.reference import saturation_intensity

SENSOR = jl.Sensor(frames=16)
LARGE = jl.Sensor(frames=1000)
MANY = jl.Sensor(frames=1001)
CUBIC = jl.Sensor(frames=16, oversampling=2, kernel="cubic")
SHIPPED = [name for name, method in METHODS.items() if method.quality is not None]
CONDITIONAL = jl.Network.conditional("small", trials_range=(1, 64), rng=0)


@pytest.mark.parametrize("sensor", [SENSOR, LARGE, CUBIC, MANY.replace(kernel="linear")])
def test_the_default_is_the_pretrained_network(sensor):
    choice = choose_method(sensor)
    assert (choice.method, choice.quality) == (DEFAULT_METHOD, "medium")
    assert choice.title == "network, medium"
    assert choice.notes == ()
    assert not choice.is_requested
    assert choice.reason == f"recommended for {sensor.trials:,} trials per pixel"


def test_many_trials_get_the_blend_on_held_out_bits():
    assert choose_method(MANY).method == BLEND_METHOD


@pytest.mark.parametrize("name", METHODS)
def test_a_request_is_kept(name):
    choice = choose_method(SENSOR, requested=name)
    assert choice.method == name
    for_one = ", for K = 16" if name in ("network-two-layer", "network-small") else ""
    assert choice.title == METHODS[name].title + for_one
    assert (choice.is_requested, choice.reason) == (True, "requested")


@pytest.mark.parametrize("name", SHIPPED)
def test_a_fixed_range_is_that_of_the_pretrained_network(name):
    sensor = jl.Sensor(frames=25)
    choice = choose_method(sensor, requested=name)
    network = jl.pretrained(sensor, choice.quality)
    assert choice.has_fixed_range == (network.trials_range is None)


@pytest.mark.parametrize(
    ("network", "has_fixed_range"), [(jl.Network.initial(SENSOR), True), (CONDITIONAL, False)]
)
def test_a_network_of_the_caller_comes_first(network, has_fixed_range):
    choice = choose_method(LARGE, requested="mle", network=network)
    assert (choice.method, choice.quality) == (OWN_NETWORK, None)
    assert choice.has_fixed_range == has_fixed_range
    assert choice.title == "network, own"
    assert choice.is_requested


@pytest.mark.parametrize("name", ["mle", "admm-tv", "network-medium"])
def test_an_unknown_range_reaches_up_to_saturation(name):
    choice = choose_method(SENSOR, requested=name, is_range_known=False)
    assert choice.max_intensity == saturation_intensity(SENSOR) > 1
    assert choice.saturation is None
    [note] = choice.notes
    assert "max_intensity=S (--max-intensity) sets another" in note


def test_a_network_with_a_fixed_range_keeps_it_and_names_the_saturation():
    choice = choose_method(SENSOR, requested="network-small", is_range_known=False)
    assert choice.max_intensity == 1
    assert choice.saturation == saturation_intensity(SENSOR)
    assert choice.notes == ()


@pytest.mark.parametrize(
    ("sensor", "is_range_known"),
    [
        (SENSOR, True),
        (CUBIC, False),
        (jl.Sensor(frames=16, max_intensity=50.0), False),
    ],
    ids=["known", "smooth kernel", "above saturation"],
)
def test_any_other_range_stays(sensor, is_range_known):
    choice = choose_method(sensor, requested="mle", is_range_known=is_range_known)
    assert choice.max_intensity == sensor.max_intensity
    assert choice.saturation is None
    assert choice.notes == ()


def test_the_title_states_that_a_network_is_for_one_k():
    one, any_k = jl.Sensor(frames=16), jl.Sensor(frames=17)
    assert choose_method(one, requested="network-two-layer").title.endswith(", for K = 16")
    assert choose_method(any_k, requested="network-two-layer").title == "network, two-layer"
    bits = one.expose(np.full((8, 8), 0.5), rng=0)
    for options, title in (
        ({}, "network, small, for K = 16"),
        ({"fallback": True}, "network, small"),
    ):
        _, info = jl.reconstruct(bits, quality="small", return_info=True, **options)
        assert info.title.startswith(title)
        assert ("for K" in info.title) == ("for K" in title)
    found = jl.compare(["network-small"], np.full((8, 8), 0.5), one)
    assert "network, small, for K = 16" in str(found)
