"""Colors of mosaics: planes, their sensors, all kinds of data, and the command line."""

import json
import warnings

import numpy as np
import pytest

import jotlight as jl
from jotlight.datasets import photograph
from jotlight.estimators.demosaicing import demosaic
from jotlight.evaluation.color.mosaics import count_image
from jotlight.formats.files.checksums import file_checksum
from jotlight.networks.color.mosaic_planes import value_weights
from jotlight.networks.pretrained import MOSAIC_FILE
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.reading_groups import without_mosaic

SCENE = photograph("astronaut")[:256:4, 100:356:4].astype(np.float64)
RANDOM = Mosaic(np.random.default_rng(0).integers(4, size=(64, 64)), "RGBW")
RGBW = Mosaic("RGBW")
LINEAR = {"demosaicing": "differences"}


def psnr(estimate, truth=SCENE):
    return -10 * np.log10(np.mean((estimate - truth) ** 2))


@pytest.mark.parametrize("order", ["RGGB", "GBRG", "RGBW", "RGB"])
def test_planes_are_the_images_of_each_position_of_the_period(order):
    mosaic = Mosaic(order)
    sensor = jl.Sensor(oversampling=2, frames=4, dark_counts=0.02, max_intensity=2, mosaic=order)
    plain = without_mosaic(sensor)
    bits = sensor.expose(SCENE[:, :63], rng=0)  # rows and columns that are no multiples
    counts, values = bits.counts(), np.zeros((64, 63))
    rows, columns = mosaic.pattern.shape
    for (row, column), place in np.ndenumerate(mosaic.pattern):
        own = jl.Sensor(
            oversampling=2, frames=4, dark_counts=0.02, max_intensity=2,
            gain=16 * mosaic.sensitivity[place],
        )  # fmt: skip
        part = (slice(row, None, rows), slice(column, None, columns))
        values[part] = jl.reconstruct(counts[part], own, quality="small")
    weights = value_weights(values, count_pixels(counts, plain, None), mosaic)
    expected = np.clip(demosaic(values, mosaic, "differences", weights), 0, 2)
    found, info = jl.reconstruct(bits, quality="small", return_info=True, **LINEAR)
    np.testing.assert_allclose(found, expected, atol=2e-6)
    assert found.shape == (64, 63, 3)
    assert found.dtype == np.float32
    assert (info.method, info.title) == ("network-small", "network, small, color differences")
    assert info.seconds > 0


@pytest.mark.parametrize("method", ["network-medium", "admm-tv"])
def test_saturated_clear_pixels_change_the_mean_little(method):
    # 12 photons behind the clear filter, but 4 behind the others
    bits = jl.Sensor(frames=16, gain=128.0, mosaic="RGBW").expose(np.full((48, 48, 3), 0.5), rng=0)
    found = jl.reconstruct(bits, method=method, **LINEAR)
    np.testing.assert_allclose(found.mean(axis=(0, 1)), 0.5, rtol=0.05)


def test_the_color_network_keeps_the_mean_where_clear_pixels_are_saturated():
    bits = jl.Sensor(frames=4, gain=32.0, mosaic="RGBW").expose(SCENE, rng=0)
    assert jl.reconstruct(bits).mean() == pytest.approx(SCENE.mean(), rel=0.1)


@pytest.mark.parametrize("mosaic", ["RGGB", "RGBW", RANDOM], ids=repr)
def test_networks_are_better_than_maximum_likelihood(mosaic):
    bits = jl.Sensor(frames=16, mosaic=mosaic).expose(SCENE, rng=0)
    assert psnr(jl.reconstruct(bits, quality="small", **LINEAR)) > 1 + psnr(
        jl.reconstruct(bits, method="mle", **LINEAR)
    )


@pytest.mark.parametrize(
    ("mosaic", "trials"),
    [
        ("RGGB", 4),
        ("RGBW", 64),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (("RGGB", 64), ("RGBW", 4), ("GBRG", 4), ("GBRG", 64))
        ),
    ],
)
def test_the_color_network_is_the_default_and_better_than_differences(mosaic, trials):
    bits = jl.Sensor(frames=trials, mosaic=mosaic).expose(SCENE, rng=0)
    found, info = jl.reconstruct(bits, return_info=True)
    assert (info.method, info.title) == ("network-color", "network, color")
    assert found.shape == (64, 64, 3)
    assert 0 <= found.min() <= found.max() <= 1
    np.testing.assert_array_equal(jl.reconstruct(bits, demosaicing="network"), found)
    assert psnr(found) > 0.2 + psnr(jl.reconstruct(bits, quality="medium", **LINEAR))


@pytest.mark.parametrize("method", [None, "mle"])
def test_the_white_balance_does_not_clip_bright_colors(method):
    mosaic = Mosaic("RGGB", white_balance=[1.5, 1.0, 2.0])
    sensor = jl.Sensor(frames=400, mosaic=mosaic)
    bits = sensor.expose(np.full((24, 24, 3), 0.9), rng=0)
    colors = jl.reconstruct(bits, method=method, demosaicing=method and "differences")
    np.testing.assert_allclose(colors.mean(axis=(0, 1)), [1.35, 0.9, 1.8], rtol=0.03)


def test_the_color_network_estimates_each_image_with_the_white_balance():
    mosaic = Mosaic("RGGB", white_balance=[0.5, 1.0, 0.8])
    plain = jl.Sensor(frames=8, mosaic="RGGB", max_intensity=3)
    bits = [plain.expose(SCENE, rng=seed) for seed in (0, 1)]
    counts = np.stack([each.counts() for each in bits])
    expected = np.stack([jl.reconstruct(each) for each in bits])
    np.testing.assert_array_equal(jl.reconstruct(counts, plain, trials=8), expected)
    balanced = jl.reconstruct(counts, plain.replace(mosaic=mosaic, gain=plain.gain))
    np.testing.assert_allclose(balanced, expected * np.float32([0.5, 1.0, 0.8]), rtol=1e-6)


def test_dead_pixels_are_filled_by_the_color_network():
    mask = np.random.default_rng(3).random((64, 64)) < 0.02
    bits = jl.Sensor(frames=64, mosaic="RGGB", mask=mask).expose(SCENE, rng=0)
    with pytest.warns(jl.JotlightWarning, match="have no valid bit"):
        found = jl.reconstruct(bits)
    whole = jl.reconstruct(jl.Sensor(frames=64, mosaic="RGGB").expose(SCENE, rng=0))
    assert psnr(found) > psnr(whole) - 0.5


def test_maps_of_trials_have_planes_by_default():
    sensor = jl.Sensor(mosaic="RGBW", frames=8)
    counts, trials = sensor.expose(SCENE[:32, :32], rng=0).counts(), np.full((32, 32), 8.0)
    _, info = jl.reconstruct(counts, sensor, trials=trials, return_info=True)
    assert info.title == "network, medium, color differences"
    with pytest.raises(ValueError, match='demosaicing: "network" estimates colors without'):
        jl.reconstruct(counts, sensor, trials=trials, demosaicing="network")


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"frames": 4, "gain": [1.0, 2.0, 3.0, 4.0]},
        {"frames": 2, "gain": 3.0, "threshold": [1, 2]},
        {"frames": 8, "gain": 8.0, "bit_depth": 3, "read_noise": 0.3},
    ],
    ids=repr,
)
def test_the_color_network_takes_readings_that_differ(options):
    readings = jl.Sensor(mosaic="RGGB", **options).expose(SCENE, rng=0)
    found, info = jl.reconstruct(readings, return_info=True)
    assert info.method == "network-color"
    assert found.mean() == pytest.approx(SCENE.mean(), rel=0.05)
    assert psnr(found) > psnr(jl.reconstruct(readings, demosaicing="differences")) + 0.5


@pytest.mark.parametrize(
    "options",
    [
        {"frames": 48, "gain": np.repeat([8.0, 1.0, 0.125], 16)},
        {"frames": 16, "gain": 64.0, "threshold": [1, 2, 3, 4] * 4},
        {"frames": 16, "gain": 32.0, "bit_depth": 3, "read_noise": 0.3},
    ],
)
def test_clear_pixels_see_more_than_the_largest_intensity(options):
    # White of 0.8 is 2.4 behind a clear filter.
    sensor = jl.Sensor(mosaic="RGBW", **options)
    white = np.full((64, 64, 3), 0.8)
    merged = count_image(sensor.expose(white, rng=0), without_mosaic(sensor), None, RGBW)
    clear = (slice(1, None, 2), slice(1, None, 2))
    fraction = merged.counts[clear].sum() / merged.trials[clear].sum()
    assert -np.log1p(-fraction) / merged.sensor.light_per_intensity == pytest.approx(2.4, rel=0.03)
    assert merged.sensor.max_intensity == 1


@pytest.mark.parametrize(
    "mosaic", [RANDOM, "CMYG", Mosaic("RGGB", transmission=0.8 * np.eye(3) + 0.1)], ids=repr
)
def test_the_color_network_serves_every_mosaic(mosaic):
    bits = jl.Sensor(frames=32, mosaic=mosaic).expose(SCENE, rng=0)
    found, info = jl.reconstruct(bits, return_info=True)
    assert info.method == "network-color"
    planes, info = jl.reconstruct(bits, return_info=True, **LINEAR)
    assert info.method == "network-medium"
    assert psnr(found) > psnr(planes)


def test_an_unknown_demosaicing_is_refused():
    bits = jl.Sensor(frames=8, mosaic="RGGB").expose(SCENE, rng=0)
    with pytest.raises(ValueError, match="demosaicing: expected one of network, menon, diff"):
        jl.reconstruct(bits, demosaicing="malvar")


@pytest.mark.parametrize(
    "options", [{"method": "mle"}, {"quality": "small"}, {"weight": 1.0}], ids=str
)
def test_the_color_network_takes_no_method(options):
    bits = jl.Sensor(frames=8, mosaic="RGGB").expose(SCENE, rng=0)
    with pytest.raises(ValueError, match="it takes no method, quality, or options"):
        jl.reconstruct(bits, demosaicing="network", **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    "mosaic",
    [
        "RGGB",
        RANDOM,
        "RGB",
        "RRGG/RRGG/GGBB/GGBB",
    ],
    ids=repr,
)
@pytest.mark.parametrize(
    "options",
    [
        {"dark_counts": 0.1, "efficiency": 0.5, "gain": 4000.0},
        {"gain": np.repeat([1.0, 2.0], 1000)},
        {"bit_depth": 3, "frames": 400},
        {"threshold": 2, "gain": 4000.0},
        {"dark_counts": np.linspace(0, 0.5, 4096).reshape(64, 64).astype(np.float32)},
        {"mask": np.random.default_rng(3).random((64, 64)) < 0.05},
    ],
    ids=lambda options: next(iter(options)),
)
@pytest.mark.filterwarnings("ignore:.*have no valid bit")  # those of the mask
def test_many_photons_give_the_color_of_a_uniform_scene(mosaic, options):
    sensor = jl.Sensor(**{"frames": 2000, "max_intensity": 2.0, "mosaic": mosaic} | options)
    side = 64 // sensor.oversampling
    color = np.array([0.5, 0.3, 0.2])
    data = sensor.expose(np.broadcast_to(color, (side, side, 3)), rng=0)
    found = jl.reconstruct(data, method="mle", **LINEAR)
    np.testing.assert_allclose(found.mean(axis=(0, 1)), color, atol=0.01)


def test_counts_lists_stacks_and_out_agree_with_bits():
    sensor = jl.Sensor(frames=8, mosaic="RGGB")
    bits = [sensor.expose(SCENE, rng=seed) for seed in (0, 1)]
    expected = [jl.reconstruct(each, quality="small", **LINEAR) for each in bits]
    counts = np.stack([each.counts() for each in bits])
    options = {"quality": "small", **LINEAR}
    np.testing.assert_array_equal(jl.reconstruct(bits, **options), expected)
    np.testing.assert_array_equal(jl.reconstruct(counts, sensor, **options), expected)
    np.testing.assert_array_equal(
        jl.reconstruct(counts[0], sensor, trials=8, **options), expected[0]
    )
    out = np.empty((2, 64, 64, 3), np.float32)
    assert jl.reconstruct(bits, out=out, **options) is out
    np.testing.assert_array_equal(out, expected)
    photons = jl.reconstruct(bits[0], units="photons", **options)
    gray = jl.reconstruct(counts[0], sensor.replace(mosaic=None), units="photons", quality="small")
    assert photons.mean() == pytest.approx(gray.mean(), rel=0.3)


def test_a_stated_mosaic_is_not_reported_and_a_gray_estimate_stays():
    light = np.full((128, 128, 3), [0.2, 0.4, 0.1])
    sensor = jl.Sensor(frames=400, mosaic="RGGB")
    captured = jl.Bits(sensor.expose(light, rng=0).packed, 128, sensor)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for data in (captured, captured.counts()):
            found = jl.reconstruct(data, sensor, method="mle", **LINEAR)
            np.testing.assert_allclose(found.mean(axis=(0, 1)), [0.2, 0.4, 0.1], atol=0.01)
    with pytest.warns(jl.PeriodicRatesWarning, match=r"mosaic: .* state .*'RGGB'.* but no"):
        jl.reconstruct(captured, sensor.replace(mosaic=None), method="mle")


def test_bad_data_are_refused():
    sensor = jl.Sensor(frames=8, mosaic="RGGB")
    with pytest.raises(ValueError, match=r"expected gray bits or counts.*got color channels"):
        jl.reconstruct(np.zeros((8, 8, 3), int), sensor, channel_axis=-1, **LINEAR)
    with pytest.raises(ValueError, match="demosaicing: is for a sensor with a mosaic"):
        jl.reconstruct(np.zeros((8, 8), int), jl.Sensor(frames=8), **LINEAR)
    with pytest.raises(ValueError, match="out: expected a writeable array of float32 of shape"):
        jl.reconstruct(np.zeros((8, 8), int), sensor, out=np.zeros((8, 8), np.float32), **LINEAR)


@pytest.mark.slow
def test_the_command_line_simulates_and_reconstructs_a_mosaic(run, tmp_path):
    jl.save_image(tmp_path / "scene.png", SCENE.astype(np.float32))
    arguments = ("-k", 1, "-t", 16, "--mosaic", "RGGB", "-o", "bits.npy")
    assert run("simulate", "scene.png", *arguments)[0] == 0
    bits = jl.open(tmp_path / "bits.npy")
    assert bits.sensor == jl.Sensor(frames=16, mosaic="RGGB")
    differences = ("--demosaicing", "differences")
    status, printed = run("reconstruct", "bits.npy", "-o", "out.npy", *differences)
    assert status == 0, printed
    found = np.load(tmp_path / "out.npy")
    np.testing.assert_allclose(found, jl.reconstruct(bits, **LINEAR), atol=1e-6)
    assert "color differences" in printed
    status, printed = run("reconstruct", "bits.npy", "-o", "network.npy")
    assert status == 0, printed
    assert "by network, color in" in printed
    np.testing.assert_allclose(np.load(tmp_path / "network.npy"), jl.reconstruct(bits), atol=1e-6)
    record = json.loads((tmp_path / "network.npy.json").read_text())["origin"]
    assert file_checksum(MOSAIC_FILE) in record["weights_sha256"]
    assert (
        run("reconstruct", "bits.npy", "-o", "o.npy", "--quality", "medium", *differences)[0] == 0
    )
    record = json.loads((tmp_path / "o.npy.json").read_text())["origin"]
    assert file_checksum(MOSAIC_FILE) not in record["weights_sha256"]
    np.save(tmp_path / "raw.npy", np.asarray(bits.packed))
    options = ("-o", "raw_out.npy", "-t", 16, "--max-intensity", 1, "--mosaic", "RGGB")
    assert run("reconstruct", "raw.npy", *options, *differences)[0] == 0
    np.testing.assert_array_equal(np.load(tmp_path / "raw_out.npy"), found)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("simulate", "s.png", "--mosaic", "RXGB", "-o", "b.npy"), "got X"),
        (("simulate", "s.png", "--gray", "--mosaic", "RGGB", "-o", "b.npy"), "red, green, and"),
        (("simulate", "s.png", "--mosaic", "m.json", "-o", "b.npy"), "m.json: .* shape"),
        (
            ("simulate", "s.png", "--gray", "--motion", "shake", "--mosaic", "RGGB", "-o", "b.npy"),
            "red, green, and",
        ),
        (("reconstruct", "c.npy", "--motion", "--upsample", "2", "-o", "o.png"), "mosaic, got 2"),
        (("reconstruct", "c.npy", "--find-hot-jots", "-o", "o.png"), "different filters"),
    ],
)
def test_bad_commands_say_what_to_do(run, tmp_path, arguments, message):
    jl.save_image(tmp_path / "s.png", SCENE.astype(np.float32))
    (tmp_path / "m.json").write_text('{"pattern": "RGGB", "filters": "RGB", "transmission": [[1]]}')
    jl.save(jl.Sensor(frames=32, mosaic="RGGB").expose(SCENE, rng=0), tmp_path / "c.npy")
    status, printed = run(*arguments)
    assert status == 1
    assert np.any(
        [message.replace(".*", "") in printed, all(m in printed for m in message.split(" .* "))]
    )


@pytest.mark.parametrize(
    ("mosaic", "dead", "message"),
    [
        ("RGGB", np.s_[::2, 1::2], r"behind G, whose first pixel is \(0, 1\)"),
        ("RGB", np.s_[:, 2::3], "behind B"),
    ],
)
def test_a_mask_without_a_pixel_of_a_filter_is_named(mosaic, dead, message):
    mask = np.zeros((12, 12), bool)
    mask[dead] = True
    sensor = jl.Sensor(frames=4, mosaic=mosaic, mask=mask)
    bits = sensor.expose(np.full((12, 12, 3), 0.5), rng=0)
    with pytest.raises(ValueError, match=f"trials: .*{message}"):
        jl.reconstruct(bits, method="mle", demosaicing="differences")
