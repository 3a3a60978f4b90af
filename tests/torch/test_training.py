"""Training with PyTorch on images."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl

torch = pytest.importorskip("torch")
from jotlight.tensors import read_tensors  # noqa: E402
from jotlight.torch import Network, fastest_precision, fine_tune, train, trainer  # noqa: E402
from jotlight.torch.muon import MIN_CHANNELS  # noqa: E402
from jotlight.torch.trainer import flatten  # noqa: E402
from jotlight.training import ColorPatches, parameter_vector  # noqa: E402
from jotlight.training.checkpoint import CheckpointWriter  # noqa: E402
from training_runs import end_after  # noqa: E402

SENSOR = jl.Sensor(oversampling=3)
IMAGES = np.random.default_rng(0).random((5, 20, 24), np.float32)
STEPS = 6
STARTS = {
    "small": jl.Network.residual(SENSOR, "small", rng=0),
    "conditional": jl.Network.conditional("small", rng=0),
    "jots": jl.Network.initial(SENSOR, tied=False, taps=3, coefficients=12),
}


def train_small(network=STARTS["small"], images=IMAGES, sensor=None, **options):
    small = {"steps": STEPS, "batch": 4, "patch": 12, "rng": 3, "threads": 1, "device": "cpu"}
    return train(network, images, sensor, **{**small, **options})


def assert_same(result, other_result):
    (network, history), (other, other_history) = result, other_result
    assert network.history == other.history
    assert history.to_json() == other_history.to_json()
    for layer, other_layer in zip(network.layers, other.layers, strict=True):
        np.testing.assert_array_equal(layer.filters, other_layer.filters)
        np.testing.assert_array_equal(layer.coefficients, other_layer.coefficients)


def trainable_vector(network):
    """Return the trainable parameters in the order of a checkpoint."""
    parameters = Network(network).parameters()
    return flatten([parameter for parameter in parameters if parameter.requires_grad])


def smooth_scenes(rng, number):
    x = np.linspace(0, 1, 16, dtype=np.float32)
    slopes = rng.random((number, 2, 1, 1), np.float32)
    return 0.5 * (slopes[:, 0] * x[:, None] + slopes[:, 1] * x)


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
@pytest.mark.parametrize("images", [IMAGES, list(IMAGES[:2]), smooth_scenes])
def test_a_seed_determines_the_network(start, images):
    first, again = (train_small(start, images, test=list(IMAGES[:1])) for _ in range(2))
    assert_same(first, again)
    network, history = first
    assert [record.step for record in history.records] == list(range(STEPS + 1))
    assert network.history["stages"][-1]["run"]["seed"] == 3
    other, _ = train_small(start, images, rng=4)
    assert (other.layers[-1].filters != network.layers[-1].filters).any()


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
def test_only_trainable_parameters_change(start):
    network, _ = train_small(start)
    for before, after in zip(start.layers, network.layers, strict=True):
        assert (before.filters == after.filters).all() == (before.trainable == "nothing")
        if before.trainable != "all" and before.coefficients is not None:
            np.testing.assert_array_equal(before.coefficients, after.coefficients)
        assert before.metadata() == after.metadata()


@pytest.mark.parametrize("optimizer", ["muon", "adam"])
def test_training_lowers_the_cost(optimizer):
    _, history = train_small(images=smooth_scenes, steps=200, batch=8, optimizer=optimizer)
    costs = [record.loss for record in history.records]
    assert np.mean(costs[-40:]) < 0.8 * np.mean(costs[:40])


def test_muon_and_adam_differ_in_filter_banks_alone():
    trained = jl.pretrained(jl.Sensor(frames=20), "small")  # untrained ones have gradients of 0
    by_muon, by_adam = (
        train_small(trained, steps=1, optimizer=optimizer)[0] for optimizer in ("muon", "adam")
    )
    for layer, other in zip(by_muon.layers, by_adam.layers, strict=True):
        is_bank = min(layer.filters.shape[-4:-2]) >= MIN_CHANNELS
        assert np.array_equal(layer.filters, other.filters) == (not is_bank)
        if layer.coefficients is not None:
            np.testing.assert_array_equal(layer.coefficients, other.coefficients)


@pytest.mark.parametrize("step", [0, 2, STEPS - 1])
def test_a_resumed_run_equals_an_uninterrupted_one(tmp_path, step):
    def stop(record):
        if record.step == step:
            raise KeyboardInterrupt

    options = {"test": list(IMAGES[:2])}
    whole = train_small(**options)
    path = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        train_small(**options, checkpoint=path, callback=stop)
    records = []
    resumed = train_small(**options, checkpoint=path, resume=True, callback=records.append)
    assert [record.step for record in records] == list(range(step + 1, STEPS + 1))
    assert_same(whole, resumed)


def test_a_callback_ends_the_run_and_a_resumed_run_continues(tmp_path):
    options = {"test": list(IMAGES[:2]), "checkpoint": tmp_path / "run"}
    whole = train_small(test=list(IMAGES[:2]))
    ended, history = train_small(**options, callback=end_after(2))
    assert history.steps.tolist() == ended.history["stages"][-1]["records"]["step"] == [0, 1, 2, 3]
    assert history.records[:3] == whole[1].records[:3]
    scores = [jl.metrics.psnr(ended.reconstruct(SENSOR.expose(x, rng=0)), x) for x in IMAGES[:2]]
    assert history.test_psnr[-1] == pytest.approx(np.mean(scores), abs=1)
    assert_same(train_small(**options, resume=True), whole)


def test_the_first_step_writes_a_checkpoint(tmp_path):
    path, exists = tmp_path / "run", []
    train_small(checkpoint=path, callback=lambda record: exists.append(path.exists()))
    assert all(exists)


def test_without_a_seed_a_resumed_run_has_the_seed_of_its_checkpoint(tmp_path):
    options = {"rng": None, "checkpoint": tmp_path / "run"}
    whole = train_small(**options)
    assert_same(train_small(**options, resume=True), whole)


def test_the_result_is_a_moving_average_of_the_parameters(tmp_path, monkeypatch):
    monkeypatch.setattr(CheckpointWriter, "INTERVAL", -1.0)
    vectors = []
    path, start = tmp_path / "run", STARTS["conditional"]

    def read(record):
        vectors.append(read_tensors(path, "jotlight checkpoint", "1")[0]["vector"])

    network, _ = train_small(start, checkpoint=path, callback=read)
    average = trainable_vector(start)
    # The last call of `read` is for the result.
    for step, vector in enumerate(vectors[:STEPS], 1):
        weight = 9 / (step + 9)
        average += weight * (vector - average)
    np.testing.assert_allclose(trainable_vector(network), average, rtol=1e-5, atol=1e-7)


def test_products_in_bfloat16_are_almost_as_exact():
    runs = [
        train_small(images=smooth_scenes, steps=40, batch=8, precision=precision)
        for precision in ("f32", "bf16")
    ]
    (network, history), (other, other_history) = runs
    np.testing.assert_allclose(other_history.loss, history.loss, rtol=0.03)
    assert (parameter_vector(network) != parameter_vector(other)).any()
    assert other.history["stages"][-1]["run"]["precision"] == "bf16"


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
def test_the_fastest_precision_is_measured(start):
    name = fastest_precision(start, batch=2, patch=12, device="cpu", threads=1)
    assert name in ("f32", "bf16")
    train_small(start, precision=name, steps=1)


@pytest.mark.parametrize("name", ["small", "conditional"])
def test_the_trained_network_has_the_precision_of_the_start(name):
    network, _ = train_small(STARTS[name].with_precision("bf16"), steps=1)
    exact, _ = train_small(STARTS[name], steps=1)
    assert (network.precision, exact.precision) == ("bf16", "f32")
    np.testing.assert_array_equal(parameter_vector(network), parameter_vector(exact))


@pytest.mark.parametrize(
    "start", [STARTS["jots"], jl.Network.initial(SENSOR), jl.Network.conditional("two-layer")]
)
def test_bfloat16_is_refused_for_a_network_without_such_products(start):
    assert fastest_precision(start, device="cpu") == "f32"
    with pytest.raises(ValueError, match="precision: expected f32, because no layer of this netw"):
        train_small(start, precision="bf16", steps=1)


def test_a_run_stops_at_its_time_limit():
    _, history = train_small(steps=10**6, seconds=1e-9)
    assert len(history.records) == 2  # those of the start and of the result


@pytest.mark.parametrize(("seconds", "steps"), [(2.5, 1), (3.5, 2)])
def test_a_run_stops_before_the_step_that_would_exceed_its_time_limit(monkeypatch, seconds, steps):
    clock = [0.0]
    monkeypatch.setattr(trainer.time, "monotonic", lambda: clock[0])

    def take_a_second(record):
        clock[0] += 1

    _, history = train_small(steps=10**6, seconds=seconds, callback=take_a_second)
    assert len(history.records) == 1 + steps  # the first one is that of the start


def test_a_pretrained_network_is_tested_with_the_sensor_that_it_was_requested_for():
    sensor = jl.Sensor(frames=64)
    start, test = jl.pretrained(sensor, "medium"), list(IMAGES[:1])
    (_, history), (_, expected) = (
        train_small(start, sensor=each, test=test, steps=1) for each in (None, sensor)
    )
    assert history.test_psnr[0] == expected.test_psnr[0]


@pytest.mark.parametrize("start", [STARTS["small"], STARTS["conditional"]])
def test_color_patches_are_refused_for_a_gray_network(start):
    source = ColorPatches([np.full((20, 24, 3), 99, np.uint8)])
    with pytest.raises(ValueError, match=r"expected gray patches .* got shape \(3, 12, 12\)"):
        train_small(start, source)


def test_a_checkpoint_of_another_run_is_refused(tmp_path):
    train_small(checkpoint=tmp_path / "run")
    changes = {"rng": 4}, {"learning_rate": 1e-4}, {"optimizer": "adam"}
    for change in (*changes, {"network": STARTS["conditional"]}):
        with pytest.raises(ValueError, match="checkpoint"):
            train_small(**change, checkpoint=tmp_path / "run", resume=True)
    with pytest.raises(ValueError, match="resume: expected a checkpoint"):
        train_small(resume=True)


def test_dark_images_with_a_bright_spot_have_a_finite_cost():
    dark = np.full((1, 32, 32), 1e-4, np.float32)
    dark[0, 3:6, 3:6] = 1.0
    _, history = train_small(
        jl.Network.conditional("small", rng=0), dark, steps=6, batch=4, patch=32
    )
    assert np.isfinite(history.loss).all()


@pytest.mark.parametrize("start", STARTS.values(), ids=STARTS)
def test_gray_levels_are_reported_once(start):
    with pytest.warns(jl.JotlightWarning, match="images: most intensities should be") as warned:
        train_small(start, 254.7 * IMAGES, steps=1)
    assert len(warned) == 1


def test_a_light_in_a_patch_is_not_reported():
    lights = np.where(np.arange(24) < 7, np.float32(20.5), IMAGES)
    train_small(images=lights, steps=3, patch=5)


def test_divergence_is_an_error_that_says_what_to_change():
    message = r"step \d+: the run reached infinity or NaN .* lower the learning rate"
    with pytest.raises(FloatingPointError, match=message):
        train_small(STARTS["conditional"], learning_rate=1e30, steps=30)


def test_a_run_without_gradients_and_with_a_higher_cost_is_an_error():
    message = r"step \d+: the run diverges: the cost has no gradient .* lower the learning rate"
    with pytest.raises(FloatingPointError, match=message):
        train_small(learning_rate=1e3, steps=30)


def test_a_result_worse_than_the_start_is_reported():
    trained = jl.pretrained(jl.Sensor(frames=20), "small")
    with pytest.warns(jl.JotlightWarning, match="much worse than the network at the start"):
        train_small(trained, smooth_scenes, steps=3, patch=16, learning_rate=0.3)


@pytest.mark.parametrize("network", [Network(STARTS["conditional"]), "small", None])
def test_anything_but_a_network_is_refused(network):
    message = "network: expected jotlight.Network or jotlight.ColorNetwork or jotlight.FilmNetwork"
    with pytest.raises(TypeError, match=message):
        train_small(network)


def test_a_path_in_place_of_a_network_gets_the_call_that_reads_it():
    with pytest.raises(TypeError, match=r"got a path; pass jotlight\.Network\.load\('a\.safetens"):
        train_small("a.safetensors")


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
        ({"seconds": -1.0}, "seconds: expected a finite number above 0, got -1.0"),
        ({"seconds": "5"}, "seconds: expected a finite number above 0, got '5'"),
        ({"optimizer": "sgd"}, "optimizer: expected one of muon, adam, got 'sgd'"),
        ({"precision": "float16"}, "precision: expected one of f32, bf16, got 'float16'"),
        ({"rng": -1}, "rng: expected at least 0, got -1"),
        ({"threads": 0}, "threads: expected a whole number from 1 to 1024, got 0"),
        ({"patch": 21}, "patch: expected at most 20 pixels, got 21. The smallest image, number 0"),
        ({"images": -IMAGES}, "expected intensities of 0 or more"),
        ({"test": IMAGES[0]}, r"test: expected gray images \(N, H, W\)"),
        ({"sensor": jl.Sensor(oversampling=2)}, "sensor: the network"),
    ],
)
def test_settings_that_do_not_fit_are_refused(options, message):
    before = torch.get_num_threads()
    with pytest.raises(ValueError, match=message):
        train_small(**options)
    assert torch.get_num_threads() == before


@pytest.mark.parametrize("mode", [torch.no_grad, torch.inference_mode])
def test_networks_are_trained_where_no_gradients_are_recorded(mode):
    start, bits = jl.Network.conditional("small", rng=0), SENSOR.expose(np.full((24, 24), 0.4))
    with mode():
        train(start, np.full((2, 24, 24), 0.4), SENSOR, steps=1, batch=1, rng=0, device="cpu")
        fine_tune(start, bits, steps=1, batch=1, rng=0, device="cpu")


def test_networks_without_trainable_parameters_are_refused():
    start, bits = jl.Network.conditional("small", rng=0), SENSOR.expose(np.full((24, 24), 0.4))
    layers = [dataclasses.replace(layer, trainable="nothing") for layer in start.layers]
    fixed = jl.Network(layers, start.sensor, trials_range=start.trials_range)
    message = 'network: expected trainable parameters, got layers with trainable="nothing" only'
    with pytest.raises(ValueError, match=message):
        train(fixed, np.full((2, 24, 24), 0.4), SENSOR, steps=1, device="cpu")
    with pytest.raises(ValueError, match=message):
        fine_tune(fixed, bits, steps=1, device="cpu")
