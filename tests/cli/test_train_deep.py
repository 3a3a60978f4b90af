"""`jotlight train --quality small`."""

import numpy as np
import pytest

import jotlight as jl
from folders import file_names
from jotlight.images.sets import read_image_set
from jotlight.training import History, parameter_vector
from training_runs import assert_same_networks, interrupted_at

torch = pytest.importorskip("torch")

from jotlight.torch import distributed, training  # noqa: E402
from jotlight.torch.patches import Batch  # noqa: E402

SMALL = ["--quality", "small", "--batch", 2, "--steps", 3, "--device", "cpu", "--threads", 1]
NETWORK, CHECKPOINT = "net.safetensors", "net.checkpoint.safetensors"


def stop(run, *arguments, step):
    """Run the command and press Ctrl-C at the end of a step, after the next has begun."""
    with interrupted_at(step, training):
        return run("train", "photos", "-o", NETWORK, *SMALL, *arguments)


def test_a_folder_of_images_trains_the_same_network_as_python(run, photo_folder, tmp_path):
    arguments = [
        "--learning-rate",
        0.002,
        "--seed",
        7,
        "-t",
        2,
        "--test",
        photo_folder,
        "--plot",
        "run.png",
    ]
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, *arguments)
    assert status == 0
    assert "training a small network for 32 bits per pixel" in output
    assert f"{NETWORK}: a small network for 32 bits per pixel, trained in 3 steps" in output
    assert "--quality medium trains a better network" in output
    assert "test PSNR" in output
    sensor = jl.Sensor(oversampling=4, frames=2)
    images = read_image_set(photo_folder)[1]
    trained, history = jl.torch.train(
        jl.Network.residual(sensor, "small", rng=7), images, sensor, steps=3, batch=2,
        learning_rate=0.002, rng=7, test=images, device="cpu", threads=1,
    )  # fmt: skip
    network = jl.Network.load(NETWORK)
    assert network.sensor == sensor
    np.testing.assert_array_equal(parameter_vector(network), parameter_vector(trained))
    assert network.history["stages"][-1]["records"] == trained.history["stages"][-1]["records"]
    assert history.steps.tolist() == [0, 1, 2, 3]
    assert np.isfinite(history.test_psnr[-1])
    assert file_names(tmp_path) == [NETWORK, "photos", "run.png"]
    assert (tmp_path / "run.png").stat().st_size > 10_000
    assert run("info", NETWORK, "--plot", "later.png")[0] == 0
    assert "3 steps of Muon(learning_rate=0.002)" in run("info", NETWORK)[1]


def test_the_optimizer_and_the_precision_are_those_of_python(run, photo_folder):
    arguments = [*SMALL, "--optimizer", "adam", "--precision", "bf16", "--seed", 7, "-t", 2]
    assert run("train", photo_folder, "-o", NETWORK, *arguments)[0] == 0
    sensor = jl.Sensor(oversampling=4, frames=2)
    trained, _ = jl.torch.train(
        jl.Network.residual(sensor, "small", rng=7), read_image_set(photo_folder)[1], sensor,
        optimizer="adam", precision="bf16", steps=3, batch=2, rng=7, device="cpu", threads=1,
    )  # fmt: skip
    network = jl.Network.load(NETWORK)
    np.testing.assert_array_equal(parameter_vector(network), parameter_vector(trained))
    assert network.history["stages"][-1]["run"] == trained.history["stages"][-1]["run"]


def test_a_conditional_network_is_trained_and_improved(run, photo_folder, tmp_path):
    arguments = [*SMALL, "--bits-per-pixel", "2:64", "--learning-rate", 1e-3]
    arguments += ["--test", photo_folder, "--plot", "run.png"]
    status, output = run("train", photo_folder, "-o", NETWORK, *arguments)
    assert status == 0
    assert "are for --test only" not in output
    network = jl.Network.load(NETWORK)
    assert network.trials_range == (2, 64)
    assert (tmp_path / "run.png").stat().st_size > 10_000
    arguments = ["--start", NETWORK, *SMALL[2:], "--frames", 4, "--learning-rate", 1e-3]
    status, output = run("train", photo_folder, "-o", "more.safetensors", *arguments)
    assert status == 0
    assert "serves every sensor: options of a sensor are for --test only" in output
    more = jl.Network.load("more.safetensors")
    assert more.trials_range == (2, 64)
    assert (parameter_vector(more) != parameter_vector(network)).any()


def test_a_conditional_network_is_tested_within_its_range_also_when_it_is_improved(
    run, photo_folder
):
    images = ["train", photo_folder, "--test", photo_folder]
    small = ["--batch", 2, "--steps", 1, "--device", "cpu", "--seed", 5]
    arguments = ["--quality", "small", *small, "--bits-per-pixel", "20:256"]
    assert run(*images, "-o", NETWORK, *arguments)[0] == 0
    assert run(*images, "-o", "more.safetensors", "--start", NETWORK, *small)[0] == 0
    before, after = (
        History.from_json(jl.Network.load(name).history["stages"][-1]["records"])
        for name in (NETWORK, "more.safetensors")
    )
    assert after.test_psnr[0] == pytest.approx(before.test_psnr[-1], abs=1e-3)


def test_bits_per_pixel_state_the_sensor(run, photo_folder):
    arguments = [*SMALL, "--steps", 1, "--bits-per-pixel"]
    assert run("train", photo_folder, "-o", NETWORK, *arguments, 300)[0] == 0
    assert jl.Network.load(NETWORK).sensor == jl.Sensor(frames=300)


def test_the_tests_of_a_conditional_network_may_have_more_bits_than_it_knows(run, photo_folder):
    arguments = [*SMALL, "--bits-per-pixel", "1:8", "-t", 4, "--test", photo_folder]
    status, output = run("train", photo_folder, "-o", NETWORK, *arguments)
    assert status == 0, output
    assert "a small network for any number of bits per pixel, trained in 3 steps" in output
    assert "test PSNR" in output


def test_a_network_for_a_capture_has_its_brightness(run):
    sensor = jl.Sensor(frames=16)
    jl.save(sensor.expose(0.3 * jl.datasets.photograph("camera")[:64, :64], rng=0), "capture.npy")
    status, output = run("train", "--sensor", "capture.npy", "-o", NETWORK, *SMALL)
    assert status == 0
    assert "trained in 3 steps" in output
    assert 0.3 < jl.Network.load(NETWORK).sensor.max_intensity < 0.9


def test_synthetic_scenes_reduce_the_patch_to_their_size(run):
    assert run("train", "synthetic", "-o", NETWORK, *SMALL, "--steps", 1)[0] == 0
    assert jl.Network.load(NETWORK).history["stages"][-1]["run"]["patch"] == 32


@pytest.mark.parametrize("step", [1, 2])
def test_a_stopped_run_is_kept_and_resumed_to_the_same_network(
    run, photo_folder, tmp_path, monkeypatch, step
):
    status, output = stop(run, "--test", "photos", step=step)
    assert status == 130
    assert f"The run so far is kept in {CHECKPOINT}" in output
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]
    status, output = run("train", "photos", "-o", NETWORK, *SMALL)
    assert status == 1
    assert "add --resume" in output
    output = run("info", CHECKPOINT)[1]
    assert "got a jotlight checkpoint; the run that wrote it continues with --resume" in output
    arguments = [*SMALL, "--test", "photos"]
    assert run("train", "photos", "-o", NETWORK, *arguments, "--resume")[0] == 0
    assert run("train", "photos", "-o", "uninterrupted.safetensors", *arguments)[0] == 0
    assert_same_networks(NETWORK, "uninterrupted.safetensors")
    first, second = (
        jl.Network.load(name).history for name in (NETWORK, "uninterrupted.safetensors")
    )
    assert first == second
    assert CHECKPOINT not in file_names(tmp_path)


def test_a_run_out_of_time_reports_its_steps(run, photo_folder):
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--seconds", 1e-9)
    assert status == 0
    assert "trained in 0 of 3 steps" in output or "trained in 1 of 3 steps" in output


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--learning-rate", 0], "learning_rate: expected a finite number above 0"),
        (["--optimizer", "gauss-newton"], "optimizer: expected one of muon, adam, got 'gauss-"),
        (["--precision", "f16"], "precision: expected one of f32, bf16, got 'f16'"),
        (["--device", "tpu"], "device: expected one of cpu, cuda, got 'tpu'"),
        (["--steps", 0], "steps: expected at least 1"),
        (["--patch", 25], "got 25. The smallest image, number 0, is 24 x 24"),
        (["--bits-per-pixel", "1-256"], "bits-per-pixel: expected a number such as 16, or"),
        (["--bits-per-pixel", "9:4"], "bits-per-pixel: expected a number such as 16, or"),
        (["--bits-per-pixel", "0"], "bits-per-pixel: expected a number such as 16, or"),
        (["--bits-per-pixel", "20:64", "-t", 1], "is for 20 trials per pixel or more, got 16"),
        (["--bits-per-pixel", "16", "-t", 2], "--oversampling and --frames; leave out --frames"),
    ],
)
def test_bad_input_gets_one_line(run, photo_folder, arguments, expected):
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, *arguments)
    assert status == 1
    assert expected in output
    assert len(output.splitlines()) == 1


def test_a_diverging_run_names_the_option_to_lower(run, photo_folder, tmp_path, monkeypatch):
    monkeypatch.setattr(Batch, "squared_errors", lambda _, module: module.filters[2].sum() / 0)
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL)
    assert status == 1
    advice = "lower the learning rate, now 0.003. Start again with --restart and --learning-rate"
    assert advice in output
    assert file_names(tmp_path) == ["photos"]


def test_a_missing_gpu_is_an_error(run, photo_folder):
    if torch.cuda.is_available():
        pytest.skip("there is one")
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--device", "cuda")
    assert status == 1
    assert "PyTorch finds no GPU" in output


def test_only_the_first_of_several_processes_prints_and_writes(
    run, photo_folder, tmp_path, monkeypatch
):
    train, received = training.train, {}

    def train_without_checkpoint(*positional, checkpoint, **options):
        # Only the first process writes it, and this test runs in one process.
        received.update(options, checkpoint=checkpoint)
        return train(*positional, **options)

    (tmp_path / CHECKPOINT).write_bytes(b"of the first process")
    monkeypatch.setattr(training, "train", train_without_checkpoint)
    monkeypatch.setattr(distributed, "rank", lambda: 1)
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--plot", "run.png")
    assert (status, output) == (0, "")
    assert received["checkpoint"].name == CHECKPOINT
    assert "callback" not in received
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--learning-rate", -1)
    assert status == 1
    assert output.startswith("error: learning_rate: expected a finite number above 0")


def test_long_histories_are_subsampled():
    history = History.from_json(
        {
            "step": list(range(20_001)),
            "loss": [float(step) for step in range(20_001)],
            "gradient_norm": [1.0] * 20_001,
            "test_psnr": [30.0 if step % 1000 == 0 else None for step in range(20_001)],
            "held_out": [None] * 20_001,
        }
    )
    kept = History.from_json(history.subsample().to_json())
    assert 500 <= len(kept) <= 525
    assert (kept.loss == kept.steps).all()
    assert kept.steps[-1] == 20_000
    assert np.isfinite(kept.test_psnr).sum() == 21
    assert history.subsample(30_000).records == history.records
