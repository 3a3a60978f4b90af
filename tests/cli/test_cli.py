import contextlib
import errno
import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.images.io import read_image


@pytest.fixture
def photo(tmp_path):
    path = tmp_path / "photo.png"
    levels = (jl.datasets.photograph("camera")[100:140, 180:229] * 255).astype(np.uint8)
    Image.fromarray(levels).save(path)
    return path


@pytest.fixture
def colour(tmp_path):
    path = tmp_path / "colour.png"
    levels = (jl.datasets.photograph("coffee")[100:140, 180:229] * 255).astype(np.uint8)
    Image.fromarray(levels).save(path)
    return path


def files(folder):
    return sorted(path.name for path in folder.iterdir())


def test_simulate_then_reconstruct_gives_what_the_python_interface_gives(run, photo, tmp_path):
    status, said = run("simulate", photo, "-o", "bits.npy", "-k", 3, "-t", 2, "--seed", 5)
    assert status == 0
    assert "2 frames of 120 x 147 jots" in said
    image = read_image(photo)
    sensor = jl.Sensor(oversampling=3, frames=2)
    bits = jl.open(tmp_path / "bits.npy")
    assert bits.sensor == sensor
    assert (bits.packed == sensor.expose(image, 5).packed).all()
    status, _ = run("reconstruct", "bits.npy", "-o", "out.npy", "--method", "mle")
    assert status == 0
    assert (np.load(tmp_path / "out.npy") == jl.mle(bits, sensor)).all()


@pytest.mark.parametrize(
    "method",
    ["mle", "noniterative-tv", "noniterative-gaussian", "network-initial", "network-two-layer"],
)
def test_every_method_reconstructs_colour(run, colour, tmp_path, method):
    assert run("simulate", colour, "-o", "bits.npy", "-k", 4)[0] == 0
    assert run("reconstruct", "bits.npy", "-o", "out.tif", "-m", method)[0] == 0
    assert read_image(tmp_path / "out.tif").shape == (40, 49, 3)


def test_gray_turns_colour_into_luma(run, colour, tmp_path):
    assert run("simulate", colour, "-o", "bits.npy", "--gray")[0] == 0
    assert jl.open(tmp_path / "bits.npy").shape == (1, 160, 196)


def test_all_sensor_options_reach_the_sensor(run, photo, tmp_path):
    rng = np.random.default_rng(0)
    dark = rng.random((80, 98)).astype(np.float32)
    dead = rng.random((80, 98)) < 0.1
    np.save(tmp_path / "dark.npy", dark)
    np.save(tmp_path / "dead.npy", dead)
    options = ["-k", 2, "-t", 3, "--gain", 6, "-q", 2, "--kernel", "cubic"]
    options += ["--efficiency", 0.5, "--max-intensity", 2]
    maps = ["--dark-counts", "dark.npy", "--mask", "dead.npy"]
    assert run("simulate", photo, "-o", "bits.npy", *options, *maps)[0] == 0
    assert jl.open(tmp_path / "bits.npy").sensor == jl.Sensor(
        oversampling=2, frames=3, gain=6, threshold=2, kernel="cubic", dark_counts=dark,
        efficiency=0.5, mask=dead, max_intensity=2,
    )  # fmt: skip


def test_counts_are_reconstructed_when_told_out_of_how_many(run, tmp_path):
    counts = np.arange(48, dtype=np.uint16).reshape(6, 8) % 17
    np.save(tmp_path / "counts.npy", counts)
    np.savez(tmp_path / "counts.npz", k16=counts, other=counts)
    status, said = run("reconstruct", "counts.npy", "-o", "out.npy", "-m", "mle")
    assert status == 1
    assert "--frames" in said
    for words in (["counts.npy"], ["counts.npz", "--key", "k16"]):
        words += ["-o", "out.npy", "-m", "mle", "--frames", 16, "--max-intensity", 1]
        status, said = run("reconstruct", *words)
        assert status == 0
        assert "assumed" in said
        assert (np.load(tmp_path / "out.npy") == jl.mle(counts, jl.Sensor(frames=16))).all()
    status, said = run("reconstruct", "counts.npz", "-o", "out.npy", "--frames", 16)
    assert status == 1
    assert "k16, other" in said


def test_a_foreign_cube_says_what_was_assumed(run, tmp_path):
    np.save(tmp_path / "cube.npy", np.full((4, 6, 2), 0b01010101, np.uint8))
    status, said = run("reconstruct", "cube.npy", "-o", "out.png", "-m", "mle")
    assert status == 0
    assert "assumed: Sensor(frames=4, max_intensity=2.07" in said  # log(2 * 4)


def test_a_network_file_is_used(run, photo, tmp_path):
    network = jl.Network.initial(jl.Sensor(oversampling=2), sigma=1.0)
    network.save(tmp_path / "model.safetensors")
    assert run("simulate", photo, "-o", "bits.npy", "-k", 2)[0] == 0
    words = ["reconstruct", "bits.npy", "-o", "out.npy"]
    assert run(*words, "--model", "model.safetensors")[0] == 0
    bits = jl.open(tmp_path / "bits.npy")
    assert (np.load(tmp_path / "out.npy") == network.reconstruct(bits)).all()


def test_compare_prints_a_table_and_writes_one_figure(run, photo, tmp_path):
    status, said = run("compare", photo, "-m", "mle,noniterative-gaussian,network-two-layer")
    assert status == 0
    for word in (
        "maximum likelihood",
        "non-iterative, Gaussian",
        "network",
        "PSNR",
        "SSIM",
        "time",
    ):
        assert word in said
    assert files(tmp_path) == ["photo-compare.png", "photo.png"]
    with Image.open(tmp_path / "photo-compare.png") as figure:
        assert min(figure.size) > 300


@pytest.mark.parametrize("ending", ["png", "jpg", "pdf", "svg"])
def test_compare_writes_every_kind_of_figure(run, colour, tmp_path, ending):
    assert run("compare", colour, "-m", "mle", "-o", f"figure.{ending}")[0] == 0
    assert (tmp_path / f"figure.{ending}").stat().st_size > 5000


def test_demo_shows_at_least_three_methods(run, tmp_path):
    status, said = run("demo", "-o", "demo.png")
    assert status == 0
    assert said.count(" dB") >= 3
    assert files(tmp_path) == ["demo.png"]


def test_info_on_every_kind_of_file(run, photo, tmp_path):
    assert run("simulate", photo, "-o", "bits.npy")[0] == 0
    np.save(tmp_path / "counts.npy", np.arange(6).reshape(2, 3))
    jl.Network.initial(jl.Sensor()).save(tmp_path / "model.safetensors")
    for name, words in {
        "bits.npy": ["160 x 196", "oversampling=4", "ones", "40 x 49"],
        "counts.npy": ["counts", "2 x 3", "0 to 5"],
        "model.safetensors": ["kFLOP per pixel", "15 x 15", "150"],
        "photo.png": ["image", "40 x 49"],
    }.items():
        status, said = run("info", name)
        assert status == 0
        for word in words:
            assert word in said, (name, word)


def test_version_and_help(run):
    assert jl.__version__ in run("--version")[1]
    for command in (
        "demo",
        "compare",
        "simulate",
        "reconstruct",
        "train",
        "fine-tune",
        "evaluate",
        "info",
        "convert",
    ):
        assert command in run("--help")[1]
        assert run(command, "--help")[0] == 0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["simulate", "none.png", "-o", "a.npy"], "there is no image file none.png"),
        (["simulate", "photo.png", "-o", "a.npy", "-k", "0"], "oversampling: expected"),
        (["simulate", "photo.png", "-o", "a.npy", "-q", "0"], "threshold: expected"),
        (["simulate", "photo.png", "-o", "a.npy", "--gain", "-1"], "gain: expected"),
        (["simulate", "photo.png", "-o", "a.npy", "--kernel", "round"], "kernel: expected one of"),
        (["simulate", "photo.png", "-o", "a.tif"], "ends in .npy"),
        (["simulate", "photo.png", "-o", "nowhere/a.npy"], "there is no folder nowhere"),
        (["simulate", "photo.png", "-o", "photo.png/a.npy"], "cannot write"),
        (["simulate", "counts.npy", "-o", "a.npy"], "--white"),
        (["simulate", "text.png", "-o", "a.npy"], "no known format"),
        (["simulate", "cut.png", "-o", "a.npy"], "damaged or truncated"),
        (["reconstruct", "bits.npy", "-o", "a.gif"], "ends in .png"),
        (["reconstruct", "bits.npy", "-o", "a.jpg", "--depth", "16"], "16 for a .png"),
        (["reconstruct", "bits.npy", "-o", "bits.npy"], "another name"),
        (["reconstruct", "bits.npy", "-o", "nowhere/a.png"], "there is no folder"),
        (["reconstruct", "bits.npy", "-o", "a.png", "-m", "magic"], "expected one of mle"),
        (
            ["reconstruct", "bits.npy", "-o", "a.png", "-m", "mle", "-k", "7"],
            "multiples of the oversampling",
        ),
        (["reconstruct", "bits.npy", "-o", "a.png", "-m", "mle", "--inverse", "exact"], "inverse"),
        (["reconstruct", "pickle.npy", "-o", "a.png"], "Python objects"),
        (["reconstruct", "counts.npy", "-o", "a.png", "-m", "mle", "-t", "3"], "0 to K = 3"),
        (["compare", "photo.png", "-m", "mle,magic"], "expected some of"),
        (["compare", "photo.png", "-o", "a.gif"], "ends in .png"),
        (["compare", "photo.png", "-o", "photo.png"], "another name"),
        (["compare", "nan.npy", "-o", "a.png"], "finite"),
        (["demo", "--photo", "nobody"], "expected one of camera"),
        (["info", "none.npy"], "there is no file"),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_nothing(run, photo, tmp_path, words, expected):
    jl.save(jl.Bits.from_array(np.ones((1, 8, 8), bool), jl.Sensor(oversampling=4)), "bits.npy")
    np.save("counts.npy", np.arange(64).reshape(8, 8))
    np.save("nan.npy", np.full((20, 20), np.nan))
    np.save("pickle.npy", np.array([{}, None], dtype=object))
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "cut.png").write_bytes(photo.read_bytes()[:200])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    status, said = run(*words)
    assert status == 1
    assert expected in said
    assert said.startswith("error: ")
    assert "Traceback" not in said
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_wrong_place_is_found_before_the_work_starts(run, photo, monkeypatch):
    def work(*args, **kwargs):
        raise AssertionError("the work has begun")

    monkeypatch.setattr(jl.Sensor, "expose", work)
    assert "there is no folder" in run("simulate", photo, "-o", "nowhere/bits.npy")[1]
    assert "there is no folder" in run("compare", photo, "-o", "nowhere/figure.png")[1]


def test_a_missing_bm3d_says_how_to_get_it_and_its_licence(run, photo, monkeypatch):
    monkeypatch.setitem(sys.modules, "bm3d", None)
    assert run("simulate", photo, "-o", "bits.npy")[0] == 0
    status, said = run("reconstruct", "bits.npy", "-o", "a.png", "-m", "noniterative-bm3d")
    assert status == 1
    assert "jotlight[bm3d]" in said
    assert "non-commercial" in said


@pytest.mark.filterwarnings("always")
def test_filled_pixels_are_reported(run, photo, tmp_path):
    dead = np.zeros((40, 49), bool)
    dead[3, 4] = True
    np.save(tmp_path / "dead.npy", dead)
    assert run("simulate", photo, "-o", "bits.npy", "-k", 1, "-t", 4, "--mask", "dead.npy")[0] == 0
    status, said = run("reconstruct", "bits.npy", "-o", "a.png", "-m", "mle")
    assert status == 0
    assert "warning: 1 of 1960 pixels" in said


def test_a_long_command_shows_how_far_it_is(monkeypatch, tmp_path, photo):
    """On a terminal; here a pseudo-terminal."""
    leader, follower = os.openpty()
    command = [
        sys.executable,
        "-m",
        "jotlight",
        "compare",
        str(photo),
        "-m",
        "mle,noniterative-nlm",
    ]
    child = subprocess.Popen(command, stderr=follower, stdout=subprocess.DEVNULL, cwd=tmp_path)
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
    assert b"drawing the figure" in shown
    assert b"%" in shown


LONG = ["simulate", "large.npy", "-o", "bits.npy", "-k", "16", "-t", "40"]


@contextlib.contextmanager
def long_command(folder):
    """Start a command of many seconds and wait until it has files to take away."""
    np.save(folder / "large.npy", np.full((2000, 2000), 0.5, np.float32))
    # A shell lets its background jobs ignore SIGINT, and these tests may be one.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    code += (
        f"import sys; sys.argv = ['jotlight', *{LONG!r}]; from jotlight.cli.app import main; main()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], cwd=folder, stderr=subprocess.PIPE, text=True
    ) as child:
        try:
            deadline = time.monotonic() + 30
            while len(files(folder)) < 3 and time.monotonic() < deadline:
                time.sleep(0.05)
            assert len(files(folder)) >= 3, "the temporary files were never seen"
            time.sleep(0.3)
            yield child
        finally:
            child.kill()


def test_ctrl_c_stops_promptly_and_leaves_nothing(tmp_path):
    with long_command(tmp_path) as child:
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=20)
    assert child.returncode == 130
    assert "stopped" in said
    assert files(tmp_path) == ["large.npy"]


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "same.npy", "-o", "same.npy"],
        ["simulate", "photo.png", "-o", "dead.npy", "--mask", "dead.npy", "-k", "1"],
        ["simulate", "photo.png", "-o", "dark.npy", "--dark-counts", "dark.npy", "-k", "1"],
        ["simulate", "photo.png", "-o", "./sub/../dead.npy", "--mask", "dead.npy", "-k", "1"],
        ["reconstruct", "bits.npy", "-o", "bits.npy", "-m", "mle"],
        ["reconstruct", "bits.npy", "-o", "bits.mask.npy", "-m", "mle"],
        ["reconstruct", "bits.npy", "-o", "link.npy", "-m", "mle"],
        ["compare", "photo.png", "-o", "photo.png", "-m", "mle"],
    ],
)
def test_a_file_that_is_read_is_never_overwritten(run, photo, tmp_path, words):
    dead = np.zeros((40, 49), bool)
    dead[0, 0] = True
    np.save("dead.npy", dead)
    np.save("dark.npy", np.full((40, 49), 0.1, np.float32))
    np.save("same.npy", np.full((20, 20), 0.5, np.float32))
    jl.save(jl.Sensor(mask=dead).expose(np.full((40, 49), 0.5), rng=0), "bits.npy")
    (tmp_path / "link.npy").symlink_to("bits.npy")
    (tmp_path / "sub").mkdir()
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    status, said = run(*words)
    assert status == 1
    assert "this file is read" in said
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_simulating_again_without_a_mask_leaves_no_stale_map(run, photo, tmp_path):
    np.save("dead.npy", np.zeros((40, 49), bool))
    masked = ["simulate", photo, "-o", "bits.npy", "-k", 1, "--mask", "dead.npy"]
    for words in (masked, masked[:-2], masked):
        assert run(*words)[0] == 0
        assert (tmp_path / "bits.mask.npy").exists() == ("--mask" in words)
        assert jl.open("bits.npy").sensor == jl.Sensor(
            mask=np.zeros((40, 49), bool) if "--mask" in words else None
        )


def test_archives_of_strangers_are_refused_by_name(run, tmp_path):
    np.savez("objects.npz", a=np.array([{}], dtype=object))
    np.save("array.npy", np.arange(4))
    (tmp_path / "array.npy").rename(tmp_path / "array.npz")
    (tmp_path / "text.npz").write_text("no archive")
    np.savez("cut.npz", a=np.arange(10_000).reshape(100, 100))
    whole = (tmp_path / "cut.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[:100] + b"x" * 900 + whole[1000:])
    for name, expected in {
        "objects.npz": "Python objects",
        "array.npz": "expected counts",
        "text.npz": "expected a .npz file",
        "cut.npz": "damaged",
    }.items():
        status, said = run("reconstruct", name, "-o", "a.png", "--frames", 9, "-m", "mle")
        assert status == 1
        assert said.startswith(f"error: {name}")
        assert expected in said
        assert "allow_pickle" not in said


def test_info_lists_the_arrays_of_an_archive(run):
    np.savez("counts.npz", k1=np.zeros((3, 4), np.uint16), k4=np.zeros((5, 6), np.uint8))
    said = run("info", "counts.npz")[1]
    assert "uint16, 3 x 4" in said
    assert "uint8, 5 x 6" in said


def test_tiny_pictures_are_compared_without_ssim(run, tmp_path):
    np.save("tiny.npy", np.full((8, 8), 0.5, np.float32))
    status, said = run("compare", "tiny.npy", "-m", "mle,noniterative-tv")
    assert status == 0
    assert "none" in said


@pytest.mark.parametrize("channels", [2, 4])
def test_channels_that_cannot_be_shown_are_refused_before_the_work(run, tmp_path, channels):
    np.save("odd.npy", np.full((20, 20, channels), 0.5, np.float32))
    status, said = run("compare", "odd.npy", "-m", "mle")
    assert status == 1
    assert f"{channels} channels" in said
    assert run("simulate", "odd.npy", "-o", "bits.npy")[0] == 0
    assert jl.open("bits.npy").shape[3] == channels
    status, said = run("simulate", "odd.npy", "-o", "grey.npy", "--gray")
    assert status == 1
    assert "red, green, and blue" in said


def test_a_full_disk_is_named_and_leaves_nothing(run, photo, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    status, said = run("simulate", photo, "-o", "bits.npy")
    assert status == 1
    assert re.search(r"cannot write bits.(npy|json): No space left", said)
    assert files(tmp_path) == ["photo.png"]


def test_a_smooth_kernel_that_a_method_does_not_know_is_said(photo, tmp_path):
    words = ["compare", str(photo), "-m", "mle", "--kernel", "cubic"]
    done = subprocess.run(
        [sys.executable, "-m", "jotlight", *words], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0
    assert "warning: the light of a cubic kernel" in done.stderr


def test_terminating_leaves_nothing(tmp_path):
    with long_command(tmp_path) as child:
        child.terminate()
        assert child.wait(timeout=20) == 143
    assert files(tmp_path) == ["large.npy"]


def test_simulating_does_not_take_away_the_map_that_it_reads(run, tmp_path):
    np.save("scene.npy", np.full((20, 24), 0.5, np.float32))
    np.save("dark.npy", np.full((20, 24), 0.25, np.float32))
    words = ["simulate", "scene.npy", "-o", "a.npy", "-k", 1, "--dark-counts", "dark.npy"]
    assert run(*words)[0] == 0
    before = (tmp_path / "a.dark_counts.npy").read_bytes()
    status, said = run("simulate", "a.dark_counts.npy", "-o", "a.npy", "-k", 1)
    assert status == 1
    assert "this file is read" in said
    assert (tmp_path / "a.dark_counts.npy").read_bytes() == before


def test_members_of_an_archive_that_are_no_arrays_are_refused(run):
    with zipfile.ZipFile("odd.npz", "w") as archive:
        archive.writestr("a.npy", "no array")
        archive.writestr("b.npy", "")
        archive.writestr("c.txt", "text")
    for name in "ab":
        for words in (["reconstruct", "odd.npz", "--key", name, "-o", "a.png", "-t", 9], ["info"]):
            status, said = run(*words, *(["odd.npz"] if words == ["info"] else []))
            assert status == 1
            assert said.startswith("error: odd.npz: ")
            assert "damaged" in said
    odd = Path("odd.npz")
    content = bytearray(odd.read_bytes())
    for at in [i for i in range(len(content)) if content[i : i + 4] == b"PK\x01\x02"]:
        content[at + 10] = 97  # a way of packing that nobody knows
    odd.write_bytes(content)
    status, said = run("info", "odd.npz")
    assert status == 1
    assert said.startswith("error: odd.npz: the array a is damaged")


def test_a_warning_is_said_once_however_many_methods_give_it(photo, tmp_path):
    words = ["compare", str(photo), "-m", "mle,noniterative-gaussian,noniterative-tv"]
    done = subprocess.run(
        [sys.executable, "-m", "jotlight", *words, "--kernel", "linear"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.stderr.count("warning: the light of a linear kernel") == 1


def test_help_tells_the_defaults(run):
    said = run("simulate", "--help")[1]
    assert "[default: 4]" in said
    assert "[default: 1]" in said
