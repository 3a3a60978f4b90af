"""Interrupted runs and their checkpoints."""

import json
import time

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

import jotlight as jl
from jotlight.training import Adam, SafeSet, parameter_vector
from jotlight.training.checkpoint import CheckpointWriter
from training_runs import IMAGES, OPTIMIZERS, SENSOR, START, STEPS, assert_same, train

pytestmark = pytest.mark.slow


def stopping(step):
    def callback(record):
        if record.step == step:
            raise KeyboardInterrupt

    return callback


@pytest.mark.parametrize("step", [0, 2, STEPS - 1, STEPS])
@pytest.mark.parametrize("optimizer", OPTIMIZERS.values(), ids=OPTIMIZERS)
def test_a_resumed_run_equals_an_uninterrupted_one(tmp_path, optimizer, step):
    options = {"optimizer": optimizer, "test": list(IMAGES[:2]), "checkpoint": tmp_path / "run"}
    whole = train(optimizer=optimizer, test=list(IMAGES[:2]))
    with pytest.raises(KeyboardInterrupt):
        train(**options, callback=stopping(step))
    seen = []
    resumed = train(**options, resume=True, callback=lambda record: seen.append(record.step))
    assert seen == list(range(min(step + 1, STEPS), STEPS + 1))
    assert_same(whole, resumed)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize("optimizer", OPTIMIZERS.values(), ids=OPTIMIZERS)
def test_a_run_ends_before_the_step_that_would_exceed_the_time_limit(
    tmp_path, monkeypatch, optimizer
):
    """Each call of the clock advances it by a second."""
    clock = iter(range(1000))
    runs = []
    with monkeypatch.context() as patched:
        patched.setattr(time, "monotonic", lambda: next(clock))
        for name in ("one", "other"):
            options = {"optimizer": optimizer, "checkpoint": tmp_path / name, "test": IMAGES[:2]}
            runs.append(train(seconds=15.5, **options))
            assert 1 < len(runs[-1][1]) - 1 < STEPS
    assert_same(*runs)
    whole = train(**options)
    stopped = runs[0][1]
    assert stopped.records[-1].step == len(stopped) - 1
    assert stopped.records[:-1] == whole[1].records[: len(stopped) - 1]
    assert_same(train(**options, resume=True), whole)
    # The first step always runs, and a long limit changes nothing.
    assert len(train(optimizer=optimizer, seconds=1e-9)[1]) == 2
    assert_same(train(optimizer=optimizer, seconds=1e9), train(optimizer=optimizer))


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_a_run_stopped_within_a_step_repeats_that_step(tmp_path, monkeypatch, error):
    options = {"optimizer": "adam", "checkpoint": tmp_path / "run"}
    whole, take_step = train(optimizer="adam"), Adam.take_step

    def stopped(self, cost, vector, state):
        if cost.step == 3:
            raise error
        return take_step(self, cost, vector, state)

    with monkeypatch.context() as patched:
        patched.setattr(Adam, "take_step", stopped)
        with pytest.raises(error):
            train(**options)
    assert_same(whole, train(**options, resume=True))


def test_the_history_of_a_resumed_run_is_exact_to_the_last_bit(tmp_path):
    path = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(checkpoint=path, callback=stopping(2))
    assert train(checkpoint=path, resume=True)[1].records == train()[1].records


def test_without_a_seed_a_resumed_run_has_the_seed_of_its_checkpoint(tmp_path):
    path = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(rng=None, checkpoint=path, callback=stopping(2))
    resumed = train(rng=None, checkpoint=path, resume=True)
    assert_same(resumed, train(rng=resumed[0].history["stages"][-1]["run"]["seed"]))
    other = train(rng=None, checkpoint=path)
    assert (
        other[0].history["stages"][-1]["run"]["seed"]
        != resumed[0].history["stages"][-1]["run"]["seed"]
    )


@pytest.mark.parametrize("seed", [None, -1, True, "3"])
def test_a_checkpoint_without_a_valid_seed_is_refused(tmp_path, seed):
    path = tmp_path / "run"
    run = train(checkpoint=path)[0].history["stages"][-1]["run"]
    rewritten("run", json.dumps({**run, "seed": seed}))(path)
    with pytest.raises(ValueError, match="run: damaged checkpoint: expected a seed, got"):
        train(rng=None, checkpoint=path, resume=True)


def test_resuming_without_a_seed_needs_a_checkpoint(tmp_path):
    with pytest.raises(ValueError, match="resume: expected a checkpoint to resume from, got none"):
        train(rng=None, resume=True)
    with pytest.raises(FileNotFoundError, match="there is no checkpoint"):
        train(rng=None, checkpoint=tmp_path / "none", resume=True)


def test_resuming_a_finished_run_changes_nothing(tmp_path):
    path = tmp_path / "run"
    whole = train(checkpoint=path)
    before = load_file(path)
    assert_same(whole, train(checkpoint=path, resume=True))
    np.testing.assert_equal(load_file(path), before)


def test_checkpoints_are_written_at_intervals(tmp_path, monkeypatch):
    path, found = tmp_path / "run", []
    monkeypatch.setattr(CheckpointWriter, "INTERVAL", -1.0)

    def look(_):
        if path.exists():
            found.append(load_file(path)["vector"])

    train(checkpoint=path, callback=look)
    # One file after each step. The next step sees it.
    assert len(np.unique(found, axis=0)) == STEPS
    monkeypatch.setattr(CheckpointWriter, "INTERVAL", 1e9)
    found.clear()
    path.unlink()
    train(checkpoint=path, callback=look)
    # One file after the first step, and one at the end.
    assert len(np.unique(found, axis=0)) == 2


def test_a_file_that_is_no_checkpoint_is_not_overwritten(tmp_path):
    path = tmp_path / "model.safetensors"
    START.save(path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="no checkpoint, so it is not overwritten"):
        train(checkpoint=path)
    assert path.read_bytes() == before


def test_a_checkpoint_with_inadmissible_parameters_is_refused(tmp_path):
    path = tmp_path / "run"
    train(checkpoint=path)
    with safe_open(path, "numpy") as file:
        metadata = file.metadata()
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    tensors["vector"] += 100
    save_file(tensors, path, metadata)
    with pytest.raises(
        ValueError, match="damaged checkpoint: its parameters are not in the admissible set"
    ):
        train(checkpoint=path, resume=True)


def test_a_missing_checkpoint_is_an_error(tmp_path):
    for path in (tmp_path / "none", tmp_path):
        with pytest.raises(FileNotFoundError, match="there is no checkpoint"):
            train(checkpoint=path, resume=True)
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        train(checkpoint=tmp_path / "no" / "run")


OTHER = jl.Network.initial(SENSOR, taps=3, coefficients=12, sigma=0.5)
WIDER = jl.Network.initial(SENSOR, taps=5, coefficients=12)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"rng": 4}, "seed is 3 in the file and 4 in this run"),
        ({"patch": 13}, "patch is 12 in the file and 13 in this run"),
        ({"batch": 8}, "batch is 7 in the file and 8 in this run"),
        ({"images": IMAGES[::-1]}, "different images"),
        ({"test": IMAGES[:1]}, "different test"),
        ({"optimizer": "adam"}, r"optimizer is 'GaussNewton\(.*' in the file and 'Adam\("),
        (
            {"admissible": SafeSet(0.1)},
            r"admissible is 'SafeSet\(nu=0.5, monotone=True\)' in the file",
        ),
        ({"sensor": SENSOR.replace(dark_counts=0.1)}, "sensor is"),
        ({"network": OTHER}, "different network"),
        ({"network": WIDER}, "different network"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused_and_kept(tmp_path, changes, name):
    path = tmp_path / "run"
    train(checkpoint=path)
    before = path.read_bytes()
    with pytest.raises(
        ValueError, match=f"this checkpoint belongs to another run: .*{name}.* resume=False"
    ):
        train(**changes, checkpoint=path, resume=True)
    assert path.read_bytes() == before
    train(**changes, checkpoint=path, resume=False)  # what the message advises


def rewritten(name, change):
    """A function that changes one metadata entry or tensor of a checkpoint."""

    def damage(path):
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata()
        tensors = load_file(path)
        if name in metadata:
            metadata[name] = change
        else:
            tensors[name] = change(tensors[name])
        save_file(tensors, path, metadata)

    return damage


def columns(length, norms):
    rest = {"step": list(range(length)), "test_psnr": [1] * length, "held_out": [1] * length}
    return json.dumps({"loss": [1] * length, "gradient_norm": [1] * norms, **rest})


DAMAGES = {
    "empty": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-100]),
    "noise": lambda path: path.write_bytes(bytes(range(256)) * 9),
    "model": START.save,
    "other tensors": lambda path: save_file({"vector": np.ones(3)}, path),
    "version": rewritten("version", "2"),
    "run no JSON": rewritten("run", "{"),
    "run no object": rewritten("run", "[1]"),
    "run deep": rewritten("run", "[" * 100_000),
    "history no JSON": rewritten("history", ""),
    "history uneven": rewritten("history", columns(1, 2)),
    "history too long": rewritten("history", columns(9, 9)),
    "short vector": rewritten("vector", lambda x: x[:-1]),
    "whole-number vector": rewritten("vector", lambda x: x.astype(int)),
    "NaN in vector": rewritten("vector", lambda x: x * np.nan),
    "small matrix": rewritten("state.matrix", lambda x: x[:3, :3].copy()),
    "no damping": rewritten("state.damping", lambda x: np.empty(0)),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_checkpoint_is_refused(tmp_path, damage):
    path = tmp_path / "run.safetensors"
    with pytest.raises(KeyboardInterrupt):
        train(checkpoint=path, callback=stopping(1))
    damage(path)
    with pytest.raises(ValueError, match=r"run.safetensors: (damaged checkpoint|expected )"):
        train(checkpoint=path, resume=True)


STATES = {
    "adam": ["mean", "square"],
    "gauss-newton": ["matrix", "damping"],
}


@pytest.mark.parametrize(
    ("optimizer", "missing"),
    [(name, part) for name, parts in STATES.items() for part in (*parts, "all")],
)
def test_a_checkpoint_without_the_state_of_its_optimizer_is_refused(tmp_path, optimizer, missing):
    path = tmp_path / "run"
    options = {"optimizer": OPTIMIZERS[optimizer], "checkpoint": path}
    with pytest.raises(KeyboardInterrupt):
        train(**options, callback=stopping(1))
    names = STATES[optimizer] if missing == "all" else [missing]
    with safe_open(path, framework="numpy") as file:
        metadata = file.metadata()
    tensors = load_file(path)
    rest = {name: each for name, each in tensors.items() if name[6:] not in names}
    save_file(rest, path, metadata)
    with pytest.raises(ValueError, match=rf"it has no state\.{names[0]}\); start again"):
        train(**options, resume=True)


def test_a_full_disk_leaves_the_last_checkpoint_intact(tmp_path, monkeypatch):
    resource = pytest.importorskip("resource")
    path = tmp_path / "run"
    monkeypatch.setattr(CheckpointWriter, "INTERVAL", -1.0)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(record):
        if record.step == 3:
            resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))

    try:
        with pytest.raises(OSError, match="too large"):
            train(checkpoint=path, callback=fill)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [found.name for found in tmp_path.iterdir()] == ["run"]
    seen = []
    resumed = train(checkpoint=path, resume=True, callback=lambda x: seen.append(x.step))
    assert seen[0] == 3
    np.testing.assert_array_equal(parameter_vector(resumed[0]), parameter_vector(train()[0]))
