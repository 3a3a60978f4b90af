"""Colors of images with three counts per pixel."""

import json
import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets import photograph
from jotlight.formats.files.checksums import file_checksum
from jotlight.metrics import psnr
from jotlight.networks.pretrained import CHANNELS_FILE

SCENE = photograph("astronaut")[:256:4, 100:356:4].astype(np.float64)


def draw(trials, seed=0, scene=SCENE, **parameters):
    sensor = jl.Sensor(frames=trials, **parameters)
    return sensor, sensor.expose(scene, rng=seed, channel_axis=-1)


@pytest.mark.parametrize("trials", [4, 16, 64])
def test_the_color_network_is_the_default_and_better_than_gray_ones(trials):
    _, bits = draw(trials)
    found, info = jl.reconstruct(bits, return_info=True)
    assert (info.method, info.title) == ("network-color", "network, color")
    assert found.shape == SCENE.shape
    gray = jl.reconstruct(bits, quality="medium")
    assert psnr(found, SCENE, data_range=1.0) > 0.5 + psnr(gray, SCENE, data_range=1.0)


@pytest.mark.slow
def test_all_kinds_of_data_have_the_same_result():
    sensor, bits = draw(8)
    expected = jl.reconstruct(bits)
    counts = bits.counts()
    np.testing.assert_array_equal(jl.reconstruct(counts, sensor, channel_axis=-1), expected)
    first = np.moveaxis(counts, -1, 0)
    found = jl.reconstruct(first, sensor, channel_axis=0)
    np.testing.assert_array_equal(np.moveaxis(found, 0, -1), expected)
    other = draw(8, seed=1)[1]
    both = jl.reconstruct([bits, other])
    np.testing.assert_array_equal(both[0], expected)
    np.testing.assert_array_equal(both[1], jl.reconstruct(other))
    out = np.empty_like(expected)
    assert jl.reconstruct(bits, out=out) is out
    np.testing.assert_array_equal(out, expected)


def test_any_number_of_threads_has_the_same_result():
    _, bits = draw(8)
    one, two = (jl.reconstruct(bits, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_the_order_of_the_channels_hardly_matters():
    _, bits = draw(16)
    counts = bits.counts()
    sensor = bits.sensor
    straight = jl.reconstruct(counts, sensor, channel_axis=-1)
    turned = jl.reconstruct(counts[..., ::-1].copy(), sensor, channel_axis=-1)[..., ::-1]
    assert abs(psnr(turned, SCENE, data_range=1.0) - psnr(straight, SCENE, data_range=1.0)) < 0.5


def test_dead_jots_are_filled_and_maps_count():
    rng = np.random.default_rng(0)
    mask = rng.random((64, 64)) < 0.03
    shade = np.linspace(0.5, 1, 64, dtype=np.float32) * np.ones((64, 1), np.float32)
    _, bits = draw(64, mask=mask, efficiency=shade)
    _, whole = draw(64)
    with pytest.warns(jl.JotlightWarning, match="no valid bit"):
        found = jl.reconstruct(bits)
    usual = psnr(jl.reconstruct(whole), SCENE, data_range=1.0)
    assert psnr(found, SCENE, data_range=1.0) > usual - 2


def test_a_flat_color_stays_flat():
    scene = np.ones((64, 64, 3)) * [0.7, 0.3, 0.1]
    _, bits = draw(64, scene=scene)
    found = jl.reconstruct(bits)
    np.testing.assert_allclose(found.mean((0, 1)), [0.7, 0.3, 0.1], atol=0.01)
    assert found.std((0, 1)).max() < 0.02


@pytest.mark.parametrize("extreme", [0, 1])
def test_extreme_counts_stay_in_the_range(extreme):
    counts = np.full((16, 16, 3), 16 * extreme)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the largest intensity, which all pixels have
        found = jl.reconstruct(counts, jl.Sensor(frames=16), channel_axis=-1)
    assert ((found >= 0) & (found <= 1)).all()
    assert np.abs(found - extreme).max() < 0.01


def test_overexposed_pixels_are_white():
    image = np.full((32, 48, 3), 0.4)
    image[:, 24:] = 20.0
    for sensor, channel_axis in (
        (jl.Sensor(frames=16), -1),
        (jl.Sensor(frames=16, mosaic="RGGB"), None),
    ):
        bits = sensor.replace(max_intensity=20.0).expose(image, rng=0, channel_axis=-1)
        counts = bits.counts()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the largest intensity, as above
            found = jl.reconstruct(counts, sensor, channel_axis=channel_axis)
        assert found[4:-4, 30:-4].min() > 0.98


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        pytest.param({"gain": [0.5, 2.0] * 4}, marks=pytest.mark.slow),
        {"mosaic": "RGGB"},
    ],
    ids=str,
)
def test_the_color_network_is_requested_by_its_name(parameters):
    sensor = jl.Sensor(frames=8, **parameters)
    bits = sensor.expose(SCENE[:32, :32], rng=0, channel_axis=-1)
    expected, info = jl.reconstruct(bits, return_info=True)
    assert info.reason in ("recommended for colors", "recommended for mosaics")
    found, again = jl.reconstruct(bits, method=info.method, return_info=True)
    np.testing.assert_array_equal(found, expected)
    assert (again.method, again.title, again.reason) == (info.method, info.title, "requested")
    known, errors = (jl.uncertainty(bits, method=each) for each in (None, info.method))
    np.testing.assert_array_equal(errors.standard_error, known.standard_error)


def test_many_trials_may_have_the_color_network_alone():
    counts, sensor = np.full((8, 8, 3), 1200), jl.Sensor(frames=2000)
    options = {"channel_axis": -1, "method": "network-color", "return_info": True}
    assert jl.reconstruct(counts, sensor, **options)[1].title == "network, color"


def test_other_colors_and_requests_have_gray_estimates():
    sensor, bits = draw(8)
    counts = bits.counts()
    for data, options in (
        (counts[..., :2].copy(), {"channel_axis": -1}),
        (counts, {"channel_axis": -1, "quality": "medium"}),
        (np.moveaxis(counts, -1, 0).copy(), {}),
    ):
        _, info = jl.reconstruct(data, sensor, return_info=True, **options)
        assert info.method == "network-medium"


@pytest.mark.parametrize(
    "parameters",
    [
        pytest.param({"bit_depth": 4, "read_noise": 0.3}, marks=pytest.mark.slow),
        {"gain": [0.5, 2.0] * 8},
        pytest.param({"threshold": [1, 2] * 8}, marks=pytest.mark.slow),
    ],
)
def test_equivalent_counts_have_colors_too(parameters):
    sensor = jl.Sensor(frames=16, **parameters)
    data = sensor.expose(SCENE, rng=0, channel_axis=-1)
    found, info = jl.reconstruct(data, return_info=True)
    assert info.method == "network-color"
    gray = jl.reconstruct(data, quality="medium")
    assert psnr(found, SCENE, data_range=1.0) > 0.2 + psnr(gray, SCENE, data_range=1.0)


def test_counts_may_have_more_trials_than_their_sensor():
    counts = np.full((8, 8, 3), 600)
    _, info = jl.reconstruct(
        counts, jl.Sensor(frames=4), channel_axis=-1, trials=2000, return_info=True
    )
    assert info.method == "network-color"


@pytest.mark.slow
def test_intervals_of_colors_contain_the_truth():
    scene = photograph("astronaut")[:384:2, 100:484:2].astype(np.float64)
    _, bits = draw(16, scene=scene)
    known = jl.uncertainty(bits, confidence_level=0.9)
    assert 0.85 < ((known.low <= scene) & (scene <= known.high)).mean() < 0.99


def test_merged_counts_need_bits_of_all_colors():
    rng = np.random.default_rng(0)
    sensor, bits = draw(8)
    counts = bits.counts()
    few = np.full(counts.shape, 8.0)
    few[..., 0] = rng.choice([0.0, 8.0], few.shape[:2], p=[0.04, 0.96])
    merged = jl.Merged(np.where(few > 0, counts, 0), few, sensor, channel_axis=-1)
    found, info = jl.reconstruct(merged, return_info=True)
    assert info.method == "network-color"
    assert psnr(found, SCENE, data_range=1.0) > psnr(
        jl.reconstruct(merged, quality="medium"), SCENE, data_range=1.0
    )
    whole = jl.Merged(counts, 8, sensor, channel_axis=-1)
    np.testing.assert_array_equal(jl.reconstruct(whole), jl.reconstruct(bits))
    few[:20, :, 2] = 0
    merged = jl.Merged(np.where(few > 0, counts, 0), few, sensor, channel_axis=-1)
    _, info = jl.reconstruct(merged, return_info=True)
    assert info.method == "network-medium"
    with pytest.raises(ValueError, match=r"a color network takes .* got other data"):
        jl.reconstruct(merged, method="network-color")


def test_the_command_line_reconstructs_colors_and_records_the_weights(run, tmp_path):
    jl.save_image(tmp_path / "scene.png", SCENE.astype(np.float32))
    assert run("simulate", "scene.png", "-k", 1, "-t", 16, "-o", "bits.npy")[0] == 0
    bits = jl.open(tmp_path / "bits.npy")
    assert bits.shape == (16, 64, 64, 3)
    status, printed = run("reconstruct", "bits.npy", "-o", "out.npy")
    assert status == 0, printed
    assert "by network, color in" in printed
    np.testing.assert_allclose(np.load(tmp_path / "out.npy"), jl.reconstruct(bits), atol=1e-6)
    record = json.loads((tmp_path / "out.npy.json").read_text())["origin"]
    assert file_checksum(CHANNELS_FILE) in record["weights_sha256"]
    status, printed = run("reconstruct", "bits.npy", "-o", "named.npy", "--method", "network-color")
    assert status == 0, printed
    np.testing.assert_array_equal(np.load(tmp_path / "named.npy"), np.load(tmp_path / "out.npy"))
    named = json.loads((tmp_path / "named.npy.json").read_text())["origin"]
    assert named["weights_sha256"] == record["weights_sha256"]
    status, printed = run("reconstruct", "bits.npy", "-o", "gray.npy", "--quality", "medium")
    assert status == 0, printed
    assert "by network, medium in" in printed
