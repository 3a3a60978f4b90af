"""The trained networks that come with jotlight."""

import functools
import re

import numpy as np
import pytest
from scipy.interpolate import BSpline

import jotlight as jl
from jotlight.networks.pretrained import FOLDER, TRAINED_TRIALS, pretrained, uses_conditional
from jotlight.training import SafeSet, parameter_vector

SPACE = [jl.Sensor(oversampling=round(bits**0.5)) for bits in TRAINED_TRIALS]
TIME = [jl.Sensor(frames=bits) for bits in TRAINED_TRIALS]
MIXED = [
    jl.Sensor(oversampling=2, frames=4),
    jl.Sensor(oversampling=3, frames=4),
    jl.Sensor(oversampling=2, frames=9),
    jl.Sensor(oversampling=5, frames=4),
]

by_bits = pytest.mark.parametrize("bits", TRAINED_TRIALS)


@functools.cache
def two_layer_network(bits):
    return jl.Network.load(FOLDER / f"two-layer-k{bits}.safetensors")


@functools.cache
def camera():
    return jl.datasets.photograph("camera")


def test_two_layer_networks_exist_for_eight_values_of_k():
    assert TRAINED_TRIALS == (9, 16, 25, 36, 49, 64, 81, 100)


@pytest.mark.parametrize("sensor", [*SPACE, *TIME, *MIXED], ids=repr)
def test_one_tied_network_serves_jots_and_frames(sensor):
    assert not uses_conditional(sensor, "two-layer")
    network = pretrained(sensor, "two-layer")
    assert network.tied
    np.testing.assert_array_equal(
        parameter_vector(network), parameter_vector(two_layer_network(sensor.trials))
    )
    image = camera()[100:130, 180:220]
    bits = sensor.expose(image, rng=0)
    estimate = network.reconstruct(bits)
    assert estimate.shape == image.shape
    assert jl.metrics.psnr(estimate, image) > jl.metrics.psnr(jl.mle(bits, sensor), image) + 1
    counts = bits.counts(sensor.oversampling)
    np.testing.assert_array_equal(network.reconstruct(counts, sensor), estimate)


def test_changes_of_a_nested_history_stay_with_their_copy():
    first, second = (pretrained(jl.Sensor(frames=16), "small") for _ in range(2))
    first.history["stages"][-1]["run"]["patches"] = "changed"
    first.history["stages"][-1]["records"]["loss"].append("changed")
    assert second.history["stages"][-1]["run"].get("patches") != "changed"
    assert second.history["stages"][-1]["records"]["loss"][-1] != "changed"
    assert pretrained(jl.Sensor(frames=16), "small").history == second.history


@pytest.mark.parametrize("quality", ["medium", "extra-large"])
def test_a_network_is_read_once_and_its_copies_are_independent(quality):
    first = pretrained(jl.Sensor(frames=20), quality)
    rotations, history = first.rotations, dict(first.history)
    engine_network = first.engine_network
    first.rotations, first.history["note"] = 2, "changed"
    second = pretrained(jl.Sensor(frames=30), quality)
    assert (second.rotations, second.history) == (rotations, history)
    assert (first.default_sensor.frames, second.default_sensor.frames) == (20, 30)
    assert second.engine_network is engine_network


@by_bits
def test_a_file_is_small_and_has_a_card(bits):
    assert (FOLDER / f"two-layer-k{bits}.safetensors").stat().st_size < 20_000
    assert sorted(path.name for path in FOLDER.glob(f"two-layer-k{bits}.*")) == [
        f"two-layer-k{bits}.md",
        f"two-layer-k{bits}.safetensors",
    ]


@by_bits
def test_a_card_states_data_command_seed_and_scores(bits):
    lines = (FOLDER / f"two-layer-k{bits}.md").read_text(encoding="utf-8")
    card = " ".join(lines.split())
    assert f"K = {bits} " in card
    assert "BSDS300" in card
    assert f"tools/train.py DATA --only two-layer-k{bits}`" in card
    run = two_layer_network(bits).history["stages"][-1]["run"]
    assert f"seed {run['seed']};" in card
    assert f"{run['steps']} steps of {run['batch']} patches of {run['patch']}" in card
    assert not re.search(r"[{}]|\bnan\b", card)
    quality = float(re.search(r"PSNR ([\d.]+) dB \(first 20", card)[1])
    likelihood = float(re.search(r"likelihood on the same bits:\s+PSNR ([\d.]+) dB", card)[1])
    assert likelihood + 3 < quality < 40
    parameters = int(re.search(r"(\d+) parameters", card)[1])
    assert parameters == parameter_vector(two_layer_network(bits)).size


@by_bits
def test_a_network_was_trained_for_its_sensor_as_its_card_states(bits):
    network = two_layer_network(bits)
    assert network.sensor == jl.Sensor(oversampling=round(bits**0.5))
    assert network.history["stages"][-1]["data"] == "BSDS300 train, gray"
    loss = network.history["stages"][-1]["records"]["loss"]
    assert len(loss) == network.history["stages"][-1]["run"]["steps"] + 1
    assert loss[-1] < loss[0]


@by_bits
def test_the_parameters_are_admissible(bits):
    vector = parameter_vector(two_layer_network(bits))
    projected = SafeSet().project(two_layer_network(bits), vector)
    # Up to the rounding of float32.
    np.testing.assert_allclose(vector, projected, rtol=1e-6, atol=1e-6)


@by_bits
def test_splines_do_not_fall(bits):
    for layer in two_layer_network(bits).layers:
        [coefficients] = layer.coefficients.astype(float)
        knots = layer.start + layer.spacing * (np.arange(len(coefficients) + 4) - 3)
        z = np.linspace(knots[3], knots[-4], 10_000)
        slopes = BSpline(knots, coefficients, 3).derivative()(z)
        assert slopes.min() >= -1e-6 * np.ptp(coefficients) / layer.spacing
        assert coefficients[-1] > coefficients[0]


@by_bits
def test_estimates_lie_in_0_to_1_for_any_counts(bits):
    sensor, rng = jl.Sensor(frames=bits), np.random.default_rng(bits)
    shape = (40, 50)
    scenes = {
        "none": np.zeros(shape, int),
        "all": np.full(shape, bits),
        "random": rng.integers(0, bits + 1, shape),
        "extreme": bits * rng.integers(0, 2, shape),
        "point": bits * (np.arange(2000).reshape(shape) == 1025),
    }
    estimates = {
        name: two_layer_network(bits).reconstruct(counts, sensor) for name, counts in scenes.items()
    }
    for estimate in estimates.values():
        assert estimate.min() >= 0
        assert estimate.max() <= 1
    # The black of photographs is rarely 0. The bound is 8 levels of 255.
    assert estimates["none"].max() < 0.03
    assert estimates["all"].min() > 0.98


def test_more_bits_improve_the_estimate():
    image = camera()[100:300, 100:300]
    quality = []
    for sensor in SPACE:
        estimate = pretrained(sensor, "two-layer").reconstruct(sensor.expose(image, rng=0))
        quality.append(jl.metrics.psnr(estimate, image))
    assert (np.diff(quality) > 0.1).all()


def test_networks_serve_dead_jots():
    image = camera()[100:150, 100:150]
    mask = np.random.default_rng(0).random((200, 200)) < 0.1
    sensor = jl.Sensor(oversampling=4, mask=mask)
    bits = sensor.expose(image, rng=0)
    masked = jl.metrics.psnr(pretrained(sensor, "two-layer").reconstruct(bits), image)
    whole = jl.Sensor(oversampling=4)
    unmasked = jl.metrics.psnr(
        pretrained(whole, "two-layer").reconstruct(whole.expose(image, rng=0)), image
    )
    # A tenth less light costs at most a tenth of the noise power, 0.5 dB.
    assert unmasked - 0.6 < masked < unmasked + 0.6


def test_networks_serve_color_channel_by_channel():
    image = jl.datasets.photograph("coffee")[100:140, 180:229]
    sensor = jl.Sensor(oversampling=4)
    bits = sensor.expose(image, rng=0, channel_axis=-1)
    estimate = pretrained(sensor, "two-layer").reconstruct(bits)
    assert estimate.shape == image.shape
    assert jl.metrics.psnr(estimate, image) > jl.metrics.psnr(jl.mle(bits, sensor), image) + 3
    for channel in range(3):
        counts = bits.counts(4)[..., channel]
        np.testing.assert_array_equal(
            pretrained(sensor, "two-layer").reconstruct(counts, sensor), estimate[..., channel]
        )


def test_networks_serve_weak_dark_counts():
    image = camera()[100:200, 100:200]
    sensor = jl.Sensor(oversampling=4, dark_counts=0.05)
    bits = sensor.expose(image, rng=0)
    assert not uses_conditional(sensor, "two-layer")
    estimate = pretrained(sensor, "two-layer").reconstruct(bits)
    assert jl.metrics.psnr(estimate, image) > jl.metrics.psnr(jl.mle(bits, sensor), image) + 5
    assert abs(estimate.mean() - image.mean()) < 0.02


def test_only_the_product_of_efficiency_and_gain_matters():
    assert not uses_conditional(jl.Sensor(frames=16, gain=32, efficiency=0.5), "two-layer")
    assert uses_conditional(jl.Sensor(frames=16, efficiency=0.5), "two-layer")


@pytest.mark.parametrize("quality", ["two-layer", "small"])
def test_at_16_trials_a_network_is_one_for_this_number_alone(quality):
    assert pretrained(jl.Sensor(frames=16), quality).trials_range is None
    for change in ({"frames": 15}, {"max_intensity": 2.0}, {"gain": 8.0}, {"dark_counts": 0.2}):
        sensor = jl.Sensor(frames=16).replace(**change)
        assert uses_conditional(sensor, quality)
        assert pretrained(sensor, quality).trials_range == (1, 256)


def test_files_are_small():
    assert (FOLDER / "medium.safetensors").stat().st_size < 2_600_000
    assert (FOLDER / "large.safetensors").stat().st_size < 4_600_000
    assert sum(file.stat().st_size for file in FOLDER.glob("*.safetensors")) < 20_000_000
    for bits in TRAINED_TRIALS:
        assert (FOLDER / f"small-k{bits}.safetensors").stat().st_size < 60_000


def test_an_unknown_quality_is_refused():
    with pytest.raises(ValueError, match=r"one of two-layer, .*, extra-large, got 'best'"):
        pretrained(jl.Sensor(oversampling=4), "best")


@pytest.mark.parametrize("quality", ["two-layer", "small", "medium", "large"])
def test_a_network_is_bound_to_the_sensor_for_which_it_was_requested(quality):
    sensor = jl.Sensor(oversampling=2, frames=4, dark_counts=0.02)
    bits = sensor.expose(np.full((16, 16), 0.5), rng=0)
    network = pretrained(sensor, quality)
    expected = network.reconstruct(bits)
    np.testing.assert_array_equal(network.reconstruct(bits.counts()), expected)
    np.testing.assert_array_equal(network(bits.counts()), expected)
    np.testing.assert_array_equal(network(bits), expected)
    # Another sensor of the data has precedence.
    other = sensor.replace(dark_counts=0.0)
    found = network(bits.counts(), other, threads=1)
    np.testing.assert_array_equal(found, pretrained(other, quality)(bits.counts()))
