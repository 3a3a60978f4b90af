"""`jotlight train`: stopped, resumed, and failed runs."""

import contextlib
import errno
import signal
import subprocess
import sys

import numpy as np
import pytest
from safetensors.numpy import load_file

import jotlight as jl
from folders import file_names
from training_runs import assert_same_networks, interrupted_at

SMALL = ["--patch", 24, "--batch", 4, "--steps", 3, "--optimizer", "adam"]
LONG = ["--patch", 24, "--batch", 4, "--steps", 600, "--optimizer", "adam"]
NETWORK, CHECKPOINT = "net.safetensors", "net.checkpoint.safetensors"


def stop(run, photo_folder, *arguments, step=1):
    """Run the command and press Ctrl-C at the end of a step."""
    with interrupted_at(step, jl.training):
        return run("train", photo_folder, "-o", NETWORK, *SMALL, *arguments)


@contextlib.contextmanager
def long_run(folder):
    """Start a run in another process and wait until it has taken some steps."""
    arguments = ["train", "photos", "-o", NETWORK, *map(str, LONG)]
    # A shell lets its background jobs ignore SIGINT, and these tests may be one.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    code += f"import sys; sys.argv = ['jotlight', *{arguments!r}];"
    code += "from jotlight.cli.app import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=folder, stderr=subprocess.PIPE, text=True
    ) as child:
        try:
            assert child.stderr.readline().startswith("training a two-layer network")
            assert child.stderr.readline().startswith("step 0/600")
            assert child.stderr.readline().startswith("step 60/600")
            yield child
        finally:
            child.kill()


def test_the_same_command_removes_what_a_killed_run_left(run, photo_folder, tmp_path, monkeypatch):
    assert stop(run, photo_folder)[0] == 130
    leftovers = [".net.jotlight-vm-0.safetensors", ".figure.jotlight-vm-0.svg"]
    monkeypatch.setattr("platform.node", lambda: "vm")
    for name in leftovers:
        (tmp_path / name).touch()
        (tmp_path / f"{name}.lock").touch()
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--plot", "figure.svg")
    assert status == 1
    assert "add --resume to continue it" in output
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]


def test_names_like_markup_are_printed_as_they_are(run, photo_folder, tmp_path):
    (tmp_path / "a[").mkdir()
    with interrupted_at(1, jl.training):
        _, output = run("train", photo_folder, "-o", "a[/b].safetensors", *SMALL)
    assert "a[/b].checkpoint.safetensors" in output


@pytest.mark.slow
def test_a_run_stopped_by_ctrl_c_resumes_to_the_same_network(run, photo_folder, tmp_path):
    with long_run(tmp_path) as child:
        child.send_signal(signal.SIGINT)
        _, output = child.communicate(timeout=20)
    assert child.returncode == 130
    assert f"The run so far is kept in {CHECKPOINT}" in output
    assert "--resume" in output
    assert "error: stopped" in output
    assert "Traceback" not in output
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]
    assert np.isfinite(load_file(CHECKPOINT)["vector"]).all()
    status, output = run("train", "photos", "-o", NETWORK, *LONG, "--resume")
    assert status == 0
    assert "step 0/600" not in output
    assert "step 600/600" in output
    assert file_names(tmp_path) == [NETWORK, "photos"]
    assert run("train", "photos", "-o", "uninterrupted.safetensors", *LONG)[0] == 0
    assert_same_networks(NETWORK, "uninterrupted.safetensors")


@pytest.mark.slow
def test_a_terminated_run_leaves_only_its_checkpoint(photo_folder, tmp_path):
    with long_run(tmp_path) as child:
        child.terminate()
        assert child.wait(timeout=20) == 143
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]
    assert np.isfinite(load_file(tmp_path / CHECKPOINT)["vector"]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("optimizer", "step"),
    [("adam", 0), ("adam", 3), ("projected-gradient", 2), ("gauss-newton", 0)],
)
def test_a_run_stopped_at_any_step_resumes_to_the_same_network(
    run, photo_folder, tmp_path, monkeypatch, step, optimizer
):
    arguments = [
        "--optimizer",
        optimizer,
        "--steps",
        3 if step else 1,
        "--test",
        "photos",
        "--threads",
        1,
    ]
    status, output = stop(run, "photos", *arguments, step=step)
    assert status == 130
    assert "--resume" in output
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]
    assert run("train", "photos", "-o", NETWORK, *SMALL, *arguments, "--resume")[0] == 0
    assert run("train", "photos", "-o", "uninterrupted.safetensors", *SMALL, *arguments)[0] == 0
    assert_same_networks(NETWORK, "uninterrupted.safetensors")
    first, second = (
        jl.Network.load(name).history for name in (NETWORK, "uninterrupted.safetensors")
    )
    assert first == second
    assert CHECKPOINT not in file_names(tmp_path)


def test_ctrl_c_before_the_first_checkpoint_mentions_none(run, photo_folder, tmp_path, monkeypatch):
    """The images are still being read at that time."""

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(jl.training, "train", stopped)
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL)
    assert status == 130
    assert file_names(tmp_path) == ["photos"]
    assert "is kept in" not in output


def test_a_stopped_run_is_not_overwritten_without_restart(run, photo_folder, tmp_path, monkeypatch):
    stop(run, photo_folder)
    before = (tmp_path / CHECKPOINT).read_bytes()
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL)
    assert status == 1
    assert output.startswith(f"error: {CHECKPOINT}: a run to this output was stopped")
    assert "--resume" in output
    assert "--restart" in output
    assert (tmp_path / CHECKPOINT).read_bytes() == before
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]


def test_restart_starts_a_new_run(run, photo_folder, tmp_path, monkeypatch):
    stop(run, photo_folder)
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--seed", 4, "--restart")
    assert status == 0
    assert "step 0/3" in output
    assert file_names(tmp_path) == [NETWORK, "photos"]
    assert (
        run("train", photo_folder, "-o", "uninterrupted.safetensors", *SMALL, "--seed", 4)[0] == 0
    )
    assert_same_networks(NETWORK, "uninterrupted.safetensors")


def test_restart_without_a_stopped_run_starts_a_run(run, photo_folder):
    assert run("train", photo_folder, "-o", NETWORK, *SMALL, "--restart")[0] == 0


@pytest.mark.parametrize(
    "mistake", [["--optimizer", "sgd"], ["--start", "none.safetensors"], ["--patch", 99]], ids=str
)
def test_restart_with_a_mistake_keeps_the_stopped_run(
    run, photo_folder, tmp_path, monkeypatch, mistake
):
    stop(run, photo_folder)
    before = (tmp_path / CHECKPOINT).read_bytes()
    assert run("train", photo_folder, "-o", NETWORK, *SMALL, "--restart", *mistake)[0] == 1
    assert (tmp_path / CHECKPOINT).exists()
    assert (tmp_path / CHECKPOINT).read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "difference"),
    [
        (["--batch", 5], "batch is 4 in the file and 5 in this run"),
        (["--seed", 5], "seed is 0 in the file and 5 in this run"),
        (["--steps", 5], "steps is 3 in the file and 5 in this run"),
        (["--learning-rate", 0.5], "learning_rate=0.01"),
        (["--optimizer", "gauss-newton"], "optimizer is 'Adam("),
        (["--sigma", 0.5], "different network"),
        (["-k", 3], "sensor is"),
        (["--test", "photos"], "different test"),
    ],
    ids=str,
)
def test_resuming_with_other_options_names_them_and_keeps_the_run(
    run, photo_folder, tmp_path, monkeypatch, arguments, difference
):
    stop(run, photo_folder)
    before = (tmp_path / CHECKPOINT).read_bytes()
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--resume", *arguments)
    assert status == 1
    assert output.startswith(f"error: {CHECKPOINT}: this checkpoint belongs to another run: ")
    assert difference in output
    assert "Start again with --restart, or use the settings" in " ".join(output.split())
    assert (tmp_path / CHECKPOINT).read_bytes() == before
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]


def test_resuming_with_other_images_is_refused(run, photo_folder, monkeypatch):
    stop(run, photo_folder)
    (photo_folder / "1.png").unlink()
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--resume")
    assert status == 1
    assert "different images" in output


@pytest.mark.parametrize("fraction", [0, 0.5, 0.99])
def test_a_damaged_checkpoint_is_named_and_kept(run, photo_folder, tmp_path, monkeypatch, fraction):
    stop(run, photo_folder)
    whole = (tmp_path / CHECKPOINT).read_bytes()
    (tmp_path / CHECKPOINT).write_bytes(whole[: int(fraction * len(whole))])
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--resume")
    assert status == 1
    assert output.startswith(f"error: {CHECKPOINT}: ")
    assert len(output.splitlines()) == 1
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]


def test_a_diverging_run_names_the_option_to_lower_and_keeps_its_checkpoint(
    run, photo_folder, tmp_path
):
    arguments = [*SMALL, "--steps", 300, "--optimizer", "projected-gradient"]
    status, output = run("train", photo_folder, "-o", NETWORK, *arguments, "--learning-rate", 1000)
    assert status == 1
    title, *steps, line = output.splitlines()
    assert title == "training a two-layer network for 16 bits per pixel"
    assert all(step.startswith("step ") for step in steps)
    assert line.startswith("error: step ")
    assert "diverges" in line
    assert "lower its learning_rate" in line
    assert file_names(tmp_path) == [CHECKPOINT, "photos"]
    assert np.isfinite(load_file(tmp_path / CHECKPOINT)["vector"]).all()
    again = [*arguments, "--learning-rate", 1e-6, "--steps", 3, "--restart"]
    assert run("train", photo_folder, "-o", NETWORK, *again)[0] == 0
    assert file_names(tmp_path) == [NETWORK, "photos"]


def test_a_full_disk_at_the_end_keeps_the_run(run, photo_folder, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(jl.Network, "save", full)
        status, output = run("train", photo_folder, "-o", NETWORK, *SMALL)
    assert status == 1
    assert f"error: cannot write {NETWORK}: No space left on device" in output
    assert f"The run so far is kept in {CHECKPOINT}" in output
    assert file_names(tmp_path) == ["net.checkpoint.safetensors", "photos"]
    assert run("train", photo_folder, "-o", NETWORK, *SMALL, "--resume")[0] == 0
    assert run("train", photo_folder, "-o", "uninterrupted.safetensors", *SMALL)[0] == 0
    assert_same_networks(NETWORK, "uninterrupted.safetensors")


def test_a_run_out_of_time_reports_its_steps_and_the_option(run, photo_folder, tmp_path):
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--seconds", 1e-9)
    assert status == 0
    assert (
        f"{NETWORK}: a two-layer network for 16 bits per pixel, trained in 1 of 3 steps and "
        in output
    )
    assert "; a larger --seconds allows more" in output
    assert file_names(tmp_path) == [NETWORK, "photos"]
    assert len(jl.Network.load(NETWORK).history["stages"][-1]["records"]["loss"]) == 2


@pytest.mark.parametrize(
    ("arguments", "seconds"),
    [
        ([], None),
        (["--sensor", "capture.npy"], 45.0),
        (["--sensor", "capture.npy", "--steps", 3], None),
        (["--sensor", "capture.npy", "--steps", 3, "--seconds", 9], 9.0),
        (["--seconds", 9], 9.0),
    ],
)
def test_training_for_a_capture_has_a_time_limit_unless_steps_are_set(
    run, photo_folder, monkeypatch, arguments, seconds
):
    jl.save(jl.Sensor(frames=4).expose(np.full((16, 16), 0.5), rng=0), "capture.npy")
    found = []

    def stop_training(*_, **options):
        found.append(options["seconds"])
        raise ValueError("stop here")

    monkeypatch.setattr(jl.training, "train", stop_training)
    assert "stop here" in run("train", photo_folder, "-o", NETWORK, *arguments)[1]
    assert found == [seconds]


@pytest.mark.slow
def test_a_disk_that_is_full_from_the_start_is_reported(photo_folder, tmp_path):
    pytest.importorskip("resource")
    code = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000));"
    code += f"sys.argv = ['jotlight', 'train', 'photos', '-o', {NETWORK!r}, "
    code += f"*{list(map(str, SMALL))!r}]; from jotlight.cli.app import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "error: cannot write net." in done.stderr
    assert "too large" in done.stderr
    assert "Traceback" not in done.stderr
    assert file_names(tmp_path) == ["photos"]
