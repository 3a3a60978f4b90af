import json
import time

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

import jotlight as jl
from jotlight.training import Adam, GaussNewton, ProjectedGradient, SafeSet, parameter_vector
from jotlight.training.checkpoint import CheckpointWriter

SENSOR = jl.Sensor(oversampling=3)
START = jl.Network.initial(SENSOR, taps=3, coefficients=12)
IMAGES = np.random.default_rng(0).random((5, 20, 24), np.float32)
OPTIMIZERS = {"gauss-newton": GaussNewton(), "adam": Adam(), "gradient": ProjectedGradient(1e-3)}
STEPS = 6


def scenes(rng, number):
    return rng.random((number, 16, 16), np.float32)


def train(network=START, images=IMAGES, sensor=None, **options):
    small = {"steps": STEPS, "batch": 7, "rng": 3}
    if not callable(images):
        small["patch"] = 12
    return jl.train(network, images, sensor, **{**small, **options})


def assert_same(one, other):
    (network, history), (again, history_again) = one, other
    np.testing.assert_array_equal(parameter_vector(network), parameter_vector(again))
    assert network.history == again.history
    assert history.to_json() == history_again.to_json()


@pytest.mark.parametrize("optimizer", OPTIMIZERS.values(), ids=OPTIMIZERS)
@pytest.mark.parametrize("images", [IMAGES, list(IMAGES[:2]), scenes], ids=["stack", "list", "new"])
def test_a_seed_gives_one_network_for_any_number_of_threads(images, optimizer):
    runs = [
        train(images=images, optimizer=optimizer, test=IMAGES[:2], threads=threads)
        for threads in (1, 2, None, 1)
    ]
    for other in runs[1:]:
        assert_same(runs[0], other)
    unlike = train(images=images, optimizer=optimizer, test=IMAGES[:2], rng=4)
    assert (parameter_vector(unlike[0]) != parameter_vector(runs[0][0])).any()


def test_without_a_seed_runs_differ_and_tell_theirs():
    one, other = (train(rng=None, steps=1)[0] for _ in range(2))
    assert (parameter_vector(one) != parameter_vector(other)).any()
    again = train(rng=one.history["run"]["seed"], steps=1)[0]
    np.testing.assert_array_equal(parameter_vector(one), parameter_vector(again))


def stopping(step):
    def callback(record):
        if record.step == step:
            raise KeyboardInterrupt

    return callback


@pytest.mark.parametrize("step", [0, 2, STEPS - 1, STEPS])
@pytest.mark.parametrize("optimizer", OPTIMIZERS.values(), ids=OPTIMIZERS)
def test_a_run_that_was_stopped_goes_on_as_if_it_had_not(tmp_path, optimizer, step):
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
def test_a_run_ends_before_the_step_for_which_there_is_no_time(tmp_path, monkeypatch, optimizer):
    """By a clock that goes on by a second each time it is looked at."""
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
    # One step is taken in any case, and enough time changes nothing.
    assert len(train(optimizer=optimizer, seconds=1e-9)[1]) == 2
    assert_same(train(optimizer=optimizer, seconds=1e9), train(optimizer=optimizer))


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_a_run_stopped_within_a_step_takes_that_step_anew(tmp_path, monkeypatch, error):
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


def test_a_resumed_run_has_the_history_of_one_that_was_not_stopped_to_the_last_bit(tmp_path):
    path = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(checkpoint=path, callback=stopping(2))
    assert train(checkpoint=path, resume=True)[1].records == train()[1].records


def test_a_finished_run_is_resumed_at_its_end(tmp_path):
    path = tmp_path / "run"
    whole = train(checkpoint=path)
    before = load_file(path)
    assert_same(whole, train(checkpoint=path, resume=True))
    np.testing.assert_equal(load_file(path), before)


def test_checkpoints_are_kept_now_and_then(tmp_path, monkeypatch):
    path, found = tmp_path / "run", []
    monkeypatch.setattr(CheckpointWriter, "INTERVAL", -1.0)

    def look(_):
        if path.exists():
            found.append(load_file(path)["vector"])

    train(checkpoint=path, callback=look)
    # After each step, seen from the next one on.
    assert len(np.unique(found, axis=0)) == STEPS
    monkeypatch.setattr(CheckpointWriter, "INTERVAL", 1e9)
    found.clear()
    path.unlink()
    train(checkpoint=path, callback=look)
    # After the first, and at the end.
    assert len(np.unique(found, axis=0)) == 2


def test_a_file_that_is_no_checkpoint_is_not_overwritten(tmp_path):
    path = tmp_path / "model.safetensors"
    START.save(path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="no checkpoint, so it is not overwritten"):
        train(checkpoint=path)
    assert path.read_bytes() == before


def test_what_is_learned_is_for_the_sensor_that_was_given():
    dim = SENSOR.replace(dark_counts=0.3)
    learned, history = train(sensor=dim, test=IMAGES[:4], steps=2)
    assert learned.sensor == dim
    scores = jl.evaluate(learned, IMAGES[:4].repeat(30, 0), dim)
    assert scores.mean("psnr") == pytest.approx(history.test_psnr[-1], abs=0.5)


def test_parameters_outside_of_the_set_are_a_damaged_checkpoint(tmp_path):
    path = tmp_path / "run"
    train(checkpoint=path)
    with safe_open(path, "numpy") as file:
        metadata = file.metadata()
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    tensors["vector"] += 100
    save_file(tensors, path, metadata)
    with pytest.raises(ValueError, match="damaged checkpoint: its parameters are not in the set"):
        train(checkpoint=path, resume=True)


def test_history_has_a_record_more_than_steps():
    records = []
    learned, history = train(test=IMAGES[:2], callback=records.append)
    assert len(history) == STEPS + 1
    assert history.records == records
    assert [record.step for record in records] == list(range(STEPS + 1))
    assert np.isfinite(history.test_psnr).all()
    same, again = train(learned, steps=0, test=IMAGES[:2])
    assert again.test_psnr == pytest.approx(history.test_psnr[-1:], abs=1e-3)
    np.testing.assert_allclose(parameter_vector(same), parameter_vector(learned), atol=1e-6)


def test_a_learned_network_tells_how_it_was_learned(tmp_path):
    before, told = parameter_vector(START), dict(START.history)
    learned, history = train(test=IMAGES[:1])
    np.testing.assert_array_equal(parameter_vector(START), before)
    assert START.history == told
    learned.save(tmp_path / "net")
    loaded = jl.Network.load(tmp_path / "net")
    assert loaded.history == learned.history
    np.testing.assert_array_equal(parameter_vector(loaded), parameter_vector(learned))
    records = loaded.history["records"]
    np.testing.assert_allclose(records["loss"], history.loss, rtol=1e-6)
    np.testing.assert_allclose(records["test_psnr"], history.test_psnr, rtol=1e-6)
    assert (loaded.history["run"]["seed"], loaded.history["run"]["steps"]) == (3, STEPS)


def test_maps_of_the_sensor_enter_by_the_median_of_live_jots(tmp_path):
    dark = np.array([[0.1, 0.2, 0.3], [4.0, 9.0, 9.0]])
    mapped = jl.Sensor(frames=9, dark_counts=dark, mask=dark == 9)
    network = jl.Network.initial(mapped, taps=3, coefficients=12)
    learned = train(network)[0]
    plain = train(network, sensor=jl.Sensor(frames=9, dark_counts=0.25))[0]
    np.testing.assert_array_equal(parameter_vector(learned), parameter_vector(plain))
    assert learned.sensor == mapped
    train(network, checkpoint=tmp_path / "run")
    assert_same(train(network), train(network, checkpoint=tmp_path / "run", resume=True))


COLOUR, SMALL = np.full((16, 16, 3), 0.5), np.full((16, 6), 0.5)
NO_NUMBER = np.full((99, 16, 16), np.nan)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"images": []}, ValueError, "images: expected at least one, got none"),
        ({"images": IMAGES[0]}, ValueError, "put a single image in a list"),
        ({"images": [IMAGES[0], SMALL]}, ValueError, "got 12; image number 1 is 16 x 6"),
        ({"images": (255 * IMAGES).astype(int)}, TypeError, "image: expected floats"),
        ({"images": [IMAGES[0], COLOUR]}, ValueError, "gray images .* for number 1"),
        ({"images": scenes, "patch": 8}, ValueError, "patch: is for images"),
        ({"images": lambda rng, n: None}, ValueError, "got NoneType"),
        ({"images": lambda rng, n: rng.random((n, 16))}, ValueError, "an array"),
        ({"images": lambda rng, n: rng.random((n + 1, 8, 8))}, ValueError, "an array"),
        ({"optimizer": jl.training.Adam}, TypeError, "or an object with take_step"),
        ({"optimizer": None}, TypeError, "optimizer: expected one of"),
        ({"images": lambda rng, n: rng.integers(9, size=(n, 8, 8))}, TypeError, "floats"),
        ({"images": lambda rng, n: NO_NUMBER[:n]}, ValueError, "finite intensities"),
        ({"patch": 0}, ValueError, "patch: expected at least 1"),
        ({"patch": 2}, ValueError, "patch"),
        ({"batch": 0}, ValueError, "batch: expected at least 1"),
        ({"steps": -1}, ValueError, "steps: expected at least 0, got -1"),
        ({"optimizer": "sgd"}, ValueError, "gauss-newton, adam, projected-gradient, got 'sgd'"),
        ({"sensor": jl.Sensor(oversampling=2)}, ValueError, "sensor: the network needs data with"),
        ({"sensor": jl.Sensor(oversampling=3, gain=3.0)}, ValueError, "sensor: the network needs"),
        ({"resume": True}, ValueError, "resume: expected a checkpoint to resume from, got none"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(options, error, message):
    with pytest.raises(error, match=message):
        train(**options)


def test_a_checkpoint_that_is_not_there_is_an_error(tmp_path):
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
        ({"rng": 4}, "seed is 3 there and 4 here"),
        ({"patch": 13}, "patch is 12 there and 13 here"),
        ({"batch": 8}, "batch is 7 there and 8 here"),
        ({"images": IMAGES[::-1]}, "different images"),
        ({"test": IMAGES[:1]}, "different test"),
        ({"optimizer": "adam"}, r"optimizer is 'GaussNewton\(.*' there and 'Adam\("),
        ({"admissible": SafeSet(0.1)}, r"admissible is 'SafeSet\(nu=0.5, monotone=True\)' there"),
        ({"sensor": SENSOR.replace(dark_counts=0.1)}, "sensor is"),
        ({"network": OTHER}, "different network"),
        ({"network": WIDER}, "different network"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused_and_kept(tmp_path, changes, name):
    path = tmp_path / "run"
    train(checkpoint=path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match=f"this checkpoint is of another run: .*{name}"):
        train(**changes, checkpoint=path, resume=True)
    assert path.read_bytes() == before


def rewritten(name, change):
    """A damage that changes something of the metadata, or a tensor, of a checkpoint."""

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
    path = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train(checkpoint=path, callback=stopping(1))
    damage(path)
    with pytest.raises(ValueError, match=r"run: (damaged checkpoint|expected )"):
        train(checkpoint=path, resume=True)


def test_a_disk_that_fills_up_leaves_the_last_good_checkpoint(tmp_path, monkeypatch):
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
