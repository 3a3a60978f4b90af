"""Fine-tuning of networks on the bits of a capture."""

import re

import numpy as np
import pytest
import safetensors.numpy

import jotlight as jl

torch = pytest.importorskip("torch")

from jotlight.sensing.data.pixel_counts import count_pixels  # noqa: E402
from jotlight.torch import fine_tune, fine_tuning  # noqa: E402
from jotlight.torch.bit_splitting import BitSplitter  # noqa: E402
from jotlight.torch.fine_tuning import generator_of_purpose  # noqa: E402
from jotlight.torch.network import Network as TorchNetwork  # noqa: E402
from jotlight.training import History  # noqa: E402
from training_runs import end_after  # noqa: E402

SCENE = np.kron([[0.1, 0.7, 0.3], [0.9, 0.2, 0.5], [0.4, 0.8, 0.1]], np.ones((16, 16)))
SENSOR = jl.Sensor(frames=8)
BITS = SENSOR.expose(SCENE, rng=0)
CONDITIONAL = jl.Network.conditional("small", rng=0)
SINGLE_K = jl.Network.residual(SENSOR, "small", rng=0)
TWO_LAYER = jl.Network.initial(SENSOR, taps=5, coefficients=20)


def tune(network=CONDITIONAL, data=BITS, sensor=None, **options):
    small = {"steps": 4, "batch": 2, "patch": 24, "rng": 3, "threads": 1, "device": "cpu"}
    return fine_tune(network, data, sensor, **{**small, **options})


def parameters(network):
    arrays = [array for x in network.layers for array in (x.filters, x.coefficients)]
    return np.concatenate([array.ravel() for array in arrays if array is not None])


@pytest.mark.parametrize(
    "network", [CONDITIONAL, SINGLE_K, TWO_LAYER], ids=["conditional", "single K", "two-layer"]
)
@pytest.mark.parametrize("learning_rate", [1e-3, 30.0])
def test_the_held_out_likelihood_is_never_below_that_of_the_start(network, learning_rate):
    tuned, history = tune(network, learning_rate=learning_rate)
    assert len(history) == 5
    assert history.held_out[-1] == history.held_out.min() <= history.held_out[0]
    # The values are those of the networks as the engine runs them.
    channels = [count_pixels(BITS, SENSOR, None)]
    splitter = BitSplitter(network, SENSOR, channels, generator_of_purpose(3, 0))
    assert splitter.held_out_negative_log_likelihood(network, 1) == history.held_out[0]
    assert splitter.held_out_negative_log_likelihood(tuned, 1) == history.held_out[-1]
    if learning_rate > 1:  # all other parameters were worse
        np.testing.assert_array_equal(parameters(tuned), parameters(network))
    assert (tuned.trials_range, tuned.sensor) == (network.trials_range, network.sensor)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("network", "gain"),
    [(CONDITIONAL, 0.5), (SINGLE_K, 0.05), (TWO_LAYER, 0.5)],
    ids=["conditional", "single K", "two-layer"],
)
def test_fine_tuning_raises_the_psnr(network, gain):
    tuned, history = tune(network, steps=100, batch=8, patch=32, learning_rate=3e-3)
    before, after = (jl.metrics.psnr(x.reconstruct(BITS), SCENE) for x in (network, tuned))
    assert after > before + gain
    assert history.held_out[-1] < history.held_out[0]
    assert tuned.reconstruct(BITS).max() <= 1


MANY = jl.Sensor(frames=300)
SHORT_RANGE = jl.Network.conditional("small", trials_range=(1, 16), rng=0)


def test_more_bits_than_the_network_knows_are_used():
    bits = MANY.expose(SCENE, rng=0)
    tuned, history = tune(SHORT_RANGE, bits, steps=8, learning_rate=3e-3)
    assert np.isfinite(parameters(tuned)).all()
    assert np.isfinite(history.loss).all()
    assert history.held_out[-1] < history.held_out[0]
    before, after = (jl.metrics.psnr(x.reconstruct(bits), SCENE) for x in (SHORT_RANGE, tuned))
    assert after > before


@pytest.mark.parametrize("learning_rate", [3e-3, 30.0])  # the start is the best with the second
def test_the_tuned_network_has_the_precision_of_the_start(learning_rate):
    start = SHORT_RANGE.with_precision("bf16")
    bits = MANY.expose(SCENE, rng=0)
    tuned, history = tune(start, bits, steps=8, learning_rate=learning_rate)
    assert (history.held_out[-1] < history.held_out[0]) == (learning_rate < 1)
    assert tuned.precision == "bf16"


def test_the_passes_of_a_step_are_those_of_the_engine():
    bits = MANY.expose(SCENE, rng=0)
    channels = [count_pixels(bits, MANY, None)]
    splitter = BitSplitter(SHORT_RANGE, MANY, channels, generator_of_purpose(3, 0))
    [split] = splitter.held_out
    assert split.input_trials == 270
    module = TorchNetwork(SHORT_RANGE)
    estimate = splitter.estimate(module.run_layers, split)
    likelihood = splitter.negative_log_likelihood(estimate, split)
    held_out = splitter.held_out_negative_log_likelihood(SHORT_RANGE, 1)
    assert likelihood.item() == pytest.approx(held_out, abs=1e-5)
    likelihood.backward()
    gradients = [each.grad for each in module.parameters() if each.requires_grad]
    assert all(torch.isfinite(gradient).all() for gradient in gradients)


@pytest.mark.parametrize("level", [0.0, 5.0])
def test_derivatives_are_finite_where_all_bits_are_equal(level):
    bits = MANY.expose(np.full((24, 24), level), rng=0)
    tuned, _ = tune(SHORT_RANGE, bits)
    assert np.isfinite(parameters(tuned)).all()


def test_a_seed_determines_the_network():
    first, again, other = (tune(rng=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(parameters(first[0]), parameters(again[0]))
    assert first[1].to_json() == again[1].to_json()
    assert first[0].history == again[0].history
    assert first[1].loss[0] != other[1].loss[0]
    unseeded = tune(rng=None)[0]
    seeded = tune(rng=unseeded.history["stages"][-1]["run"]["seed"])[0]
    np.testing.assert_array_equal(parameters(unseeded), parameters(seeded))


def test_bits_and_their_counts_give_the_same_network():
    jots = jl.Sensor(oversampling=2, frames=2)
    bits = jots.expose(SCENE, rng=0)
    from_bits, from_counts = tune(data=bits)[0], tune(data=bits.counts(), sensor=jots)[0]
    np.testing.assert_array_equal(parameters(from_bits), parameters(from_counts))


def test_the_file_of_a_network_holds_the_history_of_its_fine_tuning(tmp_path):
    tuned, history = tune()
    tuned.save(tmp_path / "own.safetensors")
    metadata = jl.Network.load(tmp_path / "own.safetensors").history["stages"][-1]
    assert History.from_json(metadata["records"]).records == history.records
    assert metadata["run"]["seed"] == 3


def interrupt(path, step, **options):
    """Start a run, and press Ctrl-C at the end of a step."""

    def stop(record):
        if record.step == step:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tune(checkpoint=path, callback=stop, **options)


@pytest.mark.parametrize("step", [0, 2, 5, 6])
@pytest.mark.parametrize("learning_rate", [1e-3, 30.0])
def test_a_resumed_run_equals_an_uninterrupted_one(tmp_path, step, learning_rate):
    """With the high learning rate, the best parameters come before the interrupt."""
    options = {"steps": 6, "learning_rate": learning_rate}
    whole, history = tune(**options)
    assert learning_rate < 1 or history.held_out[:-1].argmin() == 0
    path = tmp_path / "run"
    interrupt(path, step, **options)
    records = []
    resumed, resumed_history = tune(
        **options, checkpoint=path, resume=True, callback=records.append
    )
    assert [record.step for record in records] == list(range(min(step + 1, 6), 7))
    assert resumed_history.records == history.records
    assert resumed.history == whole.history
    np.testing.assert_array_equal(parameters(resumed), parameters(whole))


def test_a_callback_ends_the_run_and_a_resumed_run_continues(tmp_path):
    whole, path = tune(), tmp_path / "run"
    ended, history = tune(checkpoint=path, callback=end_after(1))
    assert history.steps.tolist() == [0, 1, 2]
    assert ended.history["stages"][-1]["records"]["step"] == [0, 1, 2]
    assert history.records[:2] == whole[1].records[:2]
    assert history.held_out[-1] == np.nanmin(history.held_out)
    resumed, records = tune(checkpoint=path, resume=True)
    assert records.to_json() == whole[1].to_json()
    np.testing.assert_array_equal(parameters(resumed), parameters(whole[0]))


def test_without_a_seed_a_resumed_run_has_the_seed_of_its_checkpoint(tmp_path):
    options = {"rng": None, "checkpoint": tmp_path / "run", "steps": 2}
    whole, _ = tune(**options)
    resumed, _ = tune(**options, resume=True)
    assert resumed.history == whole.history


def test_a_checkpoint_of_another_run_and_a_file_that_is_none_are_refused(tmp_path):
    path = tmp_path / "run"
    interrupt(path, 1)
    other = SENSOR.expose(SCENE, rng=1)
    mapped = SENSOR.replace(dark_counts=np.full(SCENE.shape, 1e-3))
    for change, message in (
        ({"data": other}, "different capture"),
        ({"sensor": mapped}, "different capture"),
        ({"network": jl.Network.conditional("small", rng=1)}, "different network"),
        ({"rng": 4}, "seed is 3 in the file and 4 in this run"),
        ({"learning_rate": 1e-4}, "Adam"),
    ):
        with pytest.raises(ValueError, match=message):
            tune(**change, checkpoint=path, resume=True)
    network = tmp_path / "network.safetensors"
    CONDITIONAL.save(network)
    with pytest.raises(ValueError, match="this file is no checkpoint"):
        tune(checkpoint=network)
    with pytest.raises(ValueError, match="resume: expected a checkpoint"):
        tune(resume=True)
    with pytest.raises(FileNotFoundError, match="no checkpoint"):
        tune(resume=True, checkpoint=tmp_path / "none")


@pytest.mark.parametrize("part", ["state.best", "state.exp_avg"])
def test_an_incomplete_checkpoint_is_refused(tmp_path, part):
    path = tmp_path / "run"
    interrupt(path, 1)
    with safetensors.safe_open(path, framework="np") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys() if name != part}  # noqa: SIM118
        safetensors.numpy.save_file(tensors, path, file.metadata())
    with pytest.raises(ValueError, match=f"damaged checkpoint: it has no {part}"):
        tune(checkpoint=path, resume=True)


def test_color_maps_dead_jots_and_two_trials_can_be_tuned():
    color = SENSOR.expose(np.stack([SCENE, 0.5 * SCENE]), rng=0, channel_axis=0)
    assert tune(data=color)[0].reconstruct(color).shape == (*SCENE.shape, 2)
    few = SENSOR.replace(frames=2)
    assert np.isfinite(tune(data=few.expose(SCENE, rng=0))[1].loss).all()
    mask = np.zeros(SCENE.shape, bool)
    mask[:30] = True  # some patches have dead pixels alone
    mask[45, 45] = True
    mapped = SENSOR.replace(mask=mask, dark_counts=np.full(SCENE.shape, 0.1))
    with pytest.warns(jl.JotlightWarning, match="no valid bit"):
        tuned = tune(data=mapped.expose(SCENE, rng=0), steps=8)
    assert np.isfinite(tuned[1].loss).all()


def test_one_frame_suffices():
    row, column = np.mgrid[:96, :96]
    scene = 0.5 + 0.45 * np.sin(2 * np.pi * column / 6) * np.sin(2 * np.pi * row / 9)
    bits = jl.Sensor().expose(scene, rng=0)
    start = jl.Network.conditional("small", rng=0)
    tuned, history = fine_tune(start, bits, steps=120, learning_rate=3e-3, rng=0, threads=1)
    assert history.held_out[-1] < history.held_out[0] - 0.01
    before, after = (jl.metrics.psnr(each.reconstruct(bits), scene) for each in (start, tuned))
    assert after > before + 1


def test_the_callback_gets_each_record():
    records = []
    history = tune(callback=records.append)[1]
    assert records == history.records
    assert [record.step for record in records] == [0, 1, 2, 3, 4]


def test_the_default_sensor_is_that_of_reconstruct():
    start = jl.pretrained(SENSOR, "small")
    plain = jl.Bits.from_array(BITS.to_array())
    expected = parameters(tune(start, BITS.counts(), SENSOR)[0])
    for data in (BITS.counts(), plain):
        np.testing.assert_array_equal(parameters(tune(start, data)[0]), expected)
        with pytest.raises(TypeError, match=r"sensor: expected a jotlight\.Sensor, because"):
            tune(CONDITIONAL, data)


@pytest.mark.parametrize(
    ("network", "received"),
    [
        (TorchNetwork(CONDITIONAL), r"a module of jotlight.torch; pass module.to_network\(\)"),
        ("small", "'small'"),
        (jl.ColorNetwork.initial("small", rng=0), "ColorNetwork"),
        (None, "NoneType"),
    ],
    ids=["module", "name", "colors", "none"],
)
def test_anything_but_a_network_is_refused(network, received):
    message = r"network: expected jotlight.Network, as in jotlight.torch.fine_tune\(.*got "
    with pytest.raises(TypeError, match=message + received):
        tune(network)


def test_the_advice_about_pixels_without_data_can_be_followed():
    x = np.where(SCENE > 0.8, np.nan, BITS.counts())
    with pytest.raises(TypeError, match="got float64 with NaN; if these pixels x have") as error:
        tune(data=x, sensor=SENSOR)
    advice = re.fullmatch(r".*pass (.*) and (sensor\..*)", str(error.value))
    data, sensor = (eval(part, {"np": np, "x": x, "sensor": SENSOR}) for part in advice.groups())
    np.testing.assert_array_equal(sensor.mask, np.isnan(x))
    with pytest.warns(jl.JotlightWarning, match="no valid bit"):
        assert np.isfinite(tune(data=data, sensor=sensor)[1].loss).all()
    with pytest.raises(TypeError, match=r"sensor.replace\(mask=a map \(H, W\) of them\)"):
        tune(data=x[None], sensor=SENSOR)


UNTIED = jl.Network.initial(jl.Sensor(oversampling=2), tied=False)
CUBIC = jl.Sensor(frames=8, kernel="cubic")
MASKED = jl.Sensor(mask=np.ones(SCENE.shape, bool))
UNEVEN = jl.Sensor(oversampling=2, frames=2, efficiency=np.linspace(0.5, 1, 9216).reshape(96, 96))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"data": MASKED.expose(SCENE, rng=0)}, "at least one pixel with a valid bit, got none"),
        ({"network": UNTIED, "data": UNTIED.sensor.expose(SCENE, rng=0)}, "tied"),
        (
            {"network": jl.Network.initial(CUBIC), "data": CUBIC.expose(SCENE, rng=0)},
            "box kernel, got cubic",
        ),
        ({"data": UNEVEN.expose(SCENE, rng=0)}, "inside each pixel"),
        ({"network": SINGLE_K, "data": BITS[:4]}, "own trials per pixel"),
        ({"data": BITS.counts() + 9, "sensor": SENSOR}, "0 to K = 8"),
        ({"steps": 0}, "steps"),
        ({"batch": 0}, "batch"),
        ({"patch": 0}, "1 to the 48 pixels"),
        ({"patch": 49}, "1 to the 48 pixels"),
        ({"learning_rate": 0}, "learning_rate"),
        ({"learning_rate": float("nan")}, "learning_rate"),
        ({"rng": -1}, "rng"),
        ({"threads": 0}, "threads"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(options, message):
    threads = torch.get_num_threads()
    with pytest.raises(ValueError, match=message):
        tune(**options)
    assert torch.get_num_threads() == threads


def test_the_help_page_states_the_defaults(run):
    text = " ".join(run("fine-tune", "--help")[1].replace("│", " ").split())
    defaults = fine_tuning.STEPS, fine_tuning.LEARNING_RATE, fine_tuning.BATCH, fine_tuning.PATCH
    for default in defaults:
        assert re.search(rf"Default: {default:g}[.,] ", text), default
