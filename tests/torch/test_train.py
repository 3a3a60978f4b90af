"""Learning with PyTorch."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl

torch = pytest.importorskip("torch")
from jotlight.torch import train  # noqa: E402

SENSOR = jl.Sensor(oversampling=3)
IMAGES = np.random.default_rng(0).random((5, 20, 24), np.float32)
STEPS = 6
STARTS = {
    "small": jl.Network.residual(SENSOR, "small", rng=0),
    "told": jl.Network.conditional("small", rng=0),
    "jots": jl.Network.initial(SENSOR, tied=False, taps=3, coefficients=12),
}


def learn(network=STARTS["small"], images=IMAGES, sensor=None, **options):
    small = {"steps": STEPS, "batch": 4, "patch": 12, "rng": 3, "threads": 1, "device": "cpu"}
    return train(network, images, sensor, **{**small, **options})


def assert_same(one, other):
    (network, history), (again, history_again) = one, other
    assert network.history == again.history
    assert history.to_json() == history_again.to_json()
    for layer, layer_again in zip(network.layers, again.layers, strict=True):
        np.testing.assert_array_equal(layer.filters, layer_again.filters)
        np.testing.assert_array_equal(layer.coefficients, layer_again.coefficients)


def smooth_scenes(rng, number):
    x = np.linspace(0, 1, 16, dtype=np.float32)
    slopes = rng.random((number, 2, 1, 1), np.float32)
    return 0.5 * (slopes[:, 0] * x[:, None] + slopes[:, 1] * x)


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
@pytest.mark.parametrize("images", [IMAGES, list(IMAGES[:2]), smooth_scenes])
def test_a_seed_gives_one_network(start, images):
    one, again = (learn(start, images, test=list(IMAGES[:1])) for _ in range(2))
    assert_same(one, again)
    network, history = one
    assert [record.step for record in history.records] == list(range(STEPS + 1))
    assert network.history["run"]["seed"] == 3
    other, _ = learn(start, images, rng=4)
    assert (other.layers[-1].filters != network.layers[-1].filters).any()


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
def test_only_what_may_learn_does(start):
    network, _ = learn(start)
    for before, after in zip(start.layers, network.layers, strict=True):
        assert (before.filters == after.filters).all() == (before.trainable == "nothing")
        if before.trainable != "all" and before.coefficients is not None:
            np.testing.assert_array_equal(before.coefficients, after.coefficients)
        assert before.metadata() == after.metadata()


def test_learning_lowers_the_cost():
    _, history = learn(images=smooth_scenes, steps=60, batch=8)
    costs = [record.loss for record in history.records]
    assert np.mean(costs[-10:]) < 0.8 * np.mean(costs[:10])


@pytest.mark.parametrize("step", [0, 2, STEPS - 1])
def test_a_run_that_was_stopped_goes_on_as_if_it_had_not(tmp_path, step):
    def stop(record):
        if record.step == step:
            raise KeyboardInterrupt

    options = {"test": list(IMAGES[:2])}
    whole = learn(**options)
    path = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        learn(**options, checkpoint=path, callback=stop)
    seen = []
    again = learn(
        **options, checkpoint=path, resume=True, callback=lambda record: seen.append(record.step)
    )
    assert seen == list(range(step + 1, STEPS + 1))
    assert_same(whole, again)


def test_a_run_stops_when_its_time_is_up():
    _, history = learn(steps=10**6, seconds=1e-9)
    assert len(history.records) <= 2


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    learn(checkpoint=tmp_path / "run")
    for change in ({"rng": 4}, {"learning_rate": 1e-4}, {"network": STARTS["told"]}):
        with pytest.raises(ValueError, match="checkpoint"):
            learn(**change, checkpoint=tmp_path / "run", resume=True)
    with pytest.raises(ValueError, match="resume: expected a checkpoint"):
        learn(resume=True)


def test_dark_images_with_a_bright_spot_have_a_finite_cost():
    dark = np.full((1, 32, 32), 1e-4, np.float32)
    dark[0, 3:6, 3:6] = 1.0
    _, history = learn(jl.Network.conditional("small", rng=0), dark, steps=6, batch=4, patch=32)
    assert np.isfinite(history.loss).all()


def test_a_rate_that_leads_nowhere_is_an_error():
    message = r"step \d+: the run reached infinity or NaN .* lower the learning rate"
    with pytest.raises(FloatingPointError, match=message):
        learn(STARTS["told"], learning_rate=1e30, steps=30)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"steps": 0}, "steps: expected at least 1, got 0"),
        ({"batch": 0}, "batch: expected at least 1, got 0"),
        ({"learning_rate": 0.0}, "learning_rate: expected a finite number above 0, got 0.0"),
        (
            {"learning_rate": float("nan")},
            "learning_rate: expected a finite number above 0, got nan",
        ),
        ({"seconds": -1.0}, "seconds: expected a number above 0, got -1.0"),
        ({"rng": -1}, "rng: expected at least 0, got -1"),
        ({"threads": 0}, "threads: expected at least 1, got 0"),
        ({"patch": 21}, "patch"),
        ({"images": -IMAGES}, "expected intensities of 0 or more"),
        ({"sensor": jl.Sensor(oversampling=2)}, "sensor: the network"),
    ],
)
def test_settings_that_do_not_fit_are_refused(options, message):
    before = torch.get_num_threads()
    with pytest.raises(ValueError, match=message):
        learn(**options)
    assert torch.get_num_threads() == before


SCRIPT = """
import json, sys
import numpy as np
import jotlight as jl
from jotlight.torch import train

network = jl.Network.residual(jl.Sensor(oversampling=3), "small", rng=0)
images = np.random.default_rng(0).random((5, 20, 24), np.float32)
told = []
learned, history = train(
    network, images, steps=4, batch=5, patch=12, rng=3, threads=1, device="cpu",
    test=list(images[:1]), callback=told.append, checkpoint=sys.argv[1] + "/run",
)
if told:
    learned.save(sys.argv[1] + "/learned.safetensors")
    print(json.dumps([history.to_json(), len(told)]))
"""


def test_two_processes_learn_what_one_does(tmp_path):
    (tmp_path / "learn.py").write_text(SCRIPT, "utf-8")
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
    printed = subprocess.run(
        [*launcher, "--nproc-per-node", "2", tmp_path / "learn.py", tmp_path],
        check=True,
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": str(Path(jl.__file__).parents[1])},
    ).stdout
    (first,) = printed.splitlines()
    history, told = json.loads(first)
    assert told == 5
    assert (tmp_path / "run").is_file()
    alone, history_alone = learn(steps=4, batch=5, test=list(IMAGES[:1]))
    np.testing.assert_allclose(history["loss"], history_alone.loss, rtol=1e-4)
    np.testing.assert_allclose(history["gradient_norm"], history_alone.gradient_norm, rtol=1e-3)
    together = jl.Network.load(tmp_path / "learned.safetensors")
    for one, other in zip(alone.layers, together.layers, strict=True):
        np.testing.assert_allclose(one.filters, other.filters, atol=2e-3)
