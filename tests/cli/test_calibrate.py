"""`jotlight calibrate`, and what `reconstruct` and `info` do with a calibration."""

import hashlib
import json

import numpy as np
import pytest
import tifffile

import jotlight as jl
from jotlight.formats.writing import write_capture
from jotlight.images.io import read_image

pytestmark = pytest.mark.filterwarnings("ignore:.*no valid jot")

SHAPE = (24, 32)


@pytest.fixture
def captures(tmp_path):
    """A dark, a flat and a proper capture of one sensor."""
    rng = np.random.default_rng(0)
    dark = rng.gamma(4, 0.002, SHAPE)
    dark[5, 6] = 1.0
    relative = 1 + 0.05 * rng.standard_normal(SHAPE)
    relative[10:13, 20:23] = 1e-4
    sensor = jl.Sensor(
        frames=600,
        gain=600 * 1.3,
        dark_counts=dark,
        efficiency=np.clip(relative / 1.3, 1e-4, 1),
    )
    jl.save(sensor.expose(np.zeros(SHAPE), 1), tmp_path / "dark.npy")
    jl.save(sensor.expose(np.full(SHAPE, 0.7), 2), tmp_path / "flat.npy")
    scene = np.tile(np.linspace(0.1, 0.8, SHAPE[1]), (SHAPE[0], 1))
    seen = sensor.replace(frames=16).expose(scene, 3)
    # As from a camera, which does not tell its sensor.
    jl.save(jl.Bits(seen.packed, seen.width), tmp_path / "seen.npy")
    np.save(tmp_path / "counts.npy", seen.counts(1))
    return tmp_path


@pytest.fixture
def calibrated(run, captures):
    assert run("calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors")[0] == 0
    return jl.Calibration.load(captures / "c.safetensors")


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def test_calibrate_returns_what_the_python_function_returns(run, captures):
    status, said = run(
        "calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors", "--plot", "page.png"
    )
    assert status == 0
    found = jl.Calibration.load(captures / "c.safetensors")
    same = jl.calibrate(jl.open(captures / "dark.npy"), jl.open(captures / "flat.npy"))
    assert found.sensor(16) == same.sensor(16)
    assert np.argwhere(found.hot).tolist() == [[5, 6]]
    assert np.argwhere(found.dead).tolist() == [[y, x] for y in (10, 11, 12) for x in (20, 21, 22)]
    assert f"hot: 1 ({1 / 768:.2%}); {found.hot_threshold} ones or more" in said
    chance = (
        f"{found.hot_probability * 768:.2g}, a rate of {found.hot_probability:.2g}; at most 0.0001"
    )
    assert f"hot by chance: {chance}" in said
    assert 1e-5 < found.hot_probability <= 1e-4
    assert "dead: 9 (" in said
    assert f"PRNU: {found.prnu:.2%} ± " in said
    assert "dark: correlation of frames: " in said
    assert (captures / "page.png").read_bytes().startswith(b"\x89PNG")
    assert {name: provenance.name for name, provenance in found.provenance.items()} == {
        "dark": "dark.npy",
        "flat": "flat.npy",
    }


def test_counts_need_their_frames(run, captures):
    for name in ("dark", "flat"):
        np.save(captures / f"{name}-counts.npy", jl.open(captures / f"{name}.npy").counts(1))
    given = ("calibrate", "dark-counts.npy", "flat-counts.npy", "-o", "c.safetensors")
    status, said = run(*given)
    assert status == 1
    assert "--frames, --flat-frames" in said
    assert run(*given, "--frames", 600, "--plot", "page.pdf")[0] == 0
    found = jl.Calibration.load(captures / "c.safetensors")
    same = jl.calibrate(jl.open(captures / "dark.npy"), jl.open(captures / "flat.npy"))
    assert found.sensor(4) == same.sensor(4)
    assert found.dark_steadiness is None
    assert run("calibrate", "dark.npy", "flat-counts.npy", "-o", "d.safetensors", "-t", 600)[0] == 0
    assert jl.Calibration.load(captures / "d.safetensors").sensor(4) == same.sensor(4)


@pytest.mark.parametrize("method", ["mle", "noniterative-tv", "admm-tv", "mle-iterative"])
@pytest.mark.parametrize("data", ["seen.npy", "counts.npy"])
def test_reconstruct_with_a_calibration_is_reconstruct_with_its_maps(
    run, captures, calibrated, method, data
):
    np.save("d.npy", calibrated.dark_counts)
    np.save("e.npy", calibrated.efficiency)
    np.save("m.npy", calibrated.mask)
    given = ("reconstruct", data, "-m", method, "-t", 16)
    status, said = run(*given, "-o", "a.npy", "--calibration", "c.safetensors")
    assert status == 0
    assert "calibration c.safetensors: dark counts (median 0.0" in said
    assert "10 masked jots, response (PRNU " in said
    maps = ("--dark-counts", "d.npy", "--efficiency", "e.npy", "--mask", "m.npy")
    assert run(*given, "-o", "b.npy", *maps, "--gain", 16 * calibrated.scale)[0] == 0
    np.testing.assert_array_equal(np.load("a.npy"), np.load("b.npy"))
    assert not (captures / "b.npy.json").exists()


def test_what_was_applied_is_recorded_beside_the_picture(run, captures, calibrated):
    np.save("d.npy", np.zeros(SHAPE))
    given = ("reconstruct", "seen.npy", "-o", "a.tif", "--calibration", "c.safetensors")
    status, said = run(*given, "-m", "mle", "--dark-counts", "d.npy", "--gain", 20)
    assert status == 0
    assert "calibration c.safetensors: 10 masked jots, response" in said
    told = json.loads((captures / "a.tif.json").read_text())
    assert told["format"] == "jotlight image"
    assert (told["data"], told["method"]) == ("seen.npy", "mle")
    assert told["sensor"]["gain"] == 20
    assert told["sensor"]["frames"] == 16
    recorded = told["calibration"]
    assert recorded["file"] == "c.safetensors"
    content = (captures / "c.safetensors").read_bytes()
    assert recorded["sha256"] == hashlib.sha256(content).hexdigest()
    assert recorded["applied"] == {"dark_counts": False, "efficiency": True, "mask": True}
    assert recorded["masked_jots"] == 10
    # A record of ours is written anew, and what is not of jotlight stays.
    assert run(*given, "-m", "mle")[0] == 0
    (captures / "a.tif.json").write_text("{}")
    before = (captures / "a.tif").read_bytes()
    status, said = run(*given)
    assert status == 1
    assert "is not from jotlight" in said
    assert (captures / "a.tif").read_bytes() == before
    assert (captures / "a.tif.json").read_text() == "{}"


@pytest.mark.parametrize("brightest", [None, 3.5])
def test_photons_are_those_of_the_median_jot_whatever_the_brightest_is(run, tmp_path, brightest):
    rng = np.random.default_rng(5)
    response = 1 + 0.05 * rng.standard_normal((64, 96))
    if brightest is not None:
        response[20, 30] = brightest
    truth = np.full(response.shape, 0.4)
    camera = jl.Sensor(frames=512, gain=512 * 4.0, efficiency=response / 4)
    jl.save(camera.expose(0 * truth, 1), "dark.npy")
    jl.save(camera.expose(truth, 2), "flat.npy")
    seen = camera.expose(truth, 3)
    jl.save(jl.Bits(seen.packed, seen.width), "seen.npy")
    assert run("calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors")[0] == 0
    given = ("reconstruct", "seen.npy", "-m", "mle", "--calibration", "c.safetensors")
    words = ("-o", "a.tif", "--units", "photons", "--uncertainty", "u.npz")
    assert run(*given, *words)[0] == 0
    picture = read_image(tmp_path / "a.tif")
    assert np.median(picture) == pytest.approx(0.4, rel=0.01)
    with np.load("u.npz") as known:
        inside = (known["low"] <= 0.4) & (known["high"] >= 0.4)
        assert np.median(known["standard_error"]) == pytest.approx(picture.std(), rel=0.5)
    assert inside.mean() > 0.9
    film = ("-o", "film.npy", "--units", "photons", "--window", 256)
    assert run(*given, *film)[0] == 0
    assert np.median(np.load("film.npy")) == pytest.approx(0.4, rel=0.01)


def test_the_default_method_serves_a_calibrated_sensor(run, captures, calibrated):
    given = ("reconstruct", "seen.npy", "-o", "a.npy", "--calibration", "c.safetensors")
    assert run(*given)[0] == 0
    told = json.loads((captures / "a.npy.json").read_text())
    scene = np.linspace(0.1, 0.8, SHAPE[1])
    assert np.sqrt(np.mean((np.load("a.npy") - scene) ** 2)) < 0.1
    assert told["method"] == "network-medium"


def test_bits_that_carry_a_sensor_keep_its_other_parameters(run, captures, calibrated):
    sensor = jl.Sensor(frames=4, gain=2.0, oversampling=2)
    jl.save(sensor.expose(np.full((12, 16), 0.5), 0), captures / "carried.npy")
    given = ("reconstruct", "carried.npy", "-m", "mle", "-o", "a.npy")
    assert run(*given, "--calibration", "c.safetensors")[0] == 0
    expected = jl.mle(jl.open("carried.npy"), calibrated.applied_to(sensor))
    np.testing.assert_array_equal(np.load("a.npy"), expected)


def test_a_capture_of_another_shape_is_refused(run, captures, calibrated):
    for data in ("seen.npy", "counts.npy"):
        given = ("reconstruct", data, "-o", "a.npy", "-t", 16, "--rotate", 90)
        status, said = run(*given, "--calibration", "c.safetensors")
        assert status == 1
        assert "it has 24 x 32 jots, and the capture has 32 x 24" in said
    assert "a.npy" not in files(captures)


@pytest.mark.parametrize("data", ["seen.npy", "counts.npy"])
def test_a_capture_that_is_turned_in_another_way_is_refused(run, captures, calibrated, data):
    given = ("reconstruct", data, "-m", "mle", "-o", "a.npy", "-t", 16)
    given += ("--calibration", "c.safetensors")
    for turn, words in (
        (("--rotate", 180), "rotated by 180 degrees"),
        (("--flip", "vertical"), "rotated by 180 degrees and mirrored left to right"),
    ):
        status, said = run(*given, *turn)
        assert status == 1
        assert f"this capture is {words}, and the calibration's dark capture not turned" in said
        assert "a.npy" not in files(captures)
    calibrate = ("calibrate", "dark.npy", "flat.npy", "-o", "c.safetensors", "--rotate", 180)
    assert run(*calibrate)[0] == 0
    status, said = run(*given, "--flip", "vertical")
    assert status == 1
    assert "dark capture rotated by 180 degrees" in said
    # The same turn, by other words.
    assert run(*given, "--rotate", -180)[0] == 0
    told = json.loads((captures / "a.npy.json").read_text())
    assert told["provenance"]["orientation"] == [2, False]
    assert told["calibration"]["provenance"]["flat"]["orientation"] == [2, False]


def test_what_is_not_known_of_turns_is_said(run, captures, calibrated):
    given = ("reconstruct", "counts.npz", "-m", "mle", "-o", "a.npy", "-t", 16)
    np.savez("counts.npz", np.load("counts.npy"))
    status, said = run(*given, "--calibration", "c.safetensors")
    assert status == 0
    assert "the calibration is from npy and the capture is from npz; the jots are assumed" in said


def test_two_arrays_of_one_file_are_told_apart(run, captures):
    arrays = {name: jl.open(f"{name}.npy").counts(1) for name in ("dark", "flat")}
    np.savez("both.npz", **arrays)
    given = ("calibrate", "both.npz", "both.npz", "-o", "c.safetensors", "-t", 600)
    status, said = run(*given, "--key", "dark", "--flat-key", "flat", "--plot", "page.svg")
    assert status == 0
    assert "npz: the array flat" in said
    assert "both.npz (npz; the array dark)" in run("info", "c.safetensors")[1]
    provenance = jl.Calibration.load(captures / "c.safetensors").provenance
    assert [provenance[name].notes for name in ("dark", "flat")] == [
        ("the array dark",),
        ("the array flat",),
    ]
    words = ("reconstruct", "both.npz", "--key", "flat", "-t", 600, "-m", "mle", "-o", "a.tif")
    assert run(*words, "--calibration", "c.safetensors")[0] == 0
    with tifffile.TiffFile("a.tif") as file:
        assert json.loads(file.pages[0].description)["provenance"]["notes"] == ["the array flat"]
    assert json.loads((captures / "a.tif.json").read_text())["provenance"]["notes"] == [
        "the array flat"
    ]


@pytest.mark.filterwarnings("ignore:dark. no jot is called hot")
def test_a_dark_capture_that_is_too_short_is_said_to_be(run, captures):
    given = ("calibrate", "dark.npy", "-o", "c.safetensors", "--frame-range", ":1")
    status, said = run(*given, "--plot", "page.png")
    assert status == 0
    assert "hot: none found: too few frames" in said
    assert "hot by chance: 1 of 1 bits are ones by chance in 0.0" in said
    assert not jl.Calibration.load(captures / "c.safetensors").hot.any()


def test_a_dark_and_a_flat_capture_that_are_turned_differently_are_refused(captures):
    dark, flat = jl.open(captures / "dark.npy"), jl.open(captures / "flat.npy", rotate=180)
    with pytest.raises(ValueError, match="flat capture is rotated by 180 degrees, and dark"):
        jl.calibrate(dark, flat)


def test_info_tells_of_a_calibration_and_draws_it(run, captures, calibrated):
    status, said = run("info", "c.safetensors", "--plot", "page.svg")
    assert status == 0
    assert "calibration" in said
    assert "24 x 32" in said
    assert "masked" in said
    assert "<svg" in (captures / "page.svg").read_text()


def test_nothing_is_left_behind_and_nothing_read_is_overwritten(run, captures):
    before = files(captures)
    for words, expected in (
        (("-o", "dark.safetensor"), "ends in .safetensors"),
        (("-o", "c.safetensors", "--plot", "page.gif"), "ends in .png"),
        (("-o", "c.safetensors", "--plot", "dark.json"), "this file is read"),
        (("-o", "c.safetensors", "--false-positive-rate", 2), "expected a number in (0, 0.01]"),
        (("-o", "c.safetensors", "--rotate", 45), "rotate"),
        (
            ("-o", "c.safetensors", "--frames", 600),
            "frames: is for counts. These captures hold bits",
        ),
    ):
        status, said = run("calibrate", "dark.npy", "flat.npy", *words)
        assert status == 1
        assert expected in said
        assert files(captures) == before
    status, said = run("calibrate", "dark.npy", "counts.npy", "-o", "c.safetensors", "-t", 1)
    assert status == 1
    assert "at least the largest of the flat counts" in said
    assert files(captures) == before


def test_a_network_is_no_calibration(run, captures):
    jl.Network.initial(jl.Sensor(frames=16)).save("n.safetensors")
    status, said = run("reconstruct", "seen.npy", "-o", "a.npy", "--calibration", "n.safetensors")
    assert status == 1
    assert "expected a jotlight calibration, got jotlight network" in said


def test_a_conversion_is_of_the_format_that_it_was_made_of(run, captures, calibrated):
    assert run("convert", "seen.npy", "-o", "seen.npy.gz")[0] == 0
    given = ("reconstruct", "seen.npy.gz", "-o", "a.npy", "-m", "mle")
    status, said = run(*given, "--calibration", "c.safetensors")
    assert status == 0
    assert "the calibration is from" not in said


def test_frames_that_counts_tell_are_taken_and_not_contradicted(run, captures):
    for name in ("dark", "flat"):
        bits = jl.open(captures / f"{name}.npy")
        write_capture(bits[:500].counts(1), captures / f"{name}.npz", "npz", trials=500)
        np.save(captures / f"{name}-counts.npy", bits.counts(1))
    given = ("-o", "c.safetensors")
    assert run("calibrate", "dark.npz", "flat.npz", *given)[0] == 0
    assert run("calibrate", "dark-counts.npy", "flat.npz", *given, "--frames", 600)[0] == 0
    found = jl.Calibration.load(captures / "c.safetensors")
    assert (found.dark_frames, found.flat_frames) == (600, 500)
    for words, told in (
        (
            ["dark.npz", "flat.npz", "--frames", 600],
            "dark.npz: states counts of 500 trials, but --frames 600",
        ),
        (
            ["dark.npy", "flat.npz", "--frames", 600],
            "flat.npz: states counts of 500 trials, but --frames 600",
        ),
        (["dark.npz", "flat.npz", "--flat-frames", 7], "but --flat-frames 7 means 7;"),
    ):
        status, said = run("calibrate", *words, *given)
        assert status == 1
        assert told in said
