"""The advice where a network does not fit a capture, and the training of one that does."""

import gzip
import shutil

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.network import Network
from moving import in_memory

pytestmark = pytest.mark.filterwarnings("ignore:.*no valid bit", "ignore:a cubic kernel spreads")

PHOTO = jl.datasets.photograph("camera")[100:356, 128:384]
QUICK = ("--steps", 1, "--batch", 8)
TWO_LAYER = ("--quality", "two-layer", *QUICK)
"""Options that train without PyTorch."""


def save_capture(scene, frames=16, name="capture.npy", **sensor):
    """Save a capture without the description of its sensor, as from a camera."""
    bits = jl.Sensor(frames=frames, **sensor).expose(scene, rng=0)
    jl.save(jl.Bits(bits.packed, bits.width), name)
    return bits


@pytest.mark.slow
@pytest.mark.parametrize(("level", "fits"), [(0.3, False), (0.9, True), (5.0, False)])
def test_another_size_is_advised_only_where_the_brightness_does_not_fit(run, level, fits):
    bits = save_capture(level * PHOTO)
    np.save("counts.npy", bits.counts())
    for arguments in (["capture.npy"], ["counts.npy", "--frames", 16]):
        status, output = run(
            "reconstruct", *arguments, "-o", "out.npy", "--method", "network-two-layer"
        )
        assert status == 0, output
        assert ("--quality medium" in output) != fits
        for method in (["--quality", "medium"], ["--method", "mle"]):
            status, output = run("reconstruct", *arguments, "-o", "out.npy", *method)
            assert "--quality" not in output
            if method[1] == "medium":
                assert (np.median(np.load("out.npy")) > 1) == (level > 1)


def test_a_requested_network_runs_and_warns_when_the_scene_is_too_bright(run, tmp_path):
    bits = save_capture(5 * PHOTO)
    status, output = run("reconstruct", "capture.npy", "-o", "out.npy", "-m", "network-two-layer")
    assert status == 0
    assert (
        "by network-two-layer: the scene reaches the largest intensity 1 of the network" in output
    )
    assert "so brighter pixels are clipped; --quality medium reaches 3.47, where" in output
    expected = jl.pretrained(jl.Sensor(frames=16), "two-layer").reconstruct(bits)
    np.testing.assert_array_equal(np.load("out.npy"), expected)


@pytest.mark.filterwarnings("always:.*brighter than the largest intensity")
def test_the_range_of_a_known_sensor_is_used(run):
    jl.save(jl.Sensor(frames=16).expose(5 * PHOTO, rng=0), "known.npy")
    status, output = run("reconstruct", "known.npy", "-o", "out.npy")
    assert status == 0
    assert "by network, medium in" in output
    assert output.count("pixels are brighter than the largest intensity, 1, which") == 1
    assert np.load("out.npy").max() <= 1


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.3, 5.0])
def test_advice_for_a_film_is_printed_once(run, level):
    save_capture(level * PHOTO, frames=40)
    arguments = ["film", "capture.npy", "-o", "film.npy", "--window", 16, "--step", 12]
    status, output = run(*arguments)
    assert status == 0
    assert "--quality" not in output
    assert (np.load("film.npy").max() > 1) == (level > 1)
    status, output = run(*arguments, "--method", "network-two-layer")
    assert status == 0
    assert output.count("--quality medium") == 1


@pytest.fixture(scope="module")
def camera_files(tmp_path_factory):
    """Return a folder with a calibration of a camera, and one of its captures."""
    folder = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(0)
    dark = rng.gamma(2, 0.01, PHOTO.shape)
    dark[::7, ::9] = 0.4
    relative = np.clip((1 + 0.05 * rng.standard_normal(PHOTO.shape)) / 1.3, 1e-3, 1)
    sensor = jl.Sensor(frames=2000, gain=2600, dark_counts=dark, efficiency=relative)
    jl.calibrate(
        sensor.expose(np.zeros(PHOTO.shape), 1), sensor.expose(np.full(PHOTO.shape, 0.7), 2)
    ).save(folder / "my camera.safetensors")
    bits = sensor.replace(frames=16).expose(0.3 * PHOTO, 3)
    jl.save(jl.Bits(bits.packed, bits.width), folder / "capture.npy")
    return folder


@pytest.fixture
def camera(camera_files, tmp_path):
    """Copy the files of the camera to the current folder of the test."""
    shutil.copytree(camera_files, tmp_path, dirs_exist_ok=True)


OPENED = {
    "a key": ["counts.npz", "--key", "k16", "--frames", 16],
    "raw frames": ["raw frames.bin", "--format", "swissspad2"],
    "frames": ["capture.npy", "--frame-range", "3:12"],
    "every second frame": ["capture.npy", "--frame-range", "0:16:2"],
    "frames that would be an emoji": ["long.npy", "--frame-range", "0:100:2"],
    "a calibration": ["capture.npy", "--calibration", "my camera.safetensors"],
    "a calibration of another orientation": [
        "rotated.npy", "--calibration", "my camera.safetensors",
        "--rotate", 90, "--flip", "vertical",
    ],
    "a width": ["odd.npy", "--width", 253, "--frame-range", ":9"],
    "counts of uint8": ["small.npy", "--counts", "--frames", 3, "--frame-range", "0:1"],
    "a sensor": ["capture.npy", "--gain", 8, "--threshold", 1, "--dark-counts", "dark.npy"],
    "a range": ["capture.npy", "--max-intensity", 2.5],
    "20 frames": ["long.npy", "--frame-range", "0:20"],
}  # fmt: skip


OPENED_IN_GATE = "a key", "frames", "a calibration of another orientation"


@pytest.mark.slow
@pytest.mark.usefixtures("camera")
@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(
            arguments, id=name, marks=() if name in OPENED_IN_GATE else pytest.mark.exhaustive
        )
        for name, arguments in OPENED.items()
    ],
)
def test_a_network_can_be_trained_for_every_capture(run, arguments):
    arguments = [*arguments, "--kernel", "cubic"]
    bits = jl.open("capture.npy")
    np.savez("counts.npz", k1=bits[:1].counts(), k16=bits.counts())
    frames = np.random.default_rng(0).random((4, 256, 512)) < 0.2
    np.packbits(frames, axis=2, bitorder="little").tofile("raw frames.bin")
    flipped = bits.to_array()[:, ::-1]
    jl.save(jl.Bits.from_array(np.rot90(flipped, -1, (1, 2))), "rotated.npy")
    np.save("odd.npy", jl.Bits.from_array(bits.to_array()[:, :, :253]).packed)
    np.save("small.npy", np.stack([bits[:3].counts(), bits[3:6].counts()]).astype(np.uint8))
    np.save("dark.npy", np.full(PHOTO.shape, 0.01))
    save_capture(0.3 * PHOTO, frames=100, name="long.npy")
    capture = ["--sensor-key" if argument == "--key" else argument for argument in arguments]
    command = ["train", "--sensor", *capture, "-o", "model.safetensors", *TWO_LAYER]
    status, output = run(*command)
    assert status == 0, output
    status, output = run("reconstruct", *arguments, "-o", "out.npy", "--model", "model.safetensors")
    assert status == 0, output
    own = Network.load("model.safetensors")
    assert not own.sensor.maps()
    assert np.load("out.npy").max() <= own.sensor.max_intensity


@pytest.mark.exhaustive
@pytest.mark.usefixtures("camera")
def test_a_network_trained_with_the_calibration_is_better_than_simple_methods(run):
    training = ("--steps", 8, "--batch", 128)
    calibrated = ("--calibration", "my camera.safetensors")
    assert run("train", "--sensor", "capture.npy", "-o", "plain.safetensors", *training)[0] == 0
    train = ("train", "--sensor", "capture.npy", "-o", "own.safetensors")
    assert run(*train, *training, *calibrated)[0] == 0
    own = Network.load("own.safetensors").sensor
    found = jl.Calibration.load("my camera.safetensors").sensor(16)
    assert own.dark_counts == np.median(found.dark_counts[~found.mask])
    assert own.gain == found.gain
    assert own.max_intensity == pytest.approx(2 * 0.3, rel=0.15)

    def psnr(*arguments):
        status, output = run("reconstruct", "capture.npy", "-o", "out.npy", *arguments)
        assert status == 0, output
        return jl.metrics.psnr(np.load("out.npy"), 0.3 * PHOTO)

    best = psnr("--model", "own.safetensors", *calibrated)
    # Equivalent counts bring the jots of the capture to those of the other network.
    assert best == pytest.approx(psnr("--model", "plain.safetensors", *calibrated), abs=0.5)
    assert best > psnr("--method", "noniterative-gaussian", *calibrated)
    assert best > psnr("--method", "mle", *calibrated) + 6
    assert best > psnr("--model", "plain.safetensors") + 1
    assert best > psnr("--method", "noniterative-tv") + 1
    assert psnr(*calibrated) > psnr() + 1


@pytest.mark.slow
def test_the_requested_range_is_trained(run):
    save_capture(0.3 * PHOTO)
    arguments = ["train", "--sensor", "capture.npy", "-o", "own.safetensors", *QUICK]
    assert run(*arguments, "--max-intensity", 2.5)[0] == 0
    assert Network.load("own.safetensors").sensor.max_intensity == 2.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["capture.npy", "capture.npy.gz"])
def test_the_bits_beside_a_description_may_be_compressed(run, tmp_path, name):
    save_capture(0.3 * PHOTO)
    if name == "capture.npy.gz":
        (tmp_path / name).write_bytes(gzip.compress((tmp_path / "capture.npy").read_bytes(), 1))
        (tmp_path / "capture.npy").unlink()
    status, output = run("train", "--sensor", "capture.json", "-o", "own.safetensors", *QUICK)
    assert status == 0, output
    assert f"{name}: the brightness of the scene" in output


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["static", "shake"])
def test_motion_is_advised_only_where_the_scene_moves(run, motion):
    scene = jl.datasets.moving(
        PHOTO, motion, sensor=jl.Sensor(frames=64), shape=(96, 96), photons=0.3, rng=1
    )
    bits = in_memory(scene)
    jl.save(bits, "a.npy")
    counts = bits.to_array().reshape(16, 4, 96, 96).sum(axis=1).astype(np.uint16)
    np.save("counts.npy", counts)
    for arguments in (
        ["reconstruct", "a.npy", "-o", "out.npy"],
        ["reconstruct", "counts.npy", "--frames", 64, "-o", "out.npy"],
        ["film", "a.npy", "-o", "out.npy", "--window", 64],
    ):
        status, output = run(*arguments, "-m", "mle")
        assert status == 0
        expected = "motion: the scene moves, so the image is blurred; --motion aligns its frames"
        assert (expected in output) == (motion == "shake")
    # A window is so short that the scene hardly moves.
    status, output = run("film", "a.npy", "-o", "out.npy", "--window", 1, "-m", "mle")
    assert status == 0
    assert "the scene moves" not in output
