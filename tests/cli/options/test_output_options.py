"""The outputs of `reconstruct`: units, previews, and uncertainty."""

import json

import numpy as np
import pytest
import tifffile

import jotlight as jl
from folders import file_names
from jotlight.cli.terminal import console
from jotlight.images.io import read_image

SENSOR = jl.Sensor(frames=40, gain=10.0, max_intensity=14.0)
LONG = jl.Sensor(frames=40, max_intensity=float(np.log(80)))
SCENE = np.linspace(0.2, 12, 24 * 30).reshape(24, 30)


@pytest.fixture
def capture(tmp_path):
    bits = SENSOR.expose(SCENE, rng=0)
    jl.save(bits, tmp_path / "known.npy")
    np.save(tmp_path / "cube.npy", SENSOR.replace(gain=40.0).expose(SCENE / 4, rng=0).packed)
    return bits


@pytest.mark.parametrize("ending", ["npy", "tif", "exr"])
def test_floats_in_photons_record_their_units(run, capture, tmp_path, ending):
    exr = pytest.importorskip("OpenEXR") if ending == "exr" else None
    status, output = run(
        "reconstruct", "known.npy", "-o", f"a.{ending}", "-m", "mle", "--units", "photons"
    )
    assert status == 0
    assert "photons per pixel and frame" in output
    expected = jl.mle(capture, SENSOR) * np.float32(0.25)
    path = tmp_path / f"a.{ending}"
    note = None
    if exr is not None:
        with exr.File(str(path)) as file:
            found, note = file.channels()["Y"].pixels, file.header()["comments"]
    else:
        found = read_image(path)
        if ending == "tif":
            with tifffile.TiffFile(path) as file:
                note = file.pages[0].description
    assert (found == expected).all()
    if note is not None:
        metadata = json.loads(note)
        assert metadata["units"] == "detected photons per pixel and frame"
        assert metadata["sensor"]["gain"] == 10
        assert metadata["provenance"]["name"] == "known.npy"


@pytest.mark.parametrize("outputs", ["-o a.png", "-o a.png --depth 16", "-o a.npy --preview a.jpg"])
@pytest.mark.parametrize("channels", [2, 4])
def test_two_and_four_channels_are_not_displayed(run, tmp_path, monkeypatch, outputs, channels):
    monkeypatch.chdir(tmp_path)
    scene = np.full((8, 12, channels), 0.5)
    jl.save(jl.Sensor(frames=4).expose(scene, rng=0, channel_axis=-1), "channels.npy")
    before = file_names(tmp_path)
    status, output = run("reconstruct", "channels.npy", "-m", "mle", *outputs.split())
    assert status == 1
    assert f"expected a gray image or three channels, got {channels} channels" in output
    assert file_names(tmp_path) == before


def test_a_capture_of_an_unknown_sensor_is_not_clipped(run, capture, tmp_path):
    status, output = run("reconstruct", "cube.npy", "--width", 30, "-o", "a.tif", "-m", "mle")
    assert status == 0
    assert "half a count from saturation" in output
    estimate = read_image(tmp_path / "a.tif")
    bits = jl.open(tmp_path / "cube.npy", width=30)
    assert ((estimate == estimate.max()) == (bits.counts() == 40)).all()
    assert estimate.max() == np.float32(np.log(80))


@pytest.mark.filterwarnings("always::jotlight.JotlightWarning")
@pytest.mark.parametrize("name", ["a.png", "a.jpg"])
def test_an_image_for_display_is_exposed_where_nothing_states_white(
    run, capture, tmp_path, name, monkeypatch
):
    """The same function exposes the images of `jotlight.save_image`."""
    monkeypatch.setattr(console, "shown_warnings", set())
    estimate = jl.mle(jl.open(tmp_path / "cube.npy", width=30), LONG)
    white = np.percentile(estimate, 99.5)
    status, output = run("reconstruct", "cube.npy", "--width", 30, "-m", "mle", "-o", name)
    assert status == 0
    expected = f"image: {white:.3g}, the 99.5th percentile, is shown as white; --white sets another"
    assert expected in output
    assert f"(linear curve, white at {white:.3g})" in output
    with pytest.warns(jl.JotlightWarning, match="is shown as white"):
        jl.save_image(tmp_path / f"expected-{name}", estimate)
    found, expected = read_image(tmp_path / name), read_image(tmp_path / f"expected-{name}")
    np.testing.assert_allclose(found, expected, atol=1.001 / 255)


@pytest.mark.parametrize(
    ("arguments", "white"), [([], 14), (["--white", 3], 3), (["--max-intensity", 13], 13)]
)
def test_the_capture_or_an_option_states_white(run, capture, tmp_path, arguments, white):
    status, output = run("reconstruct", "known.npy", "-o", "a.png", "-m", "mle", *arguments)
    assert status == 0
    assert f"(linear curve, white at {white})" in output
    sensor = SENSOR.replace(max_intensity=13.0 if white == 13 else 14.0)
    expected = np.minimum(jl.mle(capture, sensor) / white, 1)
    np.testing.assert_allclose(read_image(tmp_path / "a.png"), expected, atol=0.501 / 255)


def test_a_preview_is_written_beside_the_floats(run, capture, tmp_path):
    arguments = ["reconstruct", "known.npy", "-o", "a.npy", "-m", "mle", "--preview", "a.png"]
    status, output = run(*arguments, "--curve", "log")
    assert status == 0
    assert "a.png: image for display" in output
    preview = read_image(tmp_path / "a.png")
    assert preview.shape == (24, 30)
    assert preview.max() > 0.99
    assert np.median(preview) > 0.8


@pytest.mark.parametrize(
    ("ending", "method"), [("npz", "network-medium"), ("npy", "mle"), ("tif", "noniterative-tv")]
)
def test_uncertainty_is_written_in_the_units_of_the_estimate(
    run, capture, tmp_path, ending, method
):
    arguments = ["reconstruct", "known.npy", "-o", "a.npy", "--units", "photons", "-m", method]
    status, output = run(*arguments, "--uncertainty", f"u.{ending}", "--level", 0.9)
    assert status == 0, output
    expected = jl.uncertainty(capture, SENSOR, method=method, confidence_level=0.9)
    path = tmp_path / f"u.{ending}"
    if ending == "npz":
        with np.load(path) as found:
            assert sorted(found) == ["flags", "high", "low", "standard_error"]
            planes = [found[name] for name in ("standard_error", "low", "high", "flags")]
    else:
        planes = list(np.load(path) if ending == "npy" else tifffile.imread(path))
    np.testing.assert_allclose(planes[0], expected.standard_error * 0.25, rtol=1e-6)
    np.testing.assert_allclose(planes[2], expected.high * 0.25, rtol=1e-6)
    assert (planes[3] == expected.flags()).all()


def test_uncertainty_is_that_of_the_estimate_in_its_precision(run, capture, tmp_path):
    options = ["--precision", "bf16", "--uncertainty", "u.npz"]
    assert run("reconstruct", "known.npy", "-o", "a.npy", *options)[0] == 0
    expected = jl.uncertainty(capture, SENSOR, precision="bf16")
    with np.load(tmp_path / "u.npz") as found:
        np.testing.assert_array_equal(found["low"], expected.low)
        np.testing.assert_array_equal(found["high"], expected.high)


def test_unknown_errors_are_reported_before_the_work(run, tmp_path):
    sensor = jl.Sensor(oversampling=2, frames=4, kernel="linear")
    jl.save(sensor.expose(np.full((16, 16), 0.5), rng=0), tmp_path / "smooth.npy")
    status, output = run("reconstruct", "smooth.npy", "-o", "a.npy", "--uncertainty", "u.npz")
    assert status == 1
    assert "the errors of its estimates are unknown" in " ".join(output.split())
    assert not (tmp_path / "a.npy").exists()


@pytest.mark.slow
def test_uncertainty_is_shown_as_an_image(run, capture, tmp_path):
    status, output = run("reconstruct", "known.npy", "-o", "a.npy", "--uncertainty", "u.png")
    assert status == 0, output
    shown = read_image(tmp_path / "u.png")
    assert shown.ndim == 3
    assert min(shown.shape[:2]) > 200


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["-o", "a.png", "--units", "photons"], "are for floats"),
        (["-o", "a.npy", "--units", "lux"], "expected one of intensity, photons"),
        (["-o", "a.npy", "--preview", "b.tif"], "a name that ends in .png or .jpg"),
        (["-o", "a.npy", "--preview", "known.npy"], "a name that ends in .png or .jpg"),
        (["-o", "a.npy", "--uncertainty", "known.npy"], "choose another name"),
        (["-o", "a.npy", "--uncertainty", "a.npy"], "a different name for each output"),
        (["-o", "a.npy", "--uncertainty", "u.jpg"], "ends in .npz, .npy, .tif"),
        (["-o", "a.npy", "--uncertainty", "u.npz", "--level", 2], "expected a number in [0.5, 1)"),
        (["-o", "a.npy", "--uncertainty", "u.npz", "--level", 95], "95.0; write 0.95 for 95 %"),
        (["-o", "a.npy", "--curve", "sepia"], "linear, gamma, log, reinhard"),
        (["-o", "a.npy", "--curve", "log"], "is for a .png or .jpg"),
        (["-o", "a.npy", "--white", 2], "white: is for a .png or .jpg, not for the floats"),
        (["-o", "a.png", "--white", "inf"], "white: expected a finite intensity above 0"),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_no_files(
    run, capture, tmp_path, arguments, expected
):
    before = file_names(tmp_path)
    status, output = run("reconstruct", "known.npy", *arguments)
    assert status == 1
    [line] = output.splitlines()
    assert line.startswith("error: ")
    assert expected in line
    assert file_names(tmp_path) == before


def test_photons_per_second_are_those_of_python(run, tmp_path):
    sensor = jl.Sensor(frames=9, exposure_time=2e-5)
    bits = sensor.expose(np.full((16, 16), 0.4), rng=0)
    jl.save(bits, "timed.npy")
    arguments = ["reconstruct", "timed.npy", "-o", "a.npy", "--units", "photons-per-second"]
    status, output = run(*arguments)
    assert status == 0, output
    assert "detected photons per pixel and second" in output
    np.testing.assert_allclose(
        np.load("a.npy"), jl.reconstruct(bits, units="photons-per-second"), rtol=1e-6
    )
    assert run(*arguments, "--exposure-time", 1e-5)[0] == 0
    np.testing.assert_allclose(np.load("a.npy"), jl.reconstruct(bits) * 1e5, rtol=1e-6)
    jl.save(jl.Sensor(frames=9).expose(np.full((16, 16), 0.4), rng=0), "timed.npy")
    status, output = run(*arguments)
    assert status == 1
    assert "--exposure-time 1e-5" in output
    assert "Sensor(" not in output


def test_a_level_without_an_interval_is_refused(run, capture):
    status, output = run("reconstruct", "known.npy", "-o", "a.npy", "--level", 0.9)
    assert status == 1
    assert "level: is for the confidence interval; add --uncertainty u.npz" in output
    arguments = ["reconstruct", "known.npy", "-o", "a.npy", "-m", "mle", "--uncertainty", "u.npz"]
    assert "confidence intervals of 0.95" in run(*arguments)[1]
    assert "confidence intervals of 0.9\n" in run(*arguments, "--level", 0.9)[1]
