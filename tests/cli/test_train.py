import os
import subprocess
import sys

import numpy as np
import pytest

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.training import Adam, parameter_vector

SMALL = ["--patch", 24, "--batch", 4, "--steps", 3, "--optimizer", "adam"]
NETWORK = "net.safetensors"


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_same(one, other):
    np.testing.assert_array_equal(parameter_vector(one), parameter_vector(other))


def test_a_folder_of_pictures_gives_the_network_that_python_gives(run, pictures, tmp_path):
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--seed", 7, "-t", 2)
    assert status == 0
    assert f"{NETWORK}: trained in 3 steps" in said
    sensor = jl.Sensor(oversampling=4, frames=2)
    learned, history = jl.train(
        jl.Network.initial(sensor), read_image_set(pictures)[1],
        optimizer="adam", steps=3, batch=4, patch=24, rng=7,
    )  # fmt: skip
    network = jl.Network.load(NETWORK)
    assert network.sensor == sensor
    assert_same(network, learned)
    assert network.history["run"] == learned.history["run"]
    assert f"cost {history.loss[0]:.4g} to {history.loss[-1]:.4g}" in said
    assert files(tmp_path) == [NETWORK, "pictures"]


def test_the_default_optimiser_is_gauss_newton(run, pictures):
    assert run("train", pictures, "-o", NETWORK, "--batch", 4, "--steps", 1)[0] == 0
    assert "GaussNewton" in jl.Network.load(NETWORK).history["run"]["optimizer"]


def test_the_network_serves_the_other_commands(run, pictures):
    assert run("train", pictures, "-o", NETWORK, *SMALL, "-k", 3, "-t", 2)[0] == 0
    status, said = run("info", NETWORK)
    assert status == 0
    for word in ("network", "oversampling=3, frames=2", "Adam", "pictures"):
        assert word in said
    status, said = run("evaluate", pictures, "--model", NETWORK)
    assert status == 0
    assert "3 images, Sensor(oversampling=3, frames=2)" in said
    assert run("simulate", pictures / "0.png", "-o", "bits.npy", "-k", 3, "-t", 2)[0] == 0
    status, said = run("reconstruct", "bits.npy", "-o", "out.npy", "--model", NETWORK)
    assert status == 0
    bits = jl.open("bits.npy")
    assert (np.load("out.npy") == jl.Network.load(NETWORK).reconstruct(bits)).all()


def test_synthetic_scenes_are_made_and_tested_on(run):
    words = ["--batch", 4, "--steps", 2, "--optimizer", "adam"]
    status, said = run("train", "synthetic", "-o", NETWORK, *words)
    assert status == 0
    assert "test PSNR" in said
    history = jl.Network.load(NETWORK).history
    assert history["run"]["images"] == "uniform_scenes"
    assert np.isfinite(history["records"]["test_psnr"]).all()


def test_what_learns_from_synthetic_scenes_is_tested_on_the_pictures_given(run, pictures):
    words = ["--batch", 4, "--steps", 1, "--optimizer", "adam", "--test", pictures]
    assert run("train", "synthetic", "-o", NETWORK, *words)[0] == 0
    assert run("train", pictures, "-o", "same.safetensors", *SMALL, "--test", pictures)[0] == 0
    first = [
        jl.Network.load(name).history["records"]["test_psnr"][0]
        for name in (NETWORK, "same.safetensors")
    ]
    assert first[0] == first[1]


def test_a_folder_of_the_name_synthetic_is_a_folder(run, pictures, tmp_path):
    pictures.rename(tmp_path / "synthetic")
    assert run("train", "synthetic", "-o", NETWORK, *SMALL)[0] == 0
    assert jl.Network.load(NETWORK).history["run"]["images"] != "uniform_scenes"


def test_an_array_of_an_archive_is_taken_by_its_key(run, pictures):
    images = np.stack(read_image_set(pictures)[1])
    np.savez("sets.npz", dim=images * np.float32(0.1), all=images)
    assert run("train", "sets.npz", "--key", "all", "-o", NETWORK, *SMALL)[0] == 0
    assert run("train", pictures, "-o", "same.safetensors", *SMALL)[0] == 0
    assert_same(jl.Network.load(NETWORK), jl.Network.load("same.safetensors"))
    assert run("train", "sets.npz", "--key", "dim", "-o", "other.safetensors", *SMALL)[0] == 0
    networks = [jl.Network.load(name) for name in (NETWORK, "other.safetensors")]
    assert (parameter_vector(networks[0]) != parameter_vector(networks[1])).any()
    status, said = run("train", "sets.npz", "-o", "none.safetensors", *SMALL)
    assert status == 1
    assert "--key" in said
    assert "dim, all" in said


def test_white_scales_the_test_images_too(run, pictures):
    images = np.stack(read_image_set(pictures)[1])
    np.save("deep.npy", np.rint(images * 4095).astype(np.uint16))
    words = ["train", "deep.npy", "-o", NETWORK, *SMALL, "--test", "deep.npy"]
    status, said = run(*words)
    assert status == 1
    assert "state the level of intensity 1 with --white" in said
    assert run(*words, "--white", 4095)[0] == 0
    assert jl.Network.load(NETWORK).history["records"]["test_psnr"][0] > 15


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_plot_draws_a_figure(run, pictures, tmp_path, ending):
    words = ["train", pictures, "-o", NETWORK, *SMALL, "--plot", f"figure.{ending}"]
    status, said = run(*words)
    assert status == 0
    assert f"Figure: figure.{ending}" in said
    assert (tmp_path / f"figure.{ending}").stat().st_size > 5000


def test_every_option_reaches_the_run(run, pictures, monkeypatch):
    seen = {}

    def learn(network, images, sensor, **options):
        seen.update(options, network=network, sensor=sensor)
        raise ValueError("seen enough")

    monkeypatch.setattr(jl.training, "train", learn)
    options = ["-k", 2, "-t", 3, "--gain", 6, "-q", 2, "--kernel", "cubic", "--sigma", 1.5]
    options += ["--dark-counts", 0.1, "--efficiency", 0.5, "--max-intensity", 2, "--untied"]
    options += ["--learning-rate", 0.125, "--threads", 1, "--seed", 9]
    assert run("train", pictures, "-o", NETWORK, *SMALL, *options)[0] == 1
    assert seen["sensor"] == jl.Sensor(
        oversampling=2, frames=3, gain=6, threshold=2, kernel="cubic", dark_counts=0.1,
        efficiency=0.5, max_intensity=2,
    )  # fmt: skip
    assert_same(seen["network"], jl.Network.initial(seen["sensor"], sigma=1.5, tied=False))
    assert seen["optimizer"] == Adam(learning_rate=0.125)
    names = ("steps", "batch", "patch", "rng", "threads", "resume")
    assert [seen[name] for name in names] == [3, 4, 24, 9, 1, False]


def test_a_network_to_start_from_is_improved(run, pictures):
    assert run("train", pictures, "-o", "start.safetensors", *SMALL)[0] == 0
    words = ["--start", "start.safetensors", "--steps", 0]
    assert run("train", pictures, "-o", NETWORK, *SMALL, *words)[0] == 0
    np.testing.assert_allclose(
        parameter_vector(jl.Network.load(NETWORK)),
        parameter_vector(jl.Network.load("start.safetensors")),
        atol=1e-5,
    )


def test_without_a_terminal_each_tenth_of_the_way_is_a_line(run, pictures):
    status, said = run("train", pictures, "-o", NETWORK, *SMALL, "--steps", 20)
    assert status == 0
    lines = [line for line in said.splitlines() if line.startswith("step ")]
    assert [line.split()[1] for line in lines] == [f"{step}/20" for step in range(0, 21, 2)]
    assert all("cost " in line for line in lines)


def test_progress_goes_to_stderr_and_the_result_to_stdout(pictures, tmp_path):
    words = ["train", "pictures", "-o", NETWORK, *map(str, SMALL)]
    done = subprocess.run(
        [sys.executable, "-m", "jotlight", *words], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0
    assert "step 3/3" in done.stderr
    assert "trained in 3 steps" in done.stdout
    assert "step 3/3" not in done.stdout


def test_on_a_terminal_a_live_line_shows_the_run(pictures, tmp_path):
    """A pseudo-terminal."""
    leader, follower = os.openpty()
    words = ["train", "pictures", "-o", NETWORK, *map(str, SMALL), "--test", "pictures"]
    child = subprocess.Popen(
        [sys.executable, "-m", "jotlight", *words],
        cwd=tmp_path,
        stderr=follower,
        stdout=subprocess.DEVNULL,
    )
    os.close(follower)
    shown = b""
    while True:
        try:
            part = os.read(leader, 4096)
        except OSError:  # how a pseudo-terminal says that the other end is closed
            break
        if not part:
            break
        shown += part
    os.close(leader)
    assert child.wait() == 0
    for word in (b"step 3/3", b"cost ", b"gradient ", b"test ", b"left", b"\x1b["):
        assert word in shown


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["empty", "-o", NETWORK], "empty: expected images"),
        (["nothing", "-o", NETWORK], "there is no folder or file nothing"),
        (["pictures", "-o", NETWORK, "--patch", 25], "25; image number 0 is 24 x 24"),
        (["pictures", "-o", "net.onnx"], "ends in .safetensors"),
        (["pictures", "-o", "nowhere/net.safetensors"], "there is no folder nowhere"),
        (["pictures", "-o", NETWORK, "--optimizer", "sgd"], "one of gauss-newton, adam"),
        (
            ["pictures", "-o", NETWORK, "--optimizer", "gauss-newton", "--learning-rate", 0.1],
            "learning-rate: is for adam and projected-gradient",
        ),
        (
            ["pictures", "-o", NETWORK, "--learning-rate", 0],
            "learning_rate: expected a finite number above 0",
        ),
        (["pictures", "-o", NETWORK, "--steps", -1], "steps: expected at least 0"),
        (["pictures", "-o", NETWORK, "--batch", 0], "batch: expected at least 1"),
        (["pictures", "-o", NETWORK, "--sigma", 0], "sigma: expected a number above 0"),
        (["pictures", "-o", NETWORK, "--plot", "run.gif"], "ends in .png"),
        (["pictures", "-o", NETWORK, "--plot", "nowhere/run.png"], "there is no folder nowhere"),
        (["pictures", "-o", NETWORK, "--plot", "pictures/0.png"], "this file is read"),
        (["pictures", "-o", NETWORK, "--test", "nothing"], "there is no folder or file nothing"),
        (["pictures", "-o", NETWORK, "--key", "a"], "key: names an array in a .npz"),
        (
            ["pictures", "-o", NETWORK, "--start", "other.safetensors", "-k", 4],
            "got Sensor(oversampling=4)",
        ),
        (["pictures", "-o", NETWORK, "--start", "cut.safetensors"], "cut.safetensors: expected"),
        (["pictures", "-o", NETWORK, "--start", "none.safetensors"], "none.safetensors"),
        (["pictures", "-o", "other.safetensors", "--start", "other.safetensors"], "this file is"),
        (
            ["pictures", "-o", NETWORK, "--start", "other.safetensors", "--untied"],
            "start: this network has",
        ),
        (["pictures", "-o", NETWORK, "--resume"], "there is no stopped run to resume"),
        (["pictures", "-o", NETWORK, "--resume", "--restart"], "expected one of them"),
        (["pictures", "-o", NETWORK, "-k", 0], "oversampling: expected"),
        (["bad", "-o", NETWORK], "bad/b.png"),
        (["synthetic", "-o", NETWORK], "patch: expected none for a callable"),
    ],
)
def test_bad_input_gets_one_line_before_any_work_and_leaves_nothing(
    run, pictures, tmp_path, words, expected
):
    jl.Network.initial(jl.Sensor(oversampling=3)).save("other.safetensors")
    whole = (tmp_path / "other.safetensors").read_bytes()
    (tmp_path / "cut.safetensors").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty").mkdir()
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "b.png").write_text("no picture")
    before = contents(tmp_path)
    status, said = run("train", words[0], *SMALL, *words[1:])
    assert status == 1
    assert expected in said
    [line] = said.splitlines()
    assert line.startswith("error: ")
    assert contents(tmp_path) == before


def test_tests_have_an_array_of_their_own_and_a_run_can_be_drawn_later(run, tmp_path):
    rng = np.random.default_rng(0)
    scenes, tests = rng.random((4, 24, 24)), np.full((2, 24, 24), 0.5)
    np.savez("two.npz", scenes=scenes, tests=tests)
    words = ["--key", "scenes", "--test", "two.npz", "--test-key", "tests", "--batch", 4]
    assert run("train", "two.npz", "-o", NETWORK, "--steps", 1, *words)[0] == 0
    records = jl.Network.load(NETWORK).history["records"]
    learned = jl.evaluate(jl.Network.load(NETWORK), tests, jl.Sensor(oversampling=4))
    assert abs(records["test_psnr"][-1] - learned.mean("psnr")) < 3
    status, _ = run("info", NETWORK, "--plot", "run.png")
    assert status == 0
    assert (tmp_path / "run.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "m.checkpoint.safetensors"], "which is for stopped runs"),
        (["-o", "m.safetensors", "--start", "m.checkpoint.safetensors"], "is read, so it is not"),
        (["-o", "m.safetensors", "--damping", 1, "--optimizer", "adam"], "damping: is for gauss"),
        (["-o", "m.safetensors", "--test-key", "a"], "test-key: names an array of --test"),
    ],
)
def test_what_would_be_lost_or_go_unheard_is_refused(run, pictures, words, message):
    jl.Network.initial(jl.Sensor(oversampling=4)).save("m.checkpoint.safetensors")
    status, said = run("train", pictures, *words, "--restart")
    assert status == 1
    assert message in said
    assert jl.Network.load("m.checkpoint.safetensors")
