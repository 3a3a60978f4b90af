"""Commands for readings of several bits and read noise."""

import numpy as np
import pytest

import jotlight as jl


@pytest.fixture
def photo(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    jl.save_image("photo.png", jl.datasets.photograph("camera")[::16, ::16])
    return "photo.png"


OPTIONS = ["-k", 1, "-t", 8, "--bit-depth", 4, "--read-noise", 0.3, "--gain", 16]


@pytest.mark.slow
def test_captures_are_simulated_described_reconstructed_and_converted(run, photo):
    status, text = run("simulate", photo, "-o", "r.npy", *OPTIONS)
    assert status == 0
    assert "Readings: 8 frames of 32 x 32 jots, 4 bits each" in text
    sensor = jl.Sensor(frames=8, gain=16.0, bit_depth=4, read_noise=0.3)
    assert jl.open("r.npy").sensor == sensor
    status, text = run("info", "r.npy")
    assert "readings of 4 bits" in text
    assert "of 15" in text
    for method in ("mle", "noniterative-tv", "network-small", "admm-tv"):
        status, text = run("reconstruct", "r.npy", "-o", "e.npy", "--method", method)
        assert status == 0
        np.testing.assert_array_equal(
            np.load("e.npy"), jl.reconstruct(jl.open("r.npy"), method=method)
        )
    assert run("convert", "r.npy", "-o", "r.tif")[0] == 0
    np.testing.assert_array_equal(jl.open("r.tif").to_array(), jl.open("r.npy").to_array())


def test_plain_stacks_need_the_options(run, photo):
    run("simulate", photo, "-o", "r.npy", *OPTIONS)
    np.save("plain.npy", np.load("r.npy"))
    common = ["reconstruct", "plain.npy", "-o", "e.npy", "--method", "mle", "--max-intensity", 1]
    status, text = run(*common, *OPTIONS[4:])
    assert status == 0
    assert "4 bits" not in text
    np.testing.assert_array_equal(np.load("e.npy"), jl.mle(jl.open("r.npy")))
    status, text = run(*common, "--bit-depth", 2)
    assert status == 1
    assert "expected 0 to 3 for 2 bits" in text
    assert "--bit-depth" in text


def test_a_bit_depth_that_contradicts_the_file_is_refused(run, photo):
    run("simulate", photo, "-o", "r.npy", *OPTIONS)
    status, text = run("reconstruct", "r.npy", "-o", "e.npy", "--bit-depth", 3)
    assert status == 1
    assert "bit_depth: r.npy states readings of 4 bits, not 3; leave out --bit-depth\n" in text
    run("simulate", photo, "-o", "b.npy", "-k", 1)
    run("convert", "b.npy", "-o", "b.zarr")
    status, text = run("reconstruct", "b.zarr", "-o", "e.npy", "--bit-depth", 3)
    assert status == 1
    assert "its label states packed bits, not counts; leave out --counts, --unpacked, --bit" in text
    status, text = run("reconstruct", "b.zarr", "-o", "e.npy", "--bit-depth", 3, "--bits")
    assert status == 1
    assert "but bits are requested; leave out --unpacked and --bits\n" in text


def test_noisy_bits_are_simulated_and_reconstructed(run, photo):
    assert run("simulate", photo, "-o", "b.npy", "-k", 1, "-t", 8, "--read-noise", 0.3)[0] == 0
    assert jl.open("b.npy").sensor.read_noise == 0.3
    assert run("reconstruct", "b.npy", "-o", "e.npy")[0] == 0


# The scene moves by half of its size.
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:what the image shows is out of view")
def test_moving_scenes_have_images_and_films(run, photo):
    options = ("--motion", "shake", "-k", 1, "-t", 24, "--bit-depth", 4, "--gain", 72)
    status, text = run("simulate", photo, "-o", "r.npy", *options)
    assert status == 0
    assert "24 frames of 32 x 32 jots, 4 bits each" in text
    status, text = run("reconstruct", "r.npy", "-o", "a.npy", "--motion", "-m", "mle")
    assert status == 0
    assert "motion: " in text
    known = ("--units", "photons", "--uncertainty", "u.npz")
    status, text = run("reconstruct", "r.npy", "-o", "b.npy", "--motion", "-m", "mle", *known)
    photons = np.load("b.npy")
    np.testing.assert_allclose(photons, 3 * np.load("a.npy"), rtol=1e-5)
    assert f"frame {photons.min():.3g} to {photons.max():.3g}" in text
    with np.load("u.npz") as stored:
        assert stored["high"].max() == pytest.approx(3)
        assert (stored["low"] <= photons).all()
    status, text = run(
        "film", "r.npy", "-o", "f.npy", "--window", 16, "--step", 4, "--motion", "-m", "mle"
    )
    assert status == 0
    assert "3 images of 32 x 32 from 16 frames each" in text
    assert run("film", "r.npy", "-o", "g.npy", "--window", 8, "-m", "mle")[0] == 0
    assert np.load("g.npy").shape == (3, 32, 32)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate", "photo.png", "-o", "x.npy", "--bit-depth", 4, "-q", 3], "threshold: expec"),
        (["simulate", "photo.png", "-o", "x.npy", "--bit-depth", 40], "bit_depth: expected"),
    ],
)
def test_what_needs_single_bits_says_so(run, photo, arguments, message):
    run("simulate", photo, "-o", "r.npy", *OPTIONS)
    status, text = run(*arguments)
    assert status == 1
    assert message in text


@pytest.mark.slow
def test_plans_take_bits_and_read_noise(run):
    status, text = run("plan", "0.1:2", "-t", 4, "--bit-depth", 3, "--read-noise", 0.3)
    assert status == 0
    assert "PSNR" in text


@pytest.mark.parametrize("names", [("r.npy",), ("b.npy", "r.npy")])
@pytest.mark.parametrize("options", [(), ("--frames", 8)])
def test_calibrations_refuse_readings_and_propose_no_frames(run, photo, tmp_path, names, options):
    run("simulate", photo, "-o", "r.npy", *OPTIONS)
    run("simulate", photo, "-o", "b.npy", "-k", 1, "-t", 8)
    status, text = run("calibrate", *names, "-o", "c.safetensors", *options)
    assert status == 1
    assert "a calibration is for single bits, but the capture has readings of 4 bits" in text
    assert "--frames" not in text
    assert not (tmp_path / "c.safetensors").exists()


@pytest.mark.parametrize("name", ["r.npy", "r.tif"])
@pytest.mark.parametrize("command", [("info",), ("reconstruct", "-o", "e.npy")])
def test_files_of_readings_are_not_read_as_counts(run, photo, name, command):
    run("simulate", photo, "-o", "r.npy", *OPTIONS)
    run("convert", "r.npy", "-o", "r.tif")
    status, text = run(command[0], name, *command[1:], "--counts")
    assert status == 1
    assert f"counts: {name} states readings of 4 bits, not counts; leave out --counts\n" in text
    status, text = run(command[0], name, *command[1:], "--counts-scale", 15, "--trials", 4)
    assert status == 1
    assert "leave out --counts-scale\n" in text
    status, text = run("reconstruct", name, "-o", "e.npy", "--counts", "--bit-depth", 4)
    assert status == 0
