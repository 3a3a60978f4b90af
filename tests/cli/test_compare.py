"""`jotlight compare`."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from folders import file_names
from jotlight.cli.terminal import console
from jotlight.evaluation.methods import METHODS
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.io import read_image, read_note
from jotlight.networks.pretrained import FOLDER

ITERATIVE = {"admm-tv": jl.admm_tv, "mle-iterative": jl.mle_iterative}
TITLES = {name: METHODS[name].title for name in ITERATIVE}


@pytest.fixture(autouse=True)
def forget_warnings(monkeypatch):
    """Forget the warnings of other tests: a process prints each warning once."""
    monkeypatch.setattr(console, "shown_warnings", set())


@pytest.mark.slow
def test_compare_prints_a_table_and_writes_one_figure(run, photo, tmp_path):
    status, output = run("compare", photo, "-m", "mle,noniterative-gaussian,network-two-layer")
    assert status == 0
    for word in (
        "maximum likelihood",
        "non-iterative, Gaussian",
        "network",
        "PSNR",
        "SSIM",
        "time",
    ):
        assert word in output
    assert file_names(tmp_path) == ["photo-compare.png", "photo.png"]
    with Image.open(tmp_path / "photo-compare.png") as figure:
        assert min(figure.size) > 300


@pytest.mark.parametrize(
    "ending",
    ["png", *(pytest.param(each, marks=pytest.mark.slow) for each in ("jpg", "pdf", "svg"))],
)
def test_compare_writes_every_kind_of_figure(run, color, tmp_path, ending):
    assert run("compare", color, "-m", "mle", "-o", f"figure.{ending}")[0] == 0
    assert (tmp_path / f"figure.{ending}").stat().st_size > 5000


def test_the_color_network_is_compared_by_its_name(run, color):
    status, output = run("compare", color, "-m", "network-color")
    assert status == 0
    assert "network, color" in output
    status, output = run("compare", color, "-m", "network-color", "--gray")
    assert status == 1
    assert "network-color takes red, green, and blue, got a gray image" in output


@pytest.mark.slow
def test_tiny_images_are_compared_without_ssim(run, tmp_path):
    np.save("tiny.npy", np.full((8, 8), 0.5, np.float32))
    status, output = run("compare", "tiny.npy", "-m", "mle,noniterative-tv")
    assert status == 0
    assert "none" in output


@pytest.mark.parametrize("channels", [2, 4])
def test_images_of_two_or_four_channels_are_refused_by_compare_and_by_gray(run, tmp_path, channels):
    np.save("odd.npy", np.full((20, 20, channels), 0.5, np.float32))
    status, output = run("compare", "odd.npy", "-m", "mle")
    assert status == 1
    assert f"{channels} channels" in output
    assert run("simulate", "odd.npy", "-o", "bits.npy")[0] == 0
    assert jl.open("bits.npy").shape[3] == channels
    status, output = run("simulate", "odd.npy", "-o", "gray.npy", "--gray")
    assert status == 1
    assert "red, green, and blue" in output


@pytest.mark.slow
def test_a_method_that_ignores_a_smooth_kernel_warns(photo, tmp_path):
    arguments = ["compare", str(photo), "-m", "mle", "--kernel", "cubic"]
    done = subprocess.run(
        [sys.executable, "-m", "jotlight", *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0
    assert "warning: a cubic kernel spreads" in done.stderr


@pytest.mark.slow
def test_a_warning_of_several_methods_is_printed_once(photo, tmp_path):
    arguments = ["compare", str(photo), "-m", "mle,noniterative-gaussian,noniterative-tv"]
    done = subprocess.run(
        [sys.executable, "-m", "jotlight", *arguments, "--kernel", "linear"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.stderr.count("warning: a linear kernel spreads") == 1


@pytest.fixture
def without_slow_methods(monkeypatch):
    for name in ("noniterative-nlm", "noniterative-bm3d", "noniterative-tv", "network-initial"):
        monkeypatch.delitem(METHODS, name)


@pytest.mark.slow
def test_compare_omits_iterative_mle_for_the_box_kernel(run, photo, without_slow_methods):
    status, output = run("compare", photo)
    assert status == 0
    assert TITLES["admm-tv"] in output
    assert TITLES["mle-iterative"] not in output


@pytest.mark.slow
def test_compare_shows_every_named_method(run, photo):
    status, output = run("compare", photo, "--method", "mle,admm-tv", "-m", "mle-iterative")
    assert status == 0
    scores = dict(re.findall(r"^(.*?) +(\S+) dB", output, re.MULTILINE))
    assert list(scores) == ["maximum likelihood", *TITLES.values()]
    assert scores["maximum likelihood"] == scores[TITLES["mle-iterative"]]
    assert float(scores[TITLES["admm-tv"]]) > float(scores["maximum likelihood"]) + 3


@pytest.mark.slow
@pytest.mark.filterwarnings("always")
def test_compare_shows_both_iterative_methods_for_a_smooth_kernel(
    run, photo, tmp_path, without_slow_methods
):
    status, output = run("compare", photo, "--kernel", "quadratic")
    assert status == 0
    assert all(output.count(title) == 1 for title in TITLES.values())
    assert "not converged" not in output
    assert "photo-compare.png" in file_names(tmp_path)


@pytest.mark.slow
def test_functions_and_networks_are_compared_with_named_methods(run, photo, own_module):
    arguments = ["-k", 2, "-m", f"mle,{own_module}:mean", "--quality", "medium"]
    status, output = run("compare", photo, *arguments)
    assert status == 0, output
    titles = re.findall(r"^(.*?) +\S+ dB", output, re.MULTILINE)
    assert titles == ["maximum likelihood", f"{own_module}:mean", "network, medium"]


def test_a_missing_function_is_refused_before_any_work(run, photo, own_module, tmp_path):
    before = file_names(tmp_path)
    status, output = run("compare", photo, "-m", f"{own_module}:meen")
    assert status == 1
    assert f"did you mean {own_module}:mean?" in output
    # Python may write the bytecode of the module.
    assert [name for name in file_names(tmp_path) if "__pycache__" not in name] == before


def test_missing_packages_are_named_only_if_all_methods_are_compared(run, photo):
    assert "Not installed" not in run("compare", photo, "-m", "mle", "-o", "a.png")[1]


def test_the_sensor_is_that_of_the_model_unless_options_change_it(run, photo):
    jl.Network.initial(jl.Sensor(oversampling=2, frames=8)).save("own.safetensors")
    status, output = run("compare", photo, "-m", "mle", "--model", "own.safetensors")
    assert status == 0, output
    expected = jl.compare(
        {"mle": "mle"}, read_image(photo), jl.Sensor(oversampling=2, frames=8), rng=0
    )
    assert f"{expected.results[0].psnr:.2f} dB" in output
    assert "own.safetensors" in output
    status, output = run("compare", photo, "-m", "mle", "--model", "own.safetensors", "-t", 4)
    assert status == 1
    assert "got Sensor(oversampling=2, frames=4" in output


@pytest.mark.parametrize("ending", ["png", "jpg"])
def test_the_figure_states_its_origin(run, photo, tmp_path, ending):
    arguments = ["-m", "mle", "--gray", "--seed", 3, "-k", 2, "-o", f"figure.{ending}"]
    assert run("compare", photo, *arguments)[0] == 0
    note = read_note(tmp_path / f"figure.{ending}")
    assert (note["method"], note["options"]) == (["mle"], {"seed": 3, "gray": True})
    assert note["sensor"] == jl.Sensor(oversampling=2).scalars()
    assert note["photographs_sha256"] == file_checksum(photo)
    shown = " ".join(run("info", f"figure.{ending}")[1].split())
    assert "seed=3, gray=True" in shown
    assert f"SHA-256 {file_checksum(photo)}" in shown


def test_the_figure_states_the_weights_of_all_networks(run, photo, tmp_path):
    (tmp_path / "nets").mkdir()
    jl.Network.initial(jl.Sensor(frames=16)).save("nets/own.safetensors")
    options = ["-m", "mle,network-small", "--model", "nets/own.safetensors"]
    assert run("compare", photo, *options, "-o", "figure.png")[0] == 0
    note = read_note(tmp_path / "figure.png")
    files = tmp_path / "nets/own.safetensors", FOLDER / "small-k16.safetensors"
    assert note["weights_sha256"] == sorted(map(file_checksum, files))
    assert note["method"] == ["mle", "network-small", "own.safetensors"]
    assert str(tmp_path) not in json.dumps(note)
    assert "nets" not in json.dumps(note)


def test_a_figure_is_no_capture(run, photo):
    assert run("compare", photo, "-m", "mle", "-o", "figure.png")[0] == 0
    message = f"got a figure, in which jotlight compares estimates of {photo.name}; name a capture"
    for arguments in (["info", "--verify"], ["reconstruct", "-o", "b.png"]):
        status, output = run(arguments[0], "figure.png", *arguments[1:])
        assert status == 1
        assert message in output


@pytest.mark.parametrize("ending", ["pdf", "svg"])
def test_figures_of_lines_state_their_origin(run, photo, tmp_path, ending):
    assert run("compare", photo, "-m", "mle", "-o", f"figure.{ending}")[0] == 0
    assert b"photographs_sha256" in (tmp_path / f"figure.{ending}").read_bytes()
