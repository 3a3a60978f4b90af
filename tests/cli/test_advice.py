"""The advice of `reconstruct` where no shipped network fits the capture."""

import gzip
import shlex

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.network import Network

pytestmark = pytest.mark.filterwarnings("ignore:.*no valid jot")

PHOTO = jl.datasets.photograph("camera")[100:356, 128:384]
QUICK = ("--steps", 1, "--batch", 8)


def captured(scene, frames=16, name="seen.npy", **sensor):
    """A capture as from a camera, which does not tell its sensor."""
    bits = jl.Sensor(frames=frames, **sensor).expose(scene, rng=0)
    jl.save(jl.Bits(bits.packed, bits.width), name)
    return bits


def command_in(said):
    """The words of the one command that is printed."""
    [command] = [line.split(": ")[-1] for line in said.splitlines() if "jotlight train" in line]
    words = shlex.split(command)
    assert words[:3] == ["jotlight", "train", "--sensor"]
    return words[1:]


@pytest.mark.parametrize(("level", "fits"), [(0.3, False), (0.9, True), (5.0, False)])
def test_a_scene_that_is_not_as_bright_as_those_learned_from(run, tmp_path, level, fits):
    bits = captured(level * PHOTO)
    np.save("counts.npy", bits.counts())
    for words in (["seen.npy"], ["counts.npy", "--frames", 16]):
        status, said = run("reconstruct", *words, "-o", "out.npy", "--method", "network-two-layer")
        assert status == 0, said
        if fits:
            assert "jotlight train" not in said
        else:
            told = list(map(str, [*words, "-o", "model.safetensors"]))
            assert command_in(said) == ["train", "--sensor", *told]
        for others in ([], ["--method", "mle"]):
            status, said = run("reconstruct", *words, "-o", "out.npy", *others)
            assert "jotlight train" not in said
            if not others:
                assert (np.median(np.load("out.npy")) > 1) == (level > 1)


def test_who_asks_for_a_network_that_a_scene_is_too_bright_for_gets_it_and_is_told(run, tmp_path):
    bits = captured(5 * PHOTO)
    status, said = run("reconstruct", "seen.npy", "-o", "out.npy", "-m", "network-two-layer")
    assert status == 0
    assert "by network-two-layer: the scene reaches the largest intensity 1 of the network" in said
    assert "--method network-medium reaches 3.47" in said
    assert command_in(said)[2] == "seen.npy"
    expected = jl.pretrained(jl.Sensor(frames=16), "two-layer").reconstruct(bits)
    np.testing.assert_array_equal(np.load("out.npy"), expected)


def test_a_sensor_that_says_its_range_is_believed(run):
    jl.save(jl.Sensor(frames=16).expose(5 * PHOTO, rng=0), "known.npy")
    status, said = run("reconstruct", "known.npy", "-o", "out.npy")
    assert status == 0
    assert "by network, medium in" in said
    assert np.load("out.npy").max() <= 1


@pytest.mark.parametrize("level", [0.3, 5.0])
def test_films_are_told_of_once(run, level):
    captured(level * PHOTO, frames=40)
    words = ["reconstruct", "seen.npy", "-o", "film.npy", "--window", 16, "--step", 12]
    status, said = run(*words)
    assert status == 0
    assert "jotlight train" not in said
    assert (np.load("film.npy").max() > 1) == (level > 1)
    status, said = run(*words, "--method", "network-two-layer")
    assert status == 0
    command = command_in(said)
    assert command[1:] == ["--sensor", "seen.npy", "--frames", "16", "-o", "model.safetensors"]
    status, said = run(*command, *QUICK)
    assert status == 0, said
    assert Network.load("model.safetensors").sensor.frames == 16
    status, said = run(*words, "--model", "model.safetensors")
    assert status == 0, said
    assert np.load("film.npy").shape == (3, 256, 256)


@pytest.fixture
def camera(run, tmp_path):
    """A calibration of a camera, and a capture of it."""
    rng = np.random.default_rng(0)
    dark = rng.gamma(2, 0.01, PHOTO.shape)
    dark[::7, ::9] = 0.4
    relative = np.clip((1 + 0.05 * rng.standard_normal(PHOTO.shape)) / 1.3, 1e-3, 1)
    sensor = jl.Sensor(frames=2000, gain=2600, dark_counts=dark, efficiency=relative)
    jl.calibrate(
        sensor.expose(np.zeros(PHOTO.shape), 1), sensor.expose(np.full(PHOTO.shape, 0.7), 2)
    ).save(tmp_path / "my camera.safetensors")
    seen = sensor.replace(frames=16).expose(0.3 * PHOTO, 3)
    jl.save(jl.Bits(seen.packed, seen.width), tmp_path / "seen.npy")
    return sensor


OPENED = {
    "a key": ["counts.npz", "--key", "k16", "--frames", 16],
    "raw frames": ["raw frames.bin", "--format", "swissspad2"],
    "frames": ["seen.npy", "--frame-range", "3:12"],
    "every second frame": ["seen.npy", "--frame-range", "0:16:2"],
    "frames that would be an emoji": ["long.npy", "--frame-range", "0:100:2"],
    "a calibration": ["seen.npy", "--calibration", "my camera.safetensors"],
    "a calibration, turned back": [
        "turned.npy", "--calibration", "my camera.safetensors", "--rotate", 90, "--flip", "vertical"
    ],
    "a width": ["odd.npy", "--width", 253, "--frame-range", ":9"],
    "counts of uint8": ["small.npy", "--counts", "--frames", 3, "--frame-range", "0:1"],
    "a sensor": ["seen.npy", "--gain", 8, "--threshold", 1, "--dark-counts", "dark.npy"],
    "a range": ["seen.npy", "--max-intensity", 2.5],
    "20 frames": ["long.npy", "--frame-range", "0:20"],
}  # fmt: skip


@pytest.mark.parametrize("words", OPENED.values(), ids=OPENED)
def test_the_command_runs_as_it_is_printed_and_its_network_serves(run, camera, words):
    """With fewer steps, that is."""
    bits = jl.open("seen.npy")
    np.savez("counts.npz", k1=bits[:1].counts(), k16=bits.counts())
    frames = np.random.default_rng(0).random((4, 256, 512)) < 0.2
    np.packbits(frames, axis=2, bitorder="little").tofile("raw frames.bin")
    back = bits.to_array()[:, ::-1]
    jl.save(jl.Bits.from_array(np.rot90(back, -1, (1, 2))), "turned.npy")
    np.save("odd.npy", jl.Bits.from_array(bits.to_array()[:, :, :253]).packed)
    np.save("small.npy", np.stack([bits[:3].counts(), bits[3:6].counts()]).astype(np.uint8))
    np.save("dark.npy", np.full(PHOTO.shape, 0.01))
    captured(0.3 * PHOTO, frames=100, name="long.npy")
    # Where there is none that could be asked for, that is an error, with the same advice.
    _, said = run("reconstruct", *words, "-o", "out.npy", "--method", "network-two-layer")
    command = command_in(said)
    assert "FOLDER_OF_PHOTOGRAPHS" not in said
    status, said = run(*command, *QUICK)
    assert status == 0, said
    status, said = run("reconstruct", *words, "-o", "out.npy", "--model", "model.safetensors")
    assert status == 0, said
    assert "jotlight train" not in said
    own = Network.load("model.safetensors")
    assert not own.sensor.maps()
    assert np.load("out.npy").max() <= own.sensor.max_intensity


def test_a_network_learned_with_the_calibration_is_better_than_without(run, camera):
    few = ("--steps", 8, "--batch", 128)
    calibrated = ("--calibration", "my camera.safetensors")
    assert run("train", "--sensor", "seen.npy", "-o", "plain.safetensors", *few)[0] == 0
    train = ("train", "--sensor", "seen.npy", "-o", "own.safetensors")
    assert run(*train, *few, *calibrated)[0] == 0
    own = Network.load("own.safetensors").sensor
    found = jl.Calibration.load("my camera.safetensors").sensor(16)
    assert own.dark_counts == np.median(found.dark_counts[~found.mask])
    assert own.gain == found.gain
    assert own.max_intensity == pytest.approx(2 * 0.3, rel=0.15)

    def psnr(*words):
        status, said = run("reconstruct", "seen.npy", "-o", "out.npy", *words)
        assert status == 0, said
        return jl.metrics.psnr(np.load("out.npy"), 0.3 * PHOTO)

    best = psnr("--model", "own.safetensors", *calibrated)
    assert best > psnr("--model", "plain.safetensors", *calibrated)
    assert best > psnr("--method", "noniterative-tv", *calibrated)
    assert best > psnr("--method", "noniterative-gaussian", *calibrated)
    assert best > psnr("--method", "mle", *calibrated) + 6
    assert best > psnr("--model", "plain.safetensors") + 1
    assert best > psnr("--method", "noniterative-tv") + 1
    assert psnr(*calibrated) > psnr() + 1


def test_the_range_that_is_asked_for_is_learned(run):
    captured(0.3 * PHOTO)
    words = ["train", "--sensor", "seen.npy", "-o", "own.safetensors", *QUICK]
    assert run(*words, "--max-intensity", 2.5)[0] == 0
    assert Network.load("own.safetensors").sensor.max_intensity == 2.5


@pytest.mark.parametrize("name", ["seen.npy", "seen.npy.gz"])
def test_the_bits_beside_a_description_may_be_compressed_by_other_means(run, tmp_path, name):
    captured(0.3 * PHOTO)
    if name == "seen.npy.gz":
        (tmp_path / name).write_bytes(gzip.compress((tmp_path / "seen.npy").read_bytes(), 1))
        (tmp_path / "seen.npy").unlink()
    status, said = run("train", "--sensor", "seen.json", "-o", "own.safetensors", *QUICK)
    assert status == 0, said
    assert f"{name}: the brightness of the scene" in said
