"""`jotlight train` in the engine: images, options, and messages."""

import subprocess
import sys

import numpy as np
import pytest

import jotlight as jl
from folders import file_names
from jotlight.images.sets import read_image_set
from jotlight.training import Adam, parameter_vector
from terminals import on_a_terminal

SMALL = ["--patch", 24, "--batch", 4, "--steps", 3, "--optimizer", "adam"]
NETWORK = "net.safetensors"


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_same(first, second):
    np.testing.assert_array_equal(parameter_vector(first), parameter_vector(second))


def test_a_folder_of_images_trains_the_same_network_as_python(run, photo_folder, tmp_path):
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--seed", 7, "-t", 2)
    assert status == 0
    assert f"{NETWORK}: a two-layer network for 32 bits per pixel, trained in 3 steps" in output
    assert "--quality medium trains a better network, with PyTorch." in output
    assert "The trained network large serves this sensor, too" in output
    sensor = jl.Sensor(oversampling=4, frames=2)
    trained, history = jl.train(
        jl.Network.initial(sensor), read_image_set(photo_folder)[1],
        optimizer="adam", steps=3, batch=4, patch=24, rng=7,
    )  # fmt: skip
    network = jl.Network.load(NETWORK)
    assert network.sensor == sensor
    assert_same(network, trained)
    assert network.history["stages"][-1]["run"] == trained.history["stages"][-1]["run"]
    assert f"cost {history.loss[0]:.4g} to {history.loss[-1]:.4g}" in output
    assert file_names(tmp_path) == [NETWORK, "photos"]


@pytest.mark.slow
def test_the_default_optimizer_is_gauss_newton(run, photo_folder):
    assert run("train", photo_folder, "-o", NETWORK, "--batch", 4, "--steps", 1)[0] == 0
    assert "GaussNewton" in jl.Network.load(NETWORK).history["stages"][-1]["run"]["optimizer"]


def test_the_other_commands_accept_the_network(run, photo_folder):
    assert run("train", photo_folder, "-o", NETWORK, *SMALL, "-k", 3, "-t", 2)[0] == 0
    status, output = run("info", NETWORK)
    assert status == 0
    for text in ("network", "oversampling=3, frames=2", "Adam", "photos"):
        assert text in output
    status, output = run("evaluate", photo_folder, "--model", NETWORK)
    assert status == 0
    assert "3 images, Sensor(oversampling=3, frames=2)" in output
    assert run("simulate", photo_folder / "0.png", "-o", "bits.npy", "-k", 3, "-t", 2)[0] == 0
    status, output = run("reconstruct", "bits.npy", "-o", "out.npy", "--model", NETWORK)
    assert status == 0
    bits = jl.open("bits.npy")
    assert (np.load("out.npy") == jl.Network.load(NETWORK).reconstruct(bits)).all()


def test_a_network_trained_on_synthetic_scenes_is_tested_on_them(run):
    arguments = ["--batch", 4, "--steps", 2, "--optimizer", "adam"]
    status, output = run("train", "synthetic", "-o", NETWORK, *arguments)
    assert status == 0
    assert "test PSNR" in output
    stage = jl.Network.load(NETWORK).history["stages"][-1]
    assert stage["run"]["images"] == "uniform_scenes"
    assert np.isfinite(stage["records"]["test_psnr"]).all()


def test_a_network_trained_on_synthetic_scenes_is_tested_on_the_test_images(run, photo_folder):
    arguments = ["--batch", 4, "--steps", 1, "--optimizer", "adam", "--test", photo_folder]
    arguments += ["--white", 255]
    assert run("train", "synthetic", "-o", NETWORK, *arguments)[0] == 0
    assert (
        run("train", photo_folder, "-o", "same.safetensors", *SMALL, "--test", photo_folder)[0] == 0
    )
    first = [
        jl.Network.load(name).history["stages"][-1]["records"]["test_psnr"][0]
        for name in (NETWORK, "same.safetensors")
    ]
    assert first[0] == first[1]


def test_a_folder_named_synthetic_is_read_as_a_folder(run, photo_folder, tmp_path):
    photo_folder.rename(tmp_path / "synthetic")
    assert run("train", "synthetic", "-o", NETWORK, *SMALL)[0] == 0
    assert jl.Network.load(NETWORK).history["stages"][-1]["run"]["images"] != "uniform_scenes"


def test_an_array_of_an_archive_is_selected_by_its_key(run, photo_folder):
    images = np.stack(read_image_set(photo_folder)[1])
    np.savez("sets.npz", dim=images * np.float32(0.1), all=images)
    assert run("train", "sets.npz", "--key", "all", "-o", NETWORK, *SMALL)[0] == 0
    assert run("train", photo_folder, "-o", "same.safetensors", *SMALL)[0] == 0
    assert_same(jl.Network.load(NETWORK), jl.Network.load("same.safetensors"))
    assert run("train", "sets.npz", "--key", "dim", "-o", "other.safetensors", *SMALL)[0] == 0
    networks = [jl.Network.load(name) for name in (NETWORK, "other.safetensors")]
    assert (parameter_vector(networks[0]) != parameter_vector(networks[1])).any()
    status, output = run("train", "sets.npz", "-o", "none.safetensors", *SMALL)
    assert status == 1
    assert "--key" in output
    assert "dim, all" in output


def test_white_scales_the_test_images_too(run, photo_folder):
    images = np.stack(read_image_set(photo_folder)[1])
    np.save("deep.npy", np.rint(images * 4095).astype(np.uint16))
    arguments = ["train", "deep.npy", "-o", NETWORK, *SMALL, "--test", "deep.npy"]
    status, output = run(*arguments)
    assert status == 1
    assert "state the level of intensity 1 with --white" in output
    assert run(*arguments, "--white", 4095)[0] == 0
    assert jl.Network.load(NETWORK).history["stages"][-1]["records"]["test_psnr"][0] > 15


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_plot_draws_a_figure(run, photo_folder, tmp_path, ending):
    arguments = ["train", photo_folder, "-o", NETWORK, *SMALL, "--plot", f"figure.{ending}"]
    status, output = run(*arguments)
    assert status == 0
    assert f"Figure: figure.{ending}" in output
    assert (tmp_path / f"figure.{ending}").stat().st_size > 5000


def test_every_option_reaches_the_run(run, photo_folder, monkeypatch):
    received = {}

    def stop_training(network, images, sensor, **options):
        received.update(options, network=network, sensor=sensor)
        raise ValueError("stop here")

    monkeypatch.setattr(jl.training, "train", stop_training)
    options = ["-k", 2, "-t", 3, "--gain", 6, "-q", 2, "--kernel", "cubic", "--sigma", 1.5]
    options += ["--dark-counts", 0.1, "--efficiency", 0.5, "--max-intensity", 2, "--untied"]
    options += ["--learning-rate", 0.125, "--threads", 1, "--seed", 9]
    assert run("train", photo_folder, "-o", NETWORK, *SMALL, *options)[0] == 1
    assert received["sensor"] == jl.Sensor(
        oversampling=2, frames=3, gain=6, threshold=2, kernel="cubic", dark_counts=0.1,
        efficiency=0.5, max_intensity=2,
    )  # fmt: skip
    assert_same(received["network"], jl.Network.initial(received["sensor"], sigma=1.5, tied=False))
    assert received["optimizer"] == Adam(learning_rate=0.125)
    names = ("steps", "batch", "patch", "rng", "threads", "resume")
    assert [received[name] for name in names] == [3, 4, 24, 9, 1, False]


def test_training_starts_from_the_start_network(run, photo_folder):
    assert run("train", photo_folder, "-o", "start.safetensors", *SMALL)[0] == 0
    arguments = ["--start", "start.safetensors", "--steps", 0]
    assert run("train", photo_folder, "-o", NETWORK, *SMALL, *arguments)[0] == 0
    np.testing.assert_allclose(
        parameter_vector(jl.Network.load(NETWORK)),
        parameter_vector(jl.Network.load("start.safetensors")),
        atol=1e-5,
    )


def test_without_a_terminal_each_tenth_of_the_run_prints_a_line(run, photo_folder):
    status, output = run("train", photo_folder, "-o", NETWORK, *SMALL, "--steps", 20)
    assert status == 0
    lines = [line for line in output.splitlines() if line.startswith("step ")]
    assert [line.split()[1] for line in lines] == [f"{step}/20" for step in range(0, 21, 2)]
    assert all("cost " in line for line in lines)


@pytest.mark.slow
def test_progress_goes_to_stderr_and_the_result_to_stdout(photo_folder, tmp_path):
    arguments = ["train", "photos", "-o", NETWORK, *map(str, SMALL)]
    done = subprocess.run(
        [sys.executable, "-m", "jotlight", *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0
    assert "step 3/3" in done.stderr
    assert "trained in 3 steps" in done.stdout
    assert "step 3/3" not in done.stdout


@pytest.mark.slow
def test_on_a_terminal_a_live_line_shows_the_run(photo_folder, tmp_path):
    arguments = ["train", "photos", "-o", NETWORK, *SMALL, "--test", "photos"]
    with on_a_terminal(tmp_path, *arguments) as (child, texts):
        *_, shown = texts
        assert child.wait() == 0
    for text in ("step 3/3", "cost ", "gradient ", "test ", "%", "\x1b["):
        assert text in shown


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["empty", "-o", NETWORK], "empty: expected images"),
        (["nothing", "-o", NETWORK], "there is no folder or file nothing"),
        (["photos", "-o", NETWORK, "--patch", 25], "25; image number 0 is 24 x 24"),
        (["photos", "-o", "net.onnx"], "ends in .safetensors"),
        (["photos", "-o", "nowhere/net.safetensors"], "there is no folder nowhere"),
        (["photos", "-o", NETWORK, "--optimizer", "sgd"], "one of gauss-newton, adam"),
        (
            ["photos", "-o", NETWORK, "--optimizer", "gauss-newton", "--learning-rate", 0.1],
            "learning-rate: is for adam and projected-gradient",
        ),
        (
            ["photos", "-o", NETWORK, "--learning-rate", 0],
            "learning_rate: expected a finite number above 0",
        ),
        (["photos", "-o", NETWORK, "--steps", -1], "steps: expected at least 0"),
        (["photos", "-o", NETWORK, "--batch", 0], "batch: expected at least 1"),
        (["photos", "-o", NETWORK, "--sigma", 0], "sigma: expected a finite number above 0"),
        (["photos", "-o", NETWORK, "--plot", "run.gif"], "ends in .png"),
        (["photos", "-o", NETWORK, "--plot", "nowhere/run.png"], "there is no folder nowhere"),
        (["photos", "-o", NETWORK, "--plot", "photos/0.png"], "this file is read"),
        (["photos", "-o", NETWORK, "--test", "nothing"], "there is no folder or file nothing"),
        (["photos", "-o", NETWORK, "--key", "a"], "key: names an array in a .npz"),
        (
            ["photos", "-o", NETWORK, "--start", "other.safetensors", "-k", 4],
            "got Sensor(oversampling=4)",
        ),
        (["photos", "-o", NETWORK, "--start", "cut.safetensors"], "cut.safetensors: expected"),
        (["photos", "-o", NETWORK, "--start", "none.safetensors"], "none.safetensors"),
        (["photos", "-o", "other.safetensors", "--start", "other.safetensors"], "this file is"),
        (
            ["photos", "-o", NETWORK, "--start", "other.safetensors", "--untied"],
            "start: this network has",
        ),
        (["photos", "-o", NETWORK, "--resume"], "there is no stopped run to resume"),
        (["photos", "-o", NETWORK, "--resume", "--restart"], "expected one of them"),
        (["photos", "-o", NETWORK, "-k", 0], "oversampling: expected"),
        (["bad", "-o", NETWORK], "bad/b.png"),
        (["synthetic", "-o", NETWORK], "expected none for a callable, such as that of synthetic"),
        (["synthetic", "-o", NETWORK, "--white", 3], "white: is a level of images in files"),
    ],
)
def test_bad_input_gets_one_line_before_any_work_and_leaves_no_files(
    run, photo_folder, tmp_path, arguments, expected
):
    jl.Network.initial(jl.Sensor(oversampling=3)).save("other.safetensors")
    whole = (tmp_path / "other.safetensors").read_bytes()
    (tmp_path / "cut.safetensors").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "b.png").write_text("not an image")
    before = contents(tmp_path)
    status, output = run("train", arguments[0], *SMALL, *arguments[1:])
    assert status == 1
    assert expected in output
    [line] = output.splitlines()
    assert line.startswith("error: ")
    assert contents(tmp_path) == before


@pytest.mark.slow
def test_test_images_have_their_own_key_and_info_plots_the_run(run, tmp_path):
    rng = np.random.default_rng(0)
    scenes, tests = rng.random((4, 24, 24)), np.full((2, 24, 24), 0.5)
    np.savez("two.npz", scenes=scenes, tests=tests)
    arguments = ["--key", "scenes", "--test", "two.npz", "--test-key", "tests", "--batch", 4]
    assert run("train", "two.npz", "-o", NETWORK, "--steps", 1, *arguments)[0] == 0
    records = jl.Network.load(NETWORK).history["stages"][-1]["records"]
    trained = jl.evaluate(jl.Network.load(NETWORK), tests, jl.Sensor(oversampling=4))
    assert abs(records["test_psnr"][-1] - trained.mean("psnr")) < 3
    status, _ = run("info", NETWORK, "--plot", "run.png")
    assert status == 0
    assert (tmp_path / "run.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "m.checkpoint.safetensors"], "which is for stopped runs"),
        (["-o", "m.safetensors", "--start", "m.checkpoint.safetensors"], "is read, so it is not"),
        (["-o", "m.safetensors", "--damping", 1, "--optimizer", "adam"], "damping: is for gauss"),
        (["-o", "m.safetensors", "--test-key", "a"], "test-key: names an array of --test"),
    ],
)
def test_options_that_would_be_lost_or_ignored_are_refused(run, photo_folder, arguments, message):
    jl.Network.initial(jl.Sensor(oversampling=4)).save("m.checkpoint.safetensors")
    status, output = run("train", photo_folder, *arguments, "--restart")
    assert status == 1
    assert message in output
    assert jl.Network.load("m.checkpoint.safetensors")


@pytest.mark.slow
@pytest.mark.filterwarnings("always")
def test_a_file_of_gray_levels_is_reported_once_by_its_name(run, photo_folder):
    np.save(photo_folder / "levels.npy", np.full((64, 64), 200.0))
    status, output = run("train", photo_folder, "-o", NETWORK, "--steps", 1)
    assert status == 0
    assert f"{photo_folder / 'levels.npy'}: most intensities should be" in output
    assert output.count("most intensities") == 1
