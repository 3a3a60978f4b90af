"""`jotlight train --network small`."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.training import History, parameter_vector

torch = pytest.importorskip("torch")

from jotlight.torch import distributed, training  # noqa: E402
from jotlight.torch.patches import Batch  # noqa: E402

SMALL = ["--network", "small", "--batch", 2, "--steps", 3, "--device", "cpu", "--threads", 1]
NETWORK, CHECKPOINT = "net.safetensors", "net.checkpoint.safetensors"


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def assert_same(one, other):
    np.testing.assert_array_equal(
        *(parameter_vector(jl.Network.load(name)) for name in (one, other))
    )


def stop(monkeypatch, run, *words, step):
    """Press Ctrl-C at the end of a step, after the next has begun."""
    learn = training.train

    def stopped(*arguments, callback, **options):
        def interrupt(record):
            callback(record)
            if record.step == step:
                raise KeyboardInterrupt

        return learn(*arguments, callback=interrupt, **options)

    with monkeypatch.context() as patched:
        patched.setattr(training, "train", stopped)
        return run("train", "pictures", "-o", NETWORK, *SMALL, *words)


def test_a_folder_of_pictures_gives_the_network_that_python_gives(run, pictures, tmp_path):
    words = [
        "--learning-rate",
        0.002,
        "--seed",
        7,
        "-t",
        2,
        "--test",
        pictures,
        "--plot",
        "run.png",
    ]
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, *words)
    assert status == 0
    assert f"{NETWORK}: trained in 3 steps" in said
    assert "test PSNR" in said
    sensor = jl.Sensor(oversampling=4, frames=2)
    images = read_image_set(pictures)[1]
    learned, history = jl.torch.train(
        jl.Network.residual(sensor, "small", rng=7), images, sensor, steps=3, batch=2,
        learning_rate=0.002, rng=7, test=images, device="cpu", threads=1,
    )  # fmt: skip
    network = jl.Network.load(NETWORK)
    assert network.sensor == sensor
    np.testing.assert_array_equal(parameter_vector(network), parameter_vector(learned))
    assert network.history["records"] == learned.history["records"]
    assert history.steps.tolist() == [0, 1, 2, 3]
    assert np.isfinite(history.test_psnr[-1])
    assert files(tmp_path) == [NETWORK, "pictures", "run.png"]
    assert (tmp_path / "run.png").stat().st_size > 10_000
    assert run("info", NETWORK, "--plot", "later.png")[0] == 0
    assert "3 steps of Adam(learning_rate=0.002)" in run("info", NETWORK)[1]


def test_a_network_for_any_bits_is_learned_and_improved(run, pictures, tmp_path):
    words = [*SMALL, "--trials-range", "2:64", "--test", pictures, "--plot", "run.png"]
    assert run("train", pictures, "-o", NETWORK, *words)[0] == 0
    network = jl.Network.load(NETWORK)
    assert network.trials_range == (2, 64)
    assert (tmp_path / "run.png").stat().st_size > 10_000
    words = ["--start", NETWORK, *SMALL[2:], "--frames", 4]
    assert run("train", pictures, "-o", "more.safetensors", *words)[0] == 0
    more = jl.Network.load("more.safetensors")
    assert more.trials_range == (2, 64)
    assert (parameter_vector(more) != parameter_vector(network)).any()


def test_a_network_for_a_capture_is_as_bright_as_it(run):
    sensor = jl.Sensor(frames=16)
    jl.save(sensor.expose(0.3 * jl.datasets.photograph("camera")[:64, :64], rng=0), "seen.npy")
    status, said = run("train", "--sensor", "seen.npy", "-o", NETWORK, *SMALL)
    assert status == 0
    assert "trained in 3 steps" in said
    assert 0.3 < jl.Network.load(NETWORK).sensor.max_intensity < 0.9


def test_synthetic_scenes_are_smaller_than_the_usual_patch(run):
    assert run("train", "synthetic", "-o", NETWORK, *SMALL, "--steps", 1)[0] == 0
    assert jl.Network.load(NETWORK).history["run"]["patch"] == 32


@pytest.mark.parametrize("step", [1, 2])
def test_a_stopped_run_is_kept_and_resumed_as_if_it_had_not_been(
    run, pictures, tmp_path, monkeypatch, step
):
    status, said = stop(monkeypatch, run, "--test", "pictures", step=step)
    assert status == 130
    assert f"The run so far is kept in {CHECKPOINT}" in said
    assert files(tmp_path) == [CHECKPOINT, "pictures"]
    status, said = run("train", "pictures", "-o", NETWORK, *SMALL)
    assert status == 1
    assert "add --resume" in said
    words = [*SMALL, "--test", "pictures"]
    assert run("train", "pictures", "-o", NETWORK, *words, "--resume")[0] == 0
    assert run("train", "pictures", "-o", "whole.safetensors", *words)[0] == 0
    assert_same(NETWORK, "whole.safetensors")
    one, other = (jl.Network.load(name).history for name in (NETWORK, "whole.safetensors"))
    assert one == other
    assert CHECKPOINT not in files(tmp_path)


def test_a_run_without_time_for_all_its_steps_says_so(run, pictures):
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--seconds", 1e-9)
    assert status == 0
    assert "trained in 0 of 3 steps" in said or "trained in 1 of 3 steps" in said


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--learning-rate", 0], "learning_rate: expected a finite number above 0"),
        (["--device", "tpu"], "device: expected one of cpu, cuda, got 'tpu'"),
        (["--steps", 0], "steps: expected at least 1"),
        (["--patch", 25], "25; image number 0 is 24 x 24"),
        (["--trials-range", "1-256"], "trials-range: expected MIN:MAX"),
        (["--trials-range", "9:4"], "trials-range: expected MIN:MAX"),
        (["--trials-range", "1:8"], "the network is for 1 to 8 bits per pixel, got 16"),
    ],
)
def test_bad_input_gets_one_line(run, pictures, words, expected):
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, *words)
    assert status == 1
    assert expected in said
    assert len(said.splitlines()) == 1


def test_a_run_that_diverges_says_what_to_lower(run, pictures, tmp_path, monkeypatch):
    monkeypatch.setattr(Batch, "squared_errors", lambda _, module: module.filters[2].sum() / 0)
    status, said = run("train", pictures, "-o", NETWORK, *SMALL)
    assert status == 1
    advice = "lower the learning rate, now 0.003. Start again with --restart and --learning-rate"
    assert advice in said
    assert files(tmp_path) == ["pictures"]


def test_a_gpu_that_is_not_there_is_not_taken(run, pictures):
    if torch.cuda.is_available():
        pytest.skip("there is one")
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--device", "cuda")
    assert status == 1
    assert "PyTorch finds no GPU" in said


def test_another_process_of_several_tells_and_writes_nothing(run, pictures, tmp_path, monkeypatch):
    learn, seen = training.train, {}

    def learned(*arguments, checkpoint, **options):
        # The first process alone writes it, which this one does not know here.
        seen.update(options, checkpoint=checkpoint)
        return learn(*arguments, **options)

    (tmp_path / CHECKPOINT).write_bytes(b"of the first")
    monkeypatch.setattr(training, "train", learned)
    monkeypatch.setattr(distributed, "rank", lambda: 1)
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--plot", "run.png")
    assert (status, said) == (0, "")
    assert seen["checkpoint"].name == CHECKPOINT
    assert "callback" not in seen
    assert files(tmp_path) == [CHECKPOINT, "pictures"]
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--learning-rate", -1)
    assert status == 1
    assert said.startswith("error: learning_rate: expected a finite number above 0")


def test_files_keep_some_of_the_records():
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
