import contextlib
import errno
import signal
import subprocess
import sys

import numpy as np
import pytest
from safetensors.numpy import load_file

import jotlight as jl
from jotlight.training import parameter_vector

SMALL = ["--patch", 24, "--batch", 4, "--steps", 3, "--optimizer", "adam"]
LONG = ["--patch", 24, "--batch", 4, "--steps", 600, "--optimizer", "adam"]
NETWORK, CHECKPOINT = "net.safetensors", "net.checkpoint.safetensors"


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def assert_same(one, other):
    np.testing.assert_array_equal(
        *(parameter_vector(jl.Network.load(name)) for name in (one, other))
    )


def stop(monkeypatch, run, pictures, *words, step=1):
    """Press Ctrl-C at the end of a step."""
    learn = jl.training.train

    def stopped(*arguments, callback, **options):
        def interrupt(record):
            callback(record)
            if record.step == step:
                raise KeyboardInterrupt

        return learn(*arguments, callback=interrupt, **options)

    with monkeypatch.context() as patched:
        patched.setattr(jl.training, "train", stopped)
        return run("train", pictures, "-o", NETWORK, *SMALL, *words)


@contextlib.contextmanager
def long_run(folder):
    """Start a run in a program of its own and wait until it has taken some steps."""
    words = ["train", "pictures", "-o", NETWORK, *map(str, LONG)]
    # A shell lets its background jobs ignore SIGINT, and these tests may be one.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    code += f"import sys; sys.argv = ['jotlight', *{words!r}];"
    code += "from jotlight.cli.app import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=folder, stderr=subprocess.PIPE, text=True
    ) as child:
        try:
            assert child.stderr.readline().startswith("step 0/600")
            assert child.stderr.readline().startswith("step 60/600")
            yield child
        finally:
            child.kill()


def test_ctrl_c_keeps_the_run_and_resuming_it_gives_the_network_of_one_that_was_not_stopped(
    run, pictures, tmp_path
):
    with long_run(tmp_path) as child:
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=20)
    assert child.returncode == 130
    assert f"The run so far is kept in {CHECKPOINT}" in said
    assert "--resume" in said
    assert "error: stopped" in said
    assert "Traceback" not in said
    assert files(tmp_path) == [CHECKPOINT, "pictures"]
    assert np.isfinite(load_file(CHECKPOINT)["vector"]).all()
    status, said = run("train", "pictures", "-o", NETWORK, *LONG, "--resume")
    assert status == 0
    assert "step 0/600" not in said
    assert "step 600/600" in said
    assert files(tmp_path) == [NETWORK, "pictures"]
    assert run("train", "pictures", "-o", "whole.safetensors", *LONG)[0] == 0
    assert_same(NETWORK, "whole.safetensors")


def test_terminating_keeps_the_run_and_leaves_nothing_else(pictures, tmp_path):
    with long_run(tmp_path) as child:
        child.terminate()
        assert child.wait(timeout=20) == 143
    assert files(tmp_path) == [CHECKPOINT, "pictures"]
    assert np.isfinite(load_file(tmp_path / CHECKPOINT)["vector"]).all()


@pytest.mark.parametrize(
    ("optimizer", "step"),
    [("adam", 0), ("adam", 3), ("projected-gradient", 2), ("gauss-newton", 0)],
)
def test_a_run_stopped_at_any_step_is_resumed(
    run, pictures, tmp_path, monkeypatch, step, optimizer
):
    words = [
        "--optimizer",
        optimizer,
        "--steps",
        3 if step else 1,
        "--test",
        "pictures",
        "--threads",
        1,
    ]
    status, said = stop(monkeypatch, run, "pictures", *words, step=step)
    assert status == 130
    assert "--resume" in said
    assert files(tmp_path) == [CHECKPOINT, "pictures"]
    assert run("train", "pictures", "-o", NETWORK, *SMALL, *words, "--resume")[0] == 0
    assert run("train", "pictures", "-o", "whole.safetensors", *SMALL, *words)[0] == 0
    assert_same(NETWORK, "whole.safetensors")
    one, other = (jl.Network.load(name).history for name in (NETWORK, "whole.safetensors"))
    assert one == other
    assert CHECKPOINT not in files(tmp_path)


def test_ctrl_c_before_there_is_a_checkpoint_promises_none(run, pictures, tmp_path, monkeypatch):
    """As while the images are looked through."""

    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(jl.training, "train", stopped)
    status, said = run("train", pictures, "-o", NETWORK, *SMALL)
    assert status == 130
    assert files(tmp_path) == ["pictures"]
    assert "is kept in" not in said


def test_a_stopped_run_is_not_overwritten_unasked(run, pictures, tmp_path, monkeypatch):
    stop(monkeypatch, run, pictures)
    before = (tmp_path / CHECKPOINT).read_bytes()
    status, said = run("train", pictures, "-o", NETWORK, *SMALL)
    assert status == 1
    assert said.startswith(f"error: {CHECKPOINT}: a run to this output was stopped")
    assert "--resume" in said
    assert "--restart" in said
    assert (tmp_path / CHECKPOINT).read_bytes() == before
    assert files(tmp_path) == [CHECKPOINT, "pictures"]


def test_restart_begins_anew(run, pictures, tmp_path, monkeypatch):
    stop(monkeypatch, run, pictures)
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--seed", 4, "--restart")
    assert status == 0
    assert "step 0/3" in said
    assert files(tmp_path) == [NETWORK, "pictures"]
    assert run("train", pictures, "-o", "whole.safetensors", *SMALL, "--seed", 4)[0] == 0
    assert_same(NETWORK, "whole.safetensors")


def test_restart_without_a_stopped_run_just_begins(run, pictures):
    assert run("train", pictures, "-o", NETWORK, *SMALL, "--restart")[0] == 0


@pytest.mark.parametrize(
    "mistake", [["--optimizer", "sgd"], ["--start", "none.safetensors"], ["--patch", 99]], ids=str
)
def test_restart_with_a_mistake_keeps_the_stopped_run(
    run, pictures, tmp_path, monkeypatch, mistake
):
    stop(monkeypatch, run, pictures)
    before = (tmp_path / CHECKPOINT).read_bytes()
    assert run("train", pictures, "-o", NETWORK, *SMALL, "--restart", *mistake)[0] == 1
    assert (tmp_path / CHECKPOINT).exists()
    assert (tmp_path / CHECKPOINT).read_bytes() == before


@pytest.mark.parametrize(
    ("words", "difference"),
    [
        (["--batch", 5], "batch is 4 in the file and 5 in this run"),
        (["--seed", 5], "seed is 0 in the file and 5 in this run"),
        (["--steps", 5], "steps is 3 in the file and 5 in this run"),
        (["--learning-rate", 0.5], "learning_rate=0.01"),
        (["--optimizer", "gauss-newton"], "optimizer is 'Adam("),
        (["--sigma", 0.5], "different network"),
        (["-k", 3], "sensor is"),
        (["--test", "pictures"], "different test"),
    ],
    ids=str,
)
def test_resuming_with_other_options_names_them_and_keeps_the_run(
    run, pictures, tmp_path, monkeypatch, words, difference
):
    stop(monkeypatch, run, pictures)
    before = (tmp_path / CHECKPOINT).read_bytes()
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--resume", *words)
    assert status == 1
    assert said.startswith(f"error: {CHECKPOINT}: this checkpoint belongs to another run: ")
    assert difference in said
    assert (tmp_path / CHECKPOINT).read_bytes() == before
    assert files(tmp_path) == [CHECKPOINT, "pictures"]


def test_resuming_with_other_pictures_says_so(run, pictures, monkeypatch):
    stop(monkeypatch, run, pictures)
    (pictures / "1.png").unlink()
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--resume")
    assert status == 1
    assert "different images" in said


@pytest.mark.parametrize("share", [0, 0.5, 0.99])
def test_a_damaged_checkpoint_is_named_and_kept(run, pictures, tmp_path, monkeypatch, share):
    stop(monkeypatch, run, pictures)
    whole = (tmp_path / CHECKPOINT).read_bytes()
    (tmp_path / CHECKPOINT).write_bytes(whole[: int(share * len(whole))])
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--resume")
    assert status == 1
    assert said.startswith(f"error: {CHECKPOINT}: ")
    assert len(said.splitlines()) == 1
    assert files(tmp_path) == [CHECKPOINT, "pictures"]


def test_a_run_that_diverges_says_what_to_lower_and_keeps_its_last_checkpoint(
    run, pictures, tmp_path
):
    words = [*SMALL, "--steps", 300, "--optimizer", "projected-gradient"]
    status, said = run("train", pictures, "-o", NETWORK, *words, "--learning-rate", 1000)
    assert status == 1
    *steps, line = said.splitlines()
    assert all(step.startswith("step ") for step in steps)
    assert line.startswith("error: step ")
    assert "diverges" in line
    assert "lower its learning_rate" in line
    assert files(tmp_path) == [CHECKPOINT, "pictures"]
    assert np.isfinite(load_file(tmp_path / CHECKPOINT)["vector"]).all()
    again = [*words, "--learning-rate", 1e-6, "--steps", 3, "--restart"]
    assert run("train", pictures, "-o", NETWORK, *again)[0] == 0
    assert files(tmp_path) == [NETWORK, "pictures"]


def test_a_full_disk_at_the_end_keeps_the_run(run, pictures, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(jl.Network, "save", full)
        status, said = run("train", pictures, "-o", NETWORK, *SMALL)
    assert status == 1
    assert f"error: cannot write {NETWORK}: No space left on device" in said
    assert files(tmp_path) == ["net.checkpoint.safetensors", "pictures"]
    assert run("train", pictures, "-o", NETWORK, *SMALL, "--resume")[0] == 0
    assert run("train", pictures, "-o", "whole.safetensors", *SMALL)[0] == 0
    assert_same(NETWORK, "whole.safetensors")


def test_a_run_that_has_no_time_for_all_its_steps_says_so(run, pictures, tmp_path):
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--seconds", 1e-9)
    assert status == 0
    assert f"{NETWORK}: trained in 1 of 3 steps and " in said
    assert "; a larger --seconds allows more" in said
    assert files(tmp_path) == [NETWORK, "pictures"]
    assert len(jl.Network.load(NETWORK).history["records"]["loss"]) == 2


@pytest.mark.parametrize(
    ("words", "seconds"),
    [
        ([], None),
        (["--sensor", "seen.npy"], 45.0),
        (["--sensor", "seen.npy", "--steps", 3], None),
        (["--sensor", "seen.npy", "--steps", 3, "--seconds", 9], 9.0),
        (["--seconds", 9], 9.0),
    ],
)
def test_learning_for_a_capture_has_a_time_unless_it_is_told_its_steps(
    run, pictures, monkeypatch, words, seconds
):
    jl.save(jl.Sensor(frames=4).expose(np.full((16, 16), 0.5), rng=0), "seen.npy")
    found = []

    def learn(*_, **options):
        found.append(options["seconds"])
        raise ValueError("seen enough")

    monkeypatch.setattr(jl.training, "train", learn)
    assert "seen enough" in run("train", pictures, "-o", NETWORK, *words)[1]
    assert found == [seconds]


def test_a_disk_that_is_full_from_the_start_is_named(pictures, tmp_path):
    pytest.importorskip("resource")
    code = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000));"
    code += f"sys.argv = ['jotlight', 'train', 'pictures', '-o', {NETWORK!r}, "
    code += f"*{list(map(str, SMALL))!r}]; from jotlight.cli.app import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "error: cannot write net." in done.stderr
    assert "too large" in done.stderr
    assert "Traceback" not in done.stderr
    assert files(tmp_path) == ["pictures"]
