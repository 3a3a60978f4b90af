"""The choice of the method with and without a trained network for the sensor."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from jotlight.evaluation.records.weights import weight_files, weights_sha256
from jotlight.images.io import read_image
from jotlight.networks.pretrained import pretrained, uses_conditional

SUPPORTED = jl.Sensor(oversampling=4)
OTHER = jl.Sensor(oversampling=2, frames=100)
TOTAL_VARIATION = "non-iterative, total variation"


def expose(photo_folder, sensor):
    bits = sensor.expose(read_image(photo_folder / "0.png"), rng=0)
    jl.save(bits, "bits.npy")
    return bits


@pytest.mark.parametrize("options", [("-m", "held-out"), ("--fallback",)], ids=str)
def test_the_record_of_aligned_colors_states_all_networks_of_the_blend(run, tmp_path, options):
    sensor = jl.Sensor(frames=16, mosaic="RGBW")
    jl.save(sensor.expose(np.full((16, 16, 3), 0.3), rng=0), tmp_path / "bits.npy")
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy", "--motion", *options)
    assert status == 0, output
    assert "best blend on held-out bits, color differences (" in " ".join(output.split())
    origin = json.loads(Path("out.npy.json").read_text())["origin"]
    expected = weights_sha256(weight_files([sensor], "held-out", None, is_color=True))
    assert origin["weights_sha256"] == expected
    assert len(expected) == 3


def test_reconstruct_uses_the_trained_network_and_prints_its_name(run, photo_folder):
    bits = expose(photo_folder, SUPPORTED)
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy")
    assert status == 0
    assert "by network, medium in" in output
    assert "trained network" not in output
    np.testing.assert_array_equal(np.load("out.npy"), pretrained(SUPPORTED).reconstruct(bits))
    names = {"network-two-layer": "two-layer"} | {
        f"network-{name}": name for name in ("small", "medium", "large")
    }
    for method, quality in names.items():
        assert run("reconstruct", "bits.npy", "-o", "same.npy", "-m", method)[0] == 0
        expected = pretrained(SUPPORTED, quality).reconstruct(bits)
        np.testing.assert_array_equal(np.load("same.npy"), expected)


def test_the_precision_of_the_products_is_an_option(run, photo_folder):
    bits = expose(photo_folder, SUPPORTED)
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--precision"]
    assert run(*arguments, "bf16")[0] == 0
    expected = jl.reconstruct(bits, precision="bf16")
    np.testing.assert_array_equal(np.load("out.npy"), expected)
    assert json.loads(Path("out.npy.json").read_text())["origin"]["options"]["precision"] == "bf16"
    assert "bf16" in run("info", "out.npy")[1]
    assert run(*arguments, "f32")[0] == 0
    np.testing.assert_array_equal(np.load("out.npy"), jl.reconstruct(bits))
    for others, message in (
        (["bf16", "-m", "mle"], "precision: expected f32 for mle, got bf16"),
        (["bf16", "--quality", "two-layer"], "precision: expected f32, because no layer"),
        (["bf16", "--fallback"], "precision: expected f32 for a network with fallback"),
        (["f16"], "precision: expected one of f32, bf16, got 'f16'"),
    ):
        status, output = run(*arguments, *others)
        assert (status, message in output) == (1, True), output


def test_many_trials_are_estimated_by_the_blend_on_held_out_bits(run, photo_folder):
    sensor = jl.Sensor(oversampling=2, frames=300, gain=240.0)
    bits = expose(photo_folder, sensor)
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy")
    assert status == 0
    assert re.search(r"by best blend on held-out bits \(\d+% network, .* likelihood\) in", output)
    np.testing.assert_array_equal(np.load("out.npy"), METHODS["held-out"].run(bits, sensor))


def test_a_model_file_takes_precedence_without_advice(run, photo_folder):
    for sensor in (SUPPORTED, OTHER):
        bits = expose(photo_folder, sensor)
        network = jl.Network.initial(sensor, sigma=1.0)
        network.save("own.safetensors")
        arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--model", "own.safetensors"]
        status, output = run(*arguments)
        assert status == 0
        assert "trained network" not in output
        np.testing.assert_array_equal(np.load("out.npy"), network.reconstruct(bits))


def test_the_option_inverse_selects_the_noniterative_method(run, photo_folder):
    bits = expose(photo_folder, SUPPORTED)
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--inverse", "algebraic"]
    status, output = run(*arguments)
    assert status == 0
    assert f"by {TOTAL_VARIATION} in" in output
    expected = METHODS["noniterative-tv"].run(bits, SUPPORTED, inverse="algebraic")
    np.testing.assert_array_equal(np.load("out.npy"), expected)


@pytest.mark.parametrize(
    "quality", ["two-layer", "small", pytest.param("medium", marks=pytest.mark.slow)]
)
def test_options_that_change_the_sensor_decide_which_network_serves_it(run, photo_folder, quality):
    bits = expose(photo_folder, SUPPORTED)
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--gain", 8, "--quality", quality]
    status, output = run(*arguments)
    assert status == 0
    assert f"by network, {quality} in" in output
    sensor = SUPPORTED.replace(gain=8.0, max_intensity=np.load("out.npy").max())
    expected = pretrained(sensor, quality).reconstruct(bits.counts(4), sensor)
    np.testing.assert_allclose(np.load("out.npy"), expected, rtol=1e-5)


def test_counts_are_reconstructed_by_the_network(run, photo_folder):
    counts = expose(photo_folder, SUPPORTED).counts(4)
    np.save("counts.npy", counts)
    for arguments in (["-t", 16], ["-k", 4]):
        status, output = run("reconstruct", "counts.npy", "-o", "out.npy", *arguments)
        assert status == 0
        assert "by network, medium in" in output
        expected = pretrained(SUPPORTED).reconstruct(counts, SUPPORTED)
        np.testing.assert_array_equal(np.load("out.npy"), expected)


@pytest.mark.slow
def test_compare_shows_the_trained_network_where_there_is_one(run, photo_folder):
    status, output = run("compare", photo_folder / "0.png", "-k", 2, "-t", 4)
    assert status == 0
    assert "network, two-layer" in output
    assert "network, initial" in output
    assert "Without the trained network" not in output


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:a cubic kernel spreads")
def test_compare_shows_the_trained_networks_for_every_sensor(run, photo_folder):
    for options in (["-t", 3], ["-t", 3, "--kernel", "cubic"]):
        status, output = run("compare", photo_folder / "0.png", "-k", 2, *options)
        assert status == 0
        assert "network, two-layer" in output
        assert "network, medium" in output


@pytest.mark.parametrize(
    ("sensor", "quality"), [(SUPPORTED, "two-layer"), (OTHER, "two-layer"), (OTHER, "medium")]
)
def test_a_network_falls_back_on_request(run, photo_folder, sensor, quality):
    bits = expose(photo_folder, sensor)
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--quality", quality, "--fallback"]
    status, output = run(*arguments)
    assert status == 0
    assert re.search(rf"by network, {quality} \(\d+% network, \d+% total variation, ", output)
    expected = jl.reconstruct(bits, quality=quality, fallback=True)
    np.testing.assert_array_equal(np.load("out.npy"), expected)
    status, output = run(*arguments[:4], "-m", "mle", "--fallback")
    assert status == 1
    assert output == "error: fallback: is for networks, but the method is mle\n"


@pytest.mark.filterwarnings("always::jotlight.JotlightWarning")
def test_the_intervals_of_a_blend_are_not_those_of_its_network(run):
    bits = jl.Sensor(frames=16).expose(0.1 + 0.8 * (np.indices((48, 48)).sum(0) % 2), rng=0)
    jl.save(bits, "bits.npy")
    arguments = ["reconstruct", "bits.npy", "-o", "out.npy", "--uncertainty", "u.npz"]
    advice = "look unlike photographs"
    assert advice in run(*arguments, "--quality", "large")[1]
    status, output = run(*arguments, "--quality", "large", "--fallback")
    assert (status, advice in output) == (0, False)
    expected = jl.uncertainty(bits, quality="large", fallback=True)
    np.testing.assert_array_equal(np.load("u.npz")["low"], expected.low)


PHOTOGRAPH = jl.datasets.photograph("camera")[100:124, 180:204]

DARK = np.full((96, 96), 0.3, np.float32)
DARK[::5] = 2.0
DARK[::5, ::2] = np.float32(0.05)

# Sensors for which no network for one K was trained.
OTHERS = {
    "frames": jl.Sensor(frames=30),
    "threshold": jl.Sensor(oversampling=4, threshold=2),
    "half the light": jl.Sensor(oversampling=4, gain=8.0),
    "a third of the light": jl.Sensor(oversampling=4, gain=16 / 3),
    "efficiency": jl.Sensor(oversampling=4, efficiency=2 / 3),
    "range": jl.Sensor(oversampling=4, max_intensity=2.0),
    "odd range": jl.Sensor(oversampling=4, max_intensity=4 / 3),
    "dark counts": jl.Sensor(oversampling=4, dark_counts=0.2),
    "map of dark counts": jl.Sensor(oversampling=4, dark_counts=DARK),
    "many changes": jl.Sensor(
        frames=2, threshold=3, gain=10, efficiency=0.7, max_intensity=0.5, dark_counts=0.1
    ),
    "cubic": jl.Sensor(oversampling=4, kernel="cubic"),
    "linear": jl.Sensor(oversampling=4, kernel="linear"),
}


@pytest.mark.parametrize("sensor", OTHERS.values(), ids=OTHERS)
@pytest.mark.parametrize("quality", ["two-layer", "small"])
def test_conditional_networks_serve_every_sensor(sensor, quality):
    assert uses_conditional(sensor, quality)
    bits = bits_of(sensor)
    estimate = pretrained(sensor, quality).reconstruct(bits)
    assert estimate.min() >= 0
    assert estimate.max() <= sensor.max_intensity
    simple = jl.mle(
        bits if sensor.kernel == "box" else bits.counts(4), sensor.replace(kernel="box")
    )
    truth = np.minimum(PHOTOGRAPH, sensor.max_intensity)
    assert jl.metrics.psnr(estimate, truth) > jl.metrics.psnr(simple, truth)


def bits_of(sensor):
    """Return the bits of a photograph of 24 x 24 pixels."""
    return sensor.expose(PHOTOGRAPH, rng=0)
