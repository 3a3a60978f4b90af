"""`jotlight fine-tune capture.npy`."""

import shlex

import numpy as np
import pytest

import jotlight as jl
from folders import file_names
from jotlight.training import History, parameter_vector
from training_runs import interrupted_at

torch = pytest.importorskip("torch")

from jotlight.cli import fine_tune  # noqa: E402
from jotlight.torch import distributed, fine_tuning  # noqa: E402

SENSOR = jl.Sensor(frames=8)
SCENE = jl.datasets.photograph("camera")[100:164, 180:244]
OWN, CHECKPOINT = "own.safetensors", "own.checkpoint.safetensors"
SHORT_RUN = ["--steps", 3, "--batch", 2, "--patch", 24, "--device", "cpu", "--threads", 1]


@pytest.fixture
def run_fine_tune(run, tmp_path):
    """Return a function that fine-tunes a K-conditioned network on a capture of a photograph."""
    jl.save(SENSOR.expose(SCENE, rng=0), tmp_path / "capture.npy")
    jl.Network.conditional("small", rng=0).save(tmp_path / "start.safetensors")

    def run_fine_tune(*arguments, capture="capture.npy", start="start.safetensors"):
        starts = [] if start is None else ["--start", start]
        return run("fine-tune", capture, "-o", OWN, *starts, *SHORT_RUN, *arguments)

    return run_fine_tune


def held_out(name=OWN):
    return History.from_json(jl.Network.load(name).history["stages"][-1]["records"]).held_out


def test_the_held_out_bits_of_a_capture_become_more_likely(run_fine_tune, run, tmp_path):
    status, output = run_fine_tune(
        "--steps", 60, "--batch", 8, "--learning-rate", 3e-3, "--plot", "run.png"
    )
    assert status == 0
    before, after = held_out()[0], held_out()[-1]
    assert after < before - 1e-4
    assert "starting from start.safetensors" in output
    assert "step 60/60  cost 0." in output
    assert f"held out {after:.5f} nats per bit" in output
    assert "fine-tuned on this capture, trained in 60 steps" in output
    assert f"{before:.5f} to {after:.5f} nats per held-out bit" in output
    assert (tmp_path / "run.png").stat().st_size > 10_000
    assert CHECKPOINT not in file_names(tmp_path)
    # The printed command writes an image.
    command = shlex.split(output.split("Reconstruct with it: jotlight ")[1].splitlines()[0])
    assert run(*command)[0] == 0
    assert (tmp_path / "image.png").is_file()
    info = run("info", OWN, "--plot", "later.png")[1] + run("info", OWN)[1]
    assert "60 steps of Adam(learning_rate=0.003), seed 0" in info
    assert "fine-tuned on capture.npy" in " ".join(info.split())
    assert f"held out {before:.5f} to {after:.5f} nats per bit" in " ".join(info.split())


def test_the_network_equals_that_of_python(run_fine_tune):
    assert run_fine_tune("--seed", 7, "--learning-rate", 0.002)[0] == 0
    own, history = jl.torch.fine_tune(
        jl.Network.load("start.safetensors"), jl.open("capture.npy"), steps=3, batch=2, patch=24,
        learning_rate=0.002, rng=7, device="cpu", threads=1,
    )  # fmt: skip
    np.testing.assert_array_equal(parameter_vector(jl.Network.load(OWN)), parameter_vector(own))
    np.testing.assert_array_equal(held_out(), history.held_out)


def test_the_defaults_are_those_of_python(run_fine_tune, run):
    start = ["--start", "start.safetensors"]
    arguments = ["fine-tune", "capture.npy", "-o", OWN, *start, "--steps", 1]
    assert run(*arguments)[0] == 0
    own, _ = jl.torch.fine_tune(
        jl.Network.load("start.safetensors"), jl.open("capture.npy"), steps=1, rng=0
    )
    settings = jl.Network.load(OWN).history["stages"][-1]["run"]
    assert settings == own.history["stages"][-1]["run"]
    assert (settings["batch"], settings["patch"]) == (16, 48)


def test_without_a_start_the_chosen_network_is_printed(run_fine_tune, monkeypatch):
    small = jl.Network.conditional("small", rng=0)
    asked = []

    def pretrained(*positional):
        asked.append(positional)
        return small

    monkeypatch.setattr(fine_tune, "pretrained", pretrained)
    status, output = run_fine_tune(start=None)
    assert status == 0
    assert asked == [(SENSOR, "medium")]
    assert "fine-tuning a medium network for any number of bits per pixel" in output


def test_capture_options_are_those_of_reconstruct(run_fine_tune, run, tmp_path):
    """Counts in an archive, selected and flipped frames, and the options of the sensor."""
    counts = SENSOR.expose(SCENE, rng=0).counts()
    np.savez(tmp_path / "sets.npz", a=counts, b=counts[:40])
    capture = {"capture": "sets.npz"}
    arguments = ["--key", "b", "--frames", 8, "--rotate", 90, "--dark-counts", 0.01]
    status, output = run_fine_tune(*arguments, **capture)
    assert status == 0
    assert "Sensor(frames=8, dark_counts=0.01)" in output
    again = "reconstruct sets.npz --rotate 90 --key b --frames 8 --dark-counts 0.01"
    assert f"jotlight {again} --model {OWN} -o image.png" in output
    assert run(*again.split(), "--model", OWN, "-o", "out.npy")[0] == 0
    assert np.load("out.npy").shape == (64, 40)
    status, output = run_fine_tune("--frame-range", "2:6", "--flip", "horizontal", "--restart")
    assert status == 0
    assert "frames 2:6 of 8" in output
    assert jl.Network.load(OWN).history["stages"][-1]["run"]["sensor"]["frames"] == 4


def test_a_network_for_one_sensor_keeps_its_range(run_fine_tune, tmp_path):
    jl.Network.initial(SENSOR.replace(max_intensity=2.0)).save("two.safetensors")
    assert run_fine_tune(start="two.safetensors")[0] == 0
    assert jl.Network.load(OWN).sensor.max_intensity == 2


def test_a_calibration_changes_the_likelihood(run_fine_tune, run, tmp_path):
    dark = jl.Sensor(frames=200, dark_counts=0.05).expose(np.zeros((64, 64)), rng=1)
    jl.save(dark, tmp_path / "dark.npy")
    assert run("calibrate", "dark.npy", "-o", "c.safetensors")[0] == 0
    status, output = run_fine_tune("--calibration", "c.safetensors")
    assert status == 0
    assert "--calibration c.safetensors" in output.split("Reconstruct with it")[1]
    other = jl.Network.load(OWN).history["stages"][-1]["run"]["capture"]
    assert run_fine_tune()[0] == 0
    assert jl.Network.load(OWN).history["stages"][-1]["run"]["capture"] != other


@pytest.mark.parametrize("step", [0, 2])
def test_a_resumed_run_equals_an_uninterrupted_one(run_fine_tune, tmp_path, monkeypatch, step):
    with interrupted_at(step, fine_tuning, "fine_tune"):
        status, output = run_fine_tune()
    assert status == 130
    assert f"The run so far is kept in {CHECKPOINT}" in output
    assert OWN not in file_names(tmp_path)
    status, output = run_fine_tune()
    assert status == 1
    assert "add --resume" in output
    status, output = run_fine_tune("--resume", "--seed", 1)
    assert status == 1
    assert "seed is 0 in the file and 1 in this run" in output
    assert run_fine_tune("--resume")[0] == 0
    resumed = jl.Network.load(OWN)
    assert run_fine_tune()[0] == 0
    whole = jl.Network.load(OWN)
    np.testing.assert_array_equal(parameter_vector(resumed), parameter_vector(whole))
    assert resumed.history == whole.history
    assert CHECKPOINT not in file_names(tmp_path)


def test_a_run_without_improvement_is_reported_and_keeps_the_start(run_fine_tune):
    status, output = run_fine_tune("--learning-rate", 30)
    assert status == 0
    assert "no improvement" in output
    start, own = (parameter_vector(jl.Network.load(name)) for name in ("start.safetensors", OWN))
    np.testing.assert_array_equal(start, own)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--device", "tpu"], "device: expected one of cpu, cuda, got 'tpu'"),
        (["--resume"], "there is no stopped run to resume"),
        (["-o", "own.npy"], "expected a name that ends in .safetensors"),
        (["--plot", "run.gif"], "run.gif"),
        (["-o", "start.safetensors"], "start.safetensors: this file is read"),
    ],
)
def test_bad_input_gets_one_line(run_fine_tune, tmp_path, arguments, expected):
    status, output = run_fine_tune(*arguments)
    assert status == 1
    assert expected in output
    assert len(output.splitlines()) == 1
    assert OWN not in file_names(tmp_path)


@pytest.mark.parametrize(
    "arguments",
    [
        ["photos"],
        ["--sensor", "capture.npy"],
        ["--bits-per-pixel", "8"],
        ["--test", "photos"],
        ["--seconds", 9],
        ["--optimizer", "adam"],
        ["--white", 9],
    ],
)
def test_options_of_train_are_unknown(run_fine_tune, tmp_path, arguments):
    status, output = run_fine_tune(*arguments)
    assert status == 2
    assert output.startswith(("error: Unknown option: ", "error: `jotlight fine-tune` takes 1 arg"))
    assert OWN not in file_names(tmp_path)


@pytest.mark.parametrize(
    ("sensor", "arguments", "expected"),
    [
        ({"frames": 4, "kernel": "cubic"}, [], "expected the box kernel, got cubic"),
        ({"frames": 4}, ["--steps", 0], "steps: expected at least 1, got 0"),
        ({"frames": 4}, ["--learning-rate", 0], "learning_rate: expected a finite number above 0"),
        ({"frames": 4}, ["--patch", 65], "patch: expected 1 to the 64 pixels"),
    ],
)
def test_an_unsuitable_capture_is_refused_with_the_reason(
    run_fine_tune, tmp_path, sensor, arguments, expected
):
    jl.save(jl.Sensor(**sensor).expose(SCENE, rng=0), tmp_path / "other.npy")
    status, output = run_fine_tune(*arguments, capture="other.npy", start=None)
    assert status == 1
    assert expected in output
    assert output.splitlines()[-1].startswith("error: ")
    assert OWN not in file_names(tmp_path)


def test_a_pattern_of_captures_gets_advice(run):
    status, output = run("fine-tune", "b*.npy", "-o", OWN)
    assert status == 1
    assert "name one; `jotlight reconstruct`" in output


def test_capture_options_need_a_capture(run, photo_folder):
    status, output = run("train", photo_folder, "-o", OWN, "--rotate", 90)
    assert status == 1
    assert "rotate: is for a capture; name one with --sensor" in output


def test_only_the_first_of_several_processes_prints_and_writes(
    run_fine_tune, tmp_path, monkeypatch
):
    tune, received = fine_tuning.fine_tune, {}

    def tuned(*positional, **options):
        received.update(options)
        return tune(*positional, **{**options, "checkpoint": None})

    (tmp_path / CHECKPOINT).write_bytes(b"of the first process")
    monkeypatch.setattr(fine_tuning, "fine_tune", tuned)
    monkeypatch.setattr(distributed, "rank", lambda: 1)
    assert run_fine_tune() == (0, "")
    assert "callback" not in received
    assert OWN not in file_names(tmp_path)
