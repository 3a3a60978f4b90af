"""Runs of `jotlight.train` from start to end."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.training import parameter_vector
from training_runs import (
    IMAGES,
    OPTIMIZERS,
    SENSOR,
    START,
    STEPS,
    assert_same,
    end_after,
    scenes,
    train,
)


@pytest.mark.slow
@pytest.mark.parametrize("optimizer", OPTIMIZERS.values(), ids=OPTIMIZERS)
@pytest.mark.parametrize("images", [IMAGES, list(IMAGES[:2]), scenes], ids=["stack", "list", "new"])
def test_a_seed_determines_the_network_for_any_number_of_threads(images, optimizer):
    runs = [
        train(images=images, optimizer=optimizer, test=IMAGES[:2], threads=threads)
        for threads in (1, 2, None, 1)
    ]
    for other in runs[1:]:
        assert_same(runs[0], other)
    unlike = train(images=images, optimizer=optimizer, test=IMAGES[:2], rng=4)
    assert (parameter_vector(unlike[0]) != parameter_vector(runs[0][0])).any()


def test_runs_without_a_seed_differ_and_record_the_seed():
    one, other = (train(rng=None, steps=1)[0] for _ in range(2))
    assert (parameter_vector(one) != parameter_vector(other)).any()
    again = train(rng=one.history["stages"][-1]["run"]["seed"], steps=1)[0]
    np.testing.assert_array_equal(parameter_vector(one), parameter_vector(again))


@pytest.mark.slow
def test_the_trained_network_is_for_the_requested_sensor():
    dim = SENSOR.replace(dark_counts=0.3)
    trained, history = train(sensor=dim, test=IMAGES[:4], steps=2)
    assert trained.sensor == dim
    scores = jl.evaluate(trained, IMAGES[:4].repeat(30, 0), dim)
    assert scores.mean("psnr") == pytest.approx(history.test_psnr[-1], abs=0.5)


def test_a_pretrained_network_is_trained_for_the_sensor_that_it_was_requested_for():
    sensor = jl.Sensor(frames=16, dark_counts=0.05)
    start = jl.pretrained(sensor, "two-layer")
    trained, _ = jl.train(start, [np.full((20, 20), 0.5)], steps=0, batch=1)
    assert trained.sensor == sensor


def test_a_history_has_one_record_more_than_steps():
    records = []
    trained, history = train(test=IMAGES[:2], callback=records.append)
    assert len(history) == STEPS + 1
    assert history.records == records
    assert [record.step for record in records] == list(range(STEPS + 1))
    assert np.isfinite(history.test_psnr).all()
    same, again = train(trained, steps=0, test=IMAGES[:2])
    assert again.test_psnr == pytest.approx(history.test_psnr[-1:], abs=1e-3)
    np.testing.assert_allclose(parameter_vector(same), parameter_vector(trained), atol=1e-6)


def test_a_callback_ends_the_run_and_a_resumed_run_continues(tmp_path):
    options = {"test": IMAGES[:2], "checkpoint": tmp_path / "run"}
    whole = train(test=IMAGES[:2])
    ended, history = train(**options, callback=end_after(2))
    assert history.steps.tolist() == ended.history["stages"][-1]["records"]["step"] == [0, 1, 2, 3]
    assert history.records[:3] == whole[1].records[:3]
    assert history.test_psnr[-1] == whole[1].test_psnr[3]  # both are those of the same parameters
    # The checkpoint holds the three steps. Resumed, it takes one and returns the network again.
    _, longer = train(**options, resume=True, callback=end_after(0))
    assert longer.records[:4] == whole[1].records[:4]
    assert len(longer) == 5
    assert_same(train(**options, resume=True), whole)


def test_a_trained_network_and_its_file_record_the_run(tmp_path):
    parameters, metadata = parameter_vector(START), dict(START.history)
    trained, history = train(test=IMAGES[:1])
    np.testing.assert_array_equal(parameter_vector(START), parameters)
    assert START.history == metadata
    trained.save(tmp_path / "net.safetensors")
    loaded = jl.Network.load(tmp_path / "net.safetensors")
    assert loaded.history == trained.history
    np.testing.assert_array_equal(parameter_vector(loaded), parameter_vector(trained))
    records = loaded.history["stages"][-1]["records"]
    np.testing.assert_allclose(records["loss"], history.loss, rtol=1e-6)
    np.testing.assert_allclose(records["test_psnr"], history.test_psnr, rtol=1e-6)
    assert (
        loaded.history["stages"][-1]["run"]["seed"],
        loaded.history["stages"][-1]["run"]["steps"],
    ) == (3, STEPS)


def test_a_second_training_keeps_the_first_in_the_history():
    once, _ = train()
    twice, _ = train(once, steps=2, rng=5)
    assert twice.history["start"] == START.history["start"]
    stages = twice.history["stages"]
    assert stages[0] == once.history["stages"][0]
    assert [(stage["kind"], stage["run"]["seed"]) for stage in stages] == [
        ("train", 3),
        ("train", 5),
    ]
    assert len(once.history["stages"]) == 1


@pytest.mark.slow
def test_maps_enter_by_the_median_of_valid_jots(tmp_path):
    dark = np.array([[0.1, 0.2, 0.3], [4.0, 9.0, 9.0]])
    mapped = jl.Sensor(frames=9, dark_counts=dark, mask=dark == 9)
    network = jl.Network.initial(mapped, taps=3, coefficients=12)
    result = train(network)
    trained = result[0]
    plain = train(network, sensor=jl.Sensor(frames=9, dark_counts=0.25))[0]
    np.testing.assert_array_equal(parameter_vector(trained), parameter_vector(plain))
    assert trained.sensor == mapped
    train(network, checkpoint=tmp_path / "run")
    assert_same(result, train(network, checkpoint=tmp_path / "run", resume=True))


COLOR, SMALL = np.full((16, 16, 3), 0.5), np.full((16, 6), 0.5)
SOURCE = jl.training.ImagePatches(IMAGES)
PHOTOGRAPHS = jl.training.PhotographPatches([np.ones((16, 16), np.uint8)])
NO_NUMBER = np.full((99, 16, 16), np.nan)


def test_gray_levels_are_reported():
    message = "images: most intensities should be at most max_intensity=1, but most of them exceed"
    with pytest.warns(jl.JotlightWarning, match=message):
        train(images=254.7 * IMAGES, steps=1)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"images": "folder"}, TypeError, "images: expected an array, got the path 'folder'"),
        ({"images": None}, TypeError, "a list of images, got None"),
        ({"sensor": 8}, TypeError, "sensor: expected a jotlight.Sensor, .*got 8"),
        ({"images": []}, ValueError, "images: expected at least one, got none"),
        ({"images": IMAGES[0]}, ValueError, r"for a single image, write array\[None\]"),
        ({"images": [IMAGES[0], SMALL]}, ValueError, "got 12; image number 1 is 16 x 6"),
        ({"images": (255 * IMAGES).astype(int)}, TypeError, "images: expected floats"),
        ({"images": [IMAGES[0], COLOR]}, ValueError, r"images\[1\]: expected a gray image"),
        ({"images": IMAGES[:, None]}, ValueError, r"write array\.reshape\("),
        ({"images": COLOR}, ValueError, r"write np\.moveaxis\(array, -1, 0\)$"),
        ({"images": [IMAGES[0], -IMAGES[1]]}, ValueError, r"images\[1\]: expected .* 0 or more"),
        ({"images": SOURCE}, TypeError, r"got ImagePatches; .* jotlight\.torch\.train, which"),
        ({"test": PHOTOGRAPHS}, TypeError, "test: expected an array .*got <.*PhotographPatches"),
        ({"images": scenes, "patch": 8}, ValueError, "patch: expected none .*synthetic scenes, "),
        ({"images": lambda rng, n: None}, ValueError, "got NoneType"),
        ({"images": lambda rng, n: rng.random((n, 16))}, ValueError, "an array"),
        ({"images": lambda rng, n: rng.random((n + 1, 8, 8))}, ValueError, "an array"),
        ({"optimizer": jl.training.Adam}, TypeError, "or an object with take_step"),
        ({"admissible": 1}, TypeError, r"admissible: expected .*SafeSet\(\), got 1$"),
        ({"admissible": jl.training.SafeSet}, TypeError, r"SafeSet\(\), got <class"),
        ({"optimizer": None}, TypeError, "optimizer: expected one of"),
        ({"images": lambda rng, n: rng.integers(9, size=(n, 8, 8))}, TypeError, "floats"),
        ({"images": lambda rng, n: NO_NUMBER[:n]}, ValueError, "finite intensities"),
        ({"test": IMAGES[0]}, ValueError, r"test: expected gray images \(N, H, W\)"),
        ({"test": [IMAGES[0], COLOR]}, ValueError, r"test\[1\]: expected a gray image"),
        ({"patch": 0}, ValueError, "patch: expected at least 1"),
        ({"patch": 8.5}, TypeError, "patch: expected a whole number, got 8.5"),
        ({"patch": 2}, ValueError, "no pixel of the patch would count$"),
        ({"batch": 0}, ValueError, "batch: expected at least 1"),
        ({"steps": -1}, ValueError, "steps: expected at least 0, got -1"),
        ({"seconds": 0}, ValueError, "seconds: expected a finite number above 0, got 0"),
        ({"seconds": "5"}, ValueError, "seconds: expected a finite number above 0, got '5'"),
        ({"optimizer": "sgd"}, ValueError, "gauss-newton, adam, projected-gradient, got 'sgd'"),
        ({"sensor": jl.Sensor(oversampling=2)}, ValueError, "sensor: the network needs data with"),
        ({"sensor": jl.Sensor(oversampling=3, gain=3.0)}, ValueError, "sensor: the network needs"),
        ({"resume": True}, ValueError, "resume: expected a checkpoint to resume from, got none"),
    ],
)  # fmt: skip
def test_arguments_that_do_not_fit_are_refused(options, error, message):
    with pytest.raises(error, match=message):
        train(**options)
