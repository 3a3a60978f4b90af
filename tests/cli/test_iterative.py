import contextlib
import csv
import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import jotlight as jl
from jotlight.cli import console
from jotlight.evaluation.methods import METHODS
from jotlight.images.io import read_image
from jotlight.images.sets import read_image_set

FUNCTIONS = {"admm-tv": jl.admm_tv, "mle-iterative": jl.mle_iterative}
TITLES = {name: METHODS[name].title for name in FUNCTIONS}
BOX = jl.Sensor(oversampling=4)
CUBIC = jl.Sensor(oversampling=3, frames=2, kernel="cubic")


@pytest.fixture(autouse=True)
def nothing_said(monkeypatch):
    """A warning is said once; what other tests saw does not count."""
    monkeypatch.setattr(console, "_shown_warnings", set())


@pytest.fixture
def scene():
    return jl.datasets.photograph("camera")[100:120, 180:204]


@pytest.fixture
def bits(scene, tmp_path):
    """Bits by kernel, each in a file of that name, and files of the counts of the box."""
    made = {"box": BOX.expose(scene, rng=1), "cubic": CUBIC.expose(scene, rng=2)}
    for name, data in made.items():
        jl.save(data, tmp_path / f"{name}.npy")
    counts = made["box"].counts()
    np.save(tmp_path / "counts.npy", counts)
    np.savez(tmp_path / "counts.npz", ones=counts, other=counts[:5])
    return made


@pytest.fixture
def photo(scene, tmp_path):
    Image.fromarray((scene * 255).astype(np.uint8)).save(tmp_path / "photo.png")
    return "photo.png"


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def counted(number):
    return f" ({number} iteration{'s' * (number != 1)}"


def assert_written(path, picture):
    # Sums in an order that depends on the threads.
    np.testing.assert_allclose(np.load(path), picture, atol=1e-5)


@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize("method", FUNCTIONS)
def test_reconstruct_writes_what_the_python_interface_gives_and_tells_the_iterations(
    run, bits, tmp_path, method, kernel
):
    status, said = run("reconstruct", f"{kernel}.npy", "-o", "out.npy", "-m", method)
    assert status == 0
    data = bits[kernel]
    picture, history = FUNCTIONS[method](data, data.sensor, return_history=True)
    assert_written(tmp_path / "out.npy", picture)
    # Two lines, and no bar where there is no terminal.
    result, sensor = said.splitlines()
    assert result.startswith("out.npy: 20 x 24, intensities ")
    assert f"by {TITLES[method]}{counted(history.iterations)}" in result
    assert sensor == f"sensor: {data.sensor!r}"


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("admm-tv", {"weight": 2.5}),
        ("admm-tv", {"norm": "anisotropic"}),
        ("admm-tv", {"tol": 0.05}),
        ("admm-tv", {"weight": 3.0, "norm": "anisotropic", "tol": 0.02, "max_iter": 400}),
        ("mle-iterative", {"tol": 0.01}),
        ("mle-iterative", {"tol": 0.05, "max_iter": 400}),
    ],
)
def test_each_option_reaches_its_method_and_matters(run, bits, tmp_path, method, options):
    words = [word for name, value in options.items() for word in (dashed(name), value)]
    status, said = run("reconstruct", "box.npy", "-o", "out.npy", "-m", method, *words)
    assert status == 0
    picture, history = FUNCTIONS[method](bits["box"], BOX, **options, return_history=True)
    assert_written(tmp_path / "out.npy", picture)
    assert counted(history.iterations) in said
    assert np.abs(picture - FUNCTIONS[method](bits["box"], BOX)).max() > 1e-4


def dashed(name):
    return f"--{name.replace('_', '-')}"


@pytest.mark.filterwarnings("always")
@pytest.mark.parametrize("method", FUNCTIONS)
def test_a_run_that_is_cut_short_warns_and_writes_the_picture_all_the_same(
    run, bits, tmp_path, method
):
    status, said = run("reconstruct", "box.npy", "-o", "out.npy", "-m", method, "--max-iter", 1)
    assert status == 0
    [warning] = [line for line in said.splitlines() if line.startswith("warning: ")]
    assert "not converged after 1 iteration" in warning
    assert f"by {TITLES[method]} (1 iteration, NOT converged" in said
    with pytest.warns(jl.JotlightWarning, match="not converged"):
        picture = FUNCTIONS[method](bits["box"], BOX, max_iter=1)
    assert_written(tmp_path / "out.npy", picture)


@pytest.mark.parametrize("method", FUNCTIONS)
def test_colour_tells_the_iterations_of_the_slowest_channel(run, tmp_path, method):
    data = BOX.expose(jl.datasets.photograph("coffee")[100:116, 180:200], rng=3)
    jl.save(data, tmp_path / "colour.npy")
    status, said = run("reconstruct", "colour.npy", "-o", "out.npy", "-m", method)
    assert status == 0
    picture, histories = FUNCTIONS[method](data, BOX, return_history=True)
    assert_written(tmp_path / "out.npy", picture)
    assert "16 x 20 x 3" in said
    assert counted(max(history.iterations for history in histories)) in said


@pytest.mark.filterwarnings("always")
def test_one_channel_that_is_cut_short_is_enough_to_say_so(run, tmp_path):
    scene = np.zeros((12, 12, 3), np.float32)  # dark channels are done at once
    scene[..., 1] = jl.datasets.photograph("camera")[100:112, 180:192]
    jl.save(BOX.expose(scene, rng=4), tmp_path / "green.npy")
    words = ["reconstruct", "green.npy", "-o", "out.png", "-m", "mle-iterative"]
    status, said = run(*words, "--max-iter", 2)
    assert status == 0
    assert said.count("warning: ") == 1
    assert "(2 iterations, NOT converged" in said


@pytest.mark.parametrize("method", FUNCTIONS)
@pytest.mark.parametrize("data", [["counts.npy"], ["counts.npz", "--key", "ones"]])
def test_counts_serve_the_box_kernel(run, bits, tmp_path, method, data):
    words = ["reconstruct", *data, "-o", "out.npy", "-m", method]
    status, said = run(*words, "--oversampling", 4)
    assert status == 0
    assert "assumed: Sensor(oversampling=4, max_intensity=3.46" in said
    assert_written(tmp_path / "out.npy", FUNCTIONS[method](bits["box"], BOX))


@pytest.mark.parametrize("method", FUNCTIONS)
@pytest.mark.parametrize("ending", ["png", "jpg", "tif"])
def test_pictures_of_every_kind_are_written(run, bits, tmp_path, method, ending):
    assert run("reconstruct", "box.npy", "-o", f"out.{ending}", "-m", method)[0] == 0
    picture = FUNCTIONS[method](bits["box"], BOX)
    within = {"png": 0.5 / 255 + 1e-4, "jpg": 0.2, "tif": 1e-5}[ending]
    np.testing.assert_allclose(read_image(tmp_path / f"out.{ending}"), picture, atol=within)


@pytest.mark.parametrize("option", ["--weight", "--norm", "--tol", "--max-iter"])
def test_an_option_is_refused_for_the_methods_to_which_it_does_not_belong(
    run, bits, tmp_path, option
):
    before = files(tmp_path)
    variation = option in ("--weight", "--norm")
    owners = ["admm-tv"] if variation else FUNCTIONS
    value = {"--norm": "isotropic"}.get(option, 1)
    for method in METHODS.keys() - owners:
        words = ["reconstruct", "box.npy", "-o", "out.png", option, value]
        status, said = run(*words, "-m", method)
        assert status == 1
        name = option[2:].replace("-", "_")
        whose = "admm-tv" if variation else "mle-iterative, admm-tv"
        assert said == f"error: {name}: is an option of {whose}, not of {method}\n"
    assert files(tmp_path) == before


@pytest.mark.parametrize(
    "words", [["--weight", 2], ["--norm", "anisotropic"], ["--tol", 0.002], ["--max-iter", 400]]
)
def test_an_option_of_the_iterative_methods_asks_for_admm(run, bits, words):
    status, said = run("reconstruct", "box.npy", "-o", "out.png", *words)
    assert status == 0
    assert f"by {TITLES['admm-tv']} (" in said


def test_bits_of_a_smooth_kernel_go_to_admm(run, bits, tmp_path):
    status, said = run("reconstruct", "cubic.npy", "-o", "out.npy")
    assert status == 0
    assert "\nby admm-tv: there is no trained network for " in said
    assert f"by {TITLES['admm-tv']} (" in said
    assert_written(tmp_path / "out.npy", jl.admm_tv(bits["cubic"], CUBIC))


@pytest.mark.parametrize("method", FUNCTIONS)
@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--inverse", "inverse: is an option of noniterative-gaussian, .*, not of {}"),
        ("--model", "model: replaces the method; leave out --method {}"),
    ],
)
def test_options_of_other_methods_are_refused_for_the_iterative_ones(
    run, bits, tmp_path, method, option, message
):
    before = files(tmp_path)
    status, said = run("reconstruct", "box.npy", "-o", "out.png", "-m", method, option, "exact")
    assert status == 1
    assert re.fullmatch(f"error: {message.format(method)}\n", said)
    assert files(tmp_path) == before


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["box.npy", "-m", "admm-tv", "--weight", -1], "weight: expected finite numbers, 0 or"),
        (["box.npy", "-m", "admm-tv", "--weight", "nan"], "weight: expected finite"),
        (["box.npy", "-m", "admm-tv", "--weight", "inf"], "weight: expected finite"),
        (["box.npy", "-m", "admm-tv", "--norm", "huber"], "norm: expected one of isotropic, aniso"),
        (["box.npy", "-m", "admm-tv", "--tol", 0], "tol: expected a finite number above 0"),
        (["box.npy", "-m", "mle-iterative", "--tol", 0], "tol: expected a finite number above 0"),
        (["box.npy", "-m", "mle-iterative", "--tol", -1], "tol: expected"),
        (["box.npy", "-m", "mle-iterative", "--tol", "nan"], "tol: expected"),
        (["box.npy", "-m", "admm-tv", "--tol", "inf"], "tol: expected"),
        (["box.npy", "-m", "admm-tv", "--max-iter", 0], "expected 1 or more, got 0"),
        (["box.npy", "-m", "mle-iterative", "--max-iter", -2], "expected 1 or more, got -2"),
        (["box.npy", "-m", "admm-tv", "--threads", 0], "threads: expected"),
        (["box.npy", "-m", "admm"], "expected one of mle, mle-iterative, "),
        (["box.npy", "-m", "admm-tv", "--kernel", "cubic"], "kernel: expected 'box'"),
        (["cubic.npy", "-m", "mle-iterative", "--kernel", "box"], "kernel: expected 'cubic'"),
        (["counts.npy", "-m", "admm-tv"], "--frames"),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_nothing(run, bits, tmp_path, words, expected):
    before = files(tmp_path)
    status, said = run("reconstruct", *words, "-o", "out.png")
    assert status == 1
    [line] = said.splitlines()
    assert line.startswith("error: ")
    assert expected in line
    assert files(tmp_path) == before


@pytest.mark.parametrize("method", FUNCTIONS)
@pytest.mark.parametrize("data", [["counts.npy"], ["counts.npz", "--key", "ones"]])
def test_counts_are_not_enough_for_a_smooth_kernel(run, bits, tmp_path, method, data):
    before = files(tmp_path)
    words = ["reconstruct", *data, "-o", "out.png", "-m", method]
    status, said = run(*words, "-k", 4, "--kernel", "cubic")
    assert status == 1
    [line] = said.splitlines()
    assert line.startswith("error: counts: ")
    assert "cubic kernel" in line
    assert "expected bits" in line
    assert files(tmp_path) == before


@contextlib.contextmanager
def on_a_terminal(folder, *words):
    """Start a command whose messages go to a pseudo-terminal; give it and what it shows."""
    # A shell lets its background jobs ignore SIGINT, and these tests may be one.
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    code += "from jotlight.cli.app import main; main()"
    leader, follower = os.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", code, *map(str, words)],
        cwd=folder,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "120"},
        stdout=subprocess.DEVNULL,
        stderr=follower,
    ) as child:
        os.close(follower)
        try:
            yield child, shown(leader)
        finally:
            child.kill()
            os.close(leader)


def shown(leader):
    """Everything up to now, again and again, until the other end is closed."""
    text = b""
    # CaptureOptions from a pseudo-terminal whose other end is closed fails.
    with contextlib.suppress(OSError):
        while part := os.read(leader, 4096):
            text += part
            yield text.decode(errors="replace")


@pytest.mark.parametrize("method", FUNCTIONS)
def test_on_a_terminal_the_iteration_and_the_residual_are_shown(bits, tmp_path, method):
    words = ["reconstruct", "box.npy", "-o", "out.png", "-m", method, "--tol", 0.002]
    with on_a_terminal(tmp_path, *words) as (child, texts):
        *_, text = texts
        assert child.wait() == 0
    # The last is shown in any case; it is the one that is near enough.
    last = FUNCTIONS[method](bits["box"], BOX, tol=0.002, return_history=True)[1].iterations
    found = re.findall(r"iteration (\d+), residual (\S+) \(to 0\.002\)", text)
    assert int(found[-1][0]) == last
    assert float(found[-1][1]) <= 0.002


def test_ctrl_c_stops_promptly_and_leaves_the_old_picture(tmp_path):
    rng = np.random.default_rng(0)
    np.save(tmp_path / "counts.npy", rng.integers(0, 17, (300, 300)))
    (tmp_path / "out.png").write_bytes(b"of yesterday")
    before = files(tmp_path)
    words = ["reconstruct", "counts.npy", "-o", "out.png", "-m", "admm-tv", "--frames", 16]
    for_ever = ["--tol", 1e-300, "--max-iter", 10**9]
    with on_a_terminal(tmp_path, *words, *for_ever) as (child, texts):
        next(text for text in texts if "iteration" in text)
        child.send_signal(signal.SIGINT)
        *_, text = texts
        assert child.wait(timeout=10) == 130
    assert "stopped" in text
    assert "Traceback" not in text
    assert files(tmp_path) == before


@pytest.fixture
def without_slow_methods(monkeypatch):
    for name in ("noniterative-nlm", "noniterative-bm3d", "noniterative-tv", "network-initial"):
        monkeypatch.delitem(METHODS, name)


def test_compare_leaves_out_what_the_box_kernel_makes_superfluous(run, photo, without_slow_methods):
    status, said = run("compare", photo)
    assert status == 0
    assert TITLES["admm-tv"] in said
    assert TITLES["mle-iterative"] not in said


def test_compare_shows_every_method_that_is_named(run, photo):
    status, said = run("compare", photo, "--methods", "mle,admm-tv,mle-iterative")
    assert status == 0
    scores = dict(re.findall(r"^(.*?) +(\S+) dB", said, re.MULTILINE))
    assert list(scores) == ["maximum likelihood", *TITLES.values()]
    assert scores["maximum likelihood"] == scores[TITLES["mle-iterative"]]
    assert float(scores[TITLES["admm-tv"]]) > float(scores["maximum likelihood"]) + 3


@pytest.mark.filterwarnings("always")
def test_compare_shows_both_for_a_smooth_kernel(run, photo, tmp_path, without_slow_methods):
    status, said = run("compare", photo, "--kernel", "quadratic")
    assert status == 0
    assert all(said.count(title) == 1 for title in TITLES.values())
    assert "not converged" not in said
    assert "photo-compare.png" in files(tmp_path)


@pytest.mark.parametrize("method", FUNCTIONS)
def test_evaluate_writes_the_scores_of_each_picture(run, pictures, tmp_path, method):
    status, said = run("evaluate", pictures, "-m", method, "-o", "scores.csv")
    assert status == 0
    assert f"{TITLES[method]}, 3 images, {BOX!r}" in said
    with (tmp_path / "scores.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["image"] for row in rows] == ["0.png", "1.png", "2.png"]
    result = jl.evaluate(FUNCTIONS[method], read_image_set(pictures)[1], BOX)
    scores = [float(row["psnr_db"]) for row in rows]
    np.testing.assert_allclose(scores, result.values("psnr"), atol=1e-3)


def test_help_lists_the_methods_and_their_options(run):
    for command in ("reconstruct", "compare", "evaluate"):
        said = run(command, "--help")[1]
        assert all(name in said for name in FUNCTIONS)
    said = run("reconstruct", "--help")[1]
    for option in ("--weight", "--norm", "--tol", "--max-iter", "isotropic", "anisotropic"):
        assert option in said
    assert "Iterative methods" in said
