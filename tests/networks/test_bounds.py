"""Any network either is refused, or returns finite estimates in [0, S] for all data."""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jotlight as jl
from any_sensor import assert_in_range, without_warnings
from jotlight.networks.files.network_files import write_network
from reference import deep, networks

LARGEST = float(np.finfo(np.float32).max)
SUBNORMAL = float(np.finfo(np.float32).smallest_subnormal)
MAGNITUDES = st.sampled_from(
    [*[None] * 5, 0.0, SUBNORMAL, 1e-20, 1e6, 1e9, 1e15, 1e29, 1e36, LARGEST]
)
"""Largest absolute value of an array. None leaves the array unchanged."""
STARTS = st.sampled_from([0.0, -0.0, SUBNORMAL, -1.0, 1e20, -LARGEST, LARGEST])
SPACINGS = st.sampled_from([1.2e-38, 1e-20, 0.5, 1e20, LARGEST])
ONE = np.ones((1, 1, 1, 1), np.float32)
LINE = np.array([[0.0, 0.0, 1.0, 1.0]])


def scaled(array, magnitude):
    """Return an array with a largest absolute value of `magnitude`, and some zeros of any sign."""
    array = array.astype(np.float64)
    array = array / np.abs(array).max() * magnitude
    array.flat[:: max(3, array.size // 7)] *= -0.0
    return array.astype(np.float32)


@st.composite
def absurd_layers(draw, layers):
    """Return the layers with extreme taps, coefficients, and knots in some of them."""
    found = []
    for layer in layers:
        changes = {}
        for name in "filters", "coefficients":
            array, magnitude = getattr(layer, name), draw(MAGNITUDES)
            if array is not None and magnitude is not None:
                changes[name] = scaled(array, magnitude)
        if draw(st.booleans()):
            changes |= {"start": draw(STARTS), "spacing": draw(SPACINGS)}
        found.append(dataclasses.replace(layer, **changes))
    return found


@st.composite
def absurd_networks(draw):
    """Return a network of any kind, or None where it was refused, and a sensor for its data."""
    rng = np.random.default_rng(draw(st.integers(0, 3)))
    sensor = jl.Sensor(
        oversampling=2,
        frames=3,
        gain=draw(st.sampled_from([1e-17, 1e-6, 12.0, 1e18])),
        max_intensity=draw(st.sampled_from([1e-18, 0.3, 1e18])),
        threshold=draw(st.sampled_from([1, 2, 65_535])),
    )
    tied, kind = draw(st.booleans()), draw(st.sampled_from(["graph", "sequence", "conditional"]))
    if kind == "graph":
        made = deep.random_graph(rng, sensor, tied=tied)
    elif kind == "sequence":
        made = networks.random_network(rng, sensor, [2, 5, 1], [(3, 3), (6, 5)], tied=tied)
    else:
        made = deep.conditional_network(seed=rng.integers(9))
    try:
        layers = draw(absurd_layers(made.layers))
        return jl.Network(layers, made.sensor, trials_range=made.trials_range), sensor
    except ValueError as error:
        if "layers: expected taps and coefficients that keep" not in str(error):
            raise
        return None, sensor


def adversarial_bits(sensor, height, width):
    shape = sensor.frames, height * sensor.oversampling, width * sensor.oversampling
    bits = np.indices(shape).sum(0) % 2 == 0
    bits[..., : shape[2] // 3], bits[..., shape[2] // 3 : shape[2] // 2] = False, True
    return jl.Bits.from_array(bits)


@pytest.mark.slow
@given(absurd_networks(), st.sampled_from([(1, 1), (5, 1), (7, 13)]), st.booleans())
@settings(max_examples=150)
def test_a_file_with_any_parameters_is_refused_or_stays_in_its_range(case, size, masked):
    network, sensor = case
    if network is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.safetensors"
        network.save(path)
        network = jl.Network.load(path)
    bits = adversarial_bits(sensor, *size)
    if masked:
        mask = np.ones(bits.shape[1:], bool)
        mask[0, 0] = False
        sensor = sensor.replace(mask=mask)
    estimate = without_warnings(network.reconstruct, bits, sensor)
    assert_in_range(estimate, sensor)


def test_a_file_whose_values_overflow_is_refused(tmp_path):
    sensor = jl.Sensor(oversampling=4)
    network, path = jl.Network.initial(sensor), tmp_path / "model.safetensors"
    first, second = network.layers
    absurd = dataclasses.replace(second, filters=second.filters * np.float32(1e36))
    with pytest.raises(ValueError, match=r"keep the values of layer 1 within 1e30, got"):
        jl.Network([first, absurd], sensor)
    network.layers = first, absurd
    write_network(path, network)
    with pytest.raises(ValueError, match=r"model\.safetensors: damaged network file: .*layer 1"):
        jl.Network.load(path)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(-6.7e28, 6.7e28, (0, 0.7)), (-6.7e28, -1, (0, 0)), (1, 6.7e28, (0.7, 0.7))],
)
def test_a_network_with_absurd_last_coefficients_is_clipped(low, high, expected):
    sensor = jl.Sensor(frames=16, max_intensity=0.7)
    first, second = jl.Network.initial(sensor).layers
    ramp = np.linspace(low, high, second.spline_coefficients.shape[1])[None]
    network = jl.Network([first, dataclasses.replace(second, coefficients=ramp)], sensor)
    estimate = network.reconstruct(np.arange(17)[None])
    np.testing.assert_array_equal(estimate[0, [0, -1]], np.float32(expected))


def test_a_network_without_a_last_spline_is_clipped():
    layers = [jl.Layer(ONE, None), jl.Layer(-0.5 * ONE, None), jl.Layer(-0.25 * ONE, None)]
    network = jl.Network(layers, jl.Sensor(frames=16, max_intensity=1.5))
    estimate = network.reconstruct(np.array([[0, 8, 16]]))
    np.testing.assert_array_equal(estimate, [[0, 1, 1.5]])
    network = jl.Network([*layers[:2], jl.Layer(ONE, None)], network.sensor)
    np.testing.assert_array_equal(network.reconstruct(np.array([[0, 8, 16]])), [[0, 0, 0]])


def test_the_probabilities_of_a_k_conditioned_network_do_not_depend_on_the_largest_intensity():
    network = deep.conditional_network()
    counts = deep.random_counts(jl.Sensor(frames=9), 20, 30)
    wide, narrow = (jl.Sensor(frames=9, max_intensity=S) for S in (5.0, 0.4))
    expected = network.reconstruct(counts, wide).clip(0, np.float32(0.4))
    # The wide one is computed from the zeros.
    np.testing.assert_allclose(network.reconstruct(counts, narrow), expected, atol=1e-6)


@pytest.mark.parametrize(("frames", "tied"), [(1, True), (16, False)])
def test_a_tied_filter_weighs_all_bits_of_a_pixel(frames, tied):
    sensor = jl.Sensor(frames=frames)
    block = (1, 1, 1) if tied else (frames, 1, 1)
    jl.Network([jl.Layer(np.full((1, *block), 0.9e30 / frames), LINE)], sensor)
    with pytest.raises(ValueError, match="layer 0 within 1e"):
        jl.Network([jl.Layer(np.full((1, *block), 1.1e30 / frames), LINE)], sensor)
    with pytest.raises(ValueError, match="layer 0 within 1e"):
        jl.Network([jl.Layer(ONE * np.float32(1e29), LINE)], jl.Sensor(frames=16))
