"""The iterative methods on the command line."""

import re

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.terminal import console
from jotlight.evaluation.methods import METHODS
from jotlight.images.io import read_image

ITERATIVE = {"admm-tv": jl.admm_tv, "mle-iterative": jl.mle_iterative}
TITLES = {name: METHODS[name].title for name in ITERATIVE}
BOX = jl.Sensor(oversampling=4)
CUBIC = jl.Sensor(oversampling=3, frames=2, kernel="cubic")


@pytest.fixture(autouse=True)
def forget_warnings(monkeypatch):
    """Forget the warnings of other tests: a process prints each warning once."""
    monkeypatch.setattr(console, "shown_warnings", set())


@pytest.fixture
def scene():
    return jl.datasets.photograph("camera")[100:120, 180:204]


@pytest.fixture
def bits(scene, tmp_path):
    """Return bits by kernel; save them, and the counts of the box kernel, in files."""
    captures = {"box": BOX.expose(scene, rng=1), "cubic": CUBIC.expose(scene, rng=2)}
    for name, data in captures.items():
        jl.save(data, tmp_path / f"{name}.npy")
    counts = captures["box"].counts()
    np.save(tmp_path / "counts.npy", counts)
    np.savez(tmp_path / "counts.npz", ones=counts, other=counts[:5])
    return captures


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def iterations_text(number):
    return f" ({number} iteration{'s' * (number != 1)}"


def assert_written(path, estimate):
    # The order of the sums depends on the threads.
    np.testing.assert_allclose(np.load(path), estimate, atol=1e-5)


@pytest.mark.parametrize("kernel", ["box", pytest.param("cubic", marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", ITERATIVE)
def test_reconstruct_writes_the_python_result_and_prints_the_iterations(
    run, bits, tmp_path, method, kernel
):
    status, output = run("reconstruct", f"{kernel}.npy", "-o", "out.npy", "-m", method)
    assert status == 0
    data = bits[kernel]
    estimate, history = ITERATIVE[method](data, data.sensor, return_history=True)
    assert_written(tmp_path / "out.npy", estimate)
    # Without a terminal there is no progress bar, only two lines.
    result, sensor = output.splitlines()
    assert result.startswith("out.npy: 20 x 24, intensities ")
    assert f"by {TITLES[method]}{iterations_text(history.iterations)}" in result
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
def test_each_option_changes_the_estimate_as_in_python(run, bits, tmp_path, method, options):
    arguments = [word for name, value in options.items() for word in (dashed(name), value)]
    status, output = run("reconstruct", "box.npy", "-o", "out.npy", "-m", method, *arguments)
    assert status == 0
    estimate, history = ITERATIVE[method](bits["box"], BOX, **options, return_history=True)
    assert_written(tmp_path / "out.npy", estimate)
    assert iterations_text(history.iterations) in output
    assert np.abs(estimate - ITERATIVE[method](bits["box"], BOX)).max() > 1e-4


def dashed(name):
    return f"--{name.replace('_', '-')}"


@pytest.mark.filterwarnings("always")
@pytest.mark.parametrize("method", ITERATIVE)
def test_a_run_that_does_not_converge_warns_and_still_writes_the_estimate(
    run, bits, tmp_path, method
):
    status, output = run("reconstruct", "box.npy", "-o", "out.npy", "-m", method, "--max-iter", 1)
    assert status == 0
    [warning] = [line for line in output.splitlines() if line.startswith("warning: ")]
    assert "not converged after 1 iteration" in warning
    assert f"by {TITLES[method]} (1 iteration, NOT converged" in output
    with pytest.warns(jl.JotlightWarning, match="not converged"):
        estimate = ITERATIVE[method](bits["box"], BOX, max_iter=1)
    assert_written(tmp_path / "out.npy", estimate)


@pytest.mark.parametrize("method", ITERATIVE)
def test_color_prints_the_iterations_of_the_slowest_channel(run, tmp_path, method):
    data = BOX.expose(jl.datasets.photograph("coffee")[100:116, 180:200], rng=3, channel_axis=-1)
    jl.save(data, tmp_path / "color.npy")
    status, output = run("reconstruct", "color.npy", "-o", "out.npy", "-m", method)
    assert status == 0
    estimate, histories = ITERATIVE[method](data, BOX, return_history=True)
    assert_written(tmp_path / "out.npy", estimate)
    assert "16 x 20 x 3" in output
    assert iterations_text(max(history.iterations for history in histories)) in output


@pytest.mark.filterwarnings("always")
def test_a_single_channel_that_does_not_converge_is_reported(run, tmp_path):
    scene = np.zeros((12, 12, 3), np.float32)  # dark channels converge at once
    scene[..., 1] = jl.datasets.photograph("camera")[100:112, 180:192]
    jl.save(BOX.expose(scene, rng=4, channel_axis=-1), tmp_path / "green.npy")
    arguments = ["reconstruct", "green.npy", "-o", "out.png", "-m", "mle-iterative"]
    status, output = run(*arguments, "--max-iter", 2)
    assert status == 0
    assert output.count("warning: ") == 1
    assert "(2 iterations, NOT converged" in output


@pytest.mark.parametrize("method", ITERATIVE)
@pytest.mark.parametrize("data", [["counts.npy"], ["counts.npz", "--key", "ones"]])
def test_counts_are_enough_for_the_box_kernel(run, bits, tmp_path, method, data):
    arguments = ["reconstruct", *data, "-o", "out.npy", "-m", method]
    status, output = run(*arguments, "--oversampling", 4)
    assert status == 0
    assert "assumed: Sensor(oversampling=4, max_intensity=3.46" in output
    assert_written(tmp_path / "out.npy", ITERATIVE[method](bits["box"], BOX))


@pytest.mark.parametrize("method", ITERATIVE)
@pytest.mark.parametrize("ending", ["png", "jpg", "tif"])
def test_every_image_format_is_written(run, bits, tmp_path, method, ending):
    assert run("reconstruct", "box.npy", "-o", f"out.{ending}", "-m", method)[0] == 0
    estimate = ITERATIVE[method](bits["box"], BOX)
    tolerance = {"png": 0.5 / 255 + 1e-4, "jpg": 0.2, "tif": 1e-5}[ending]
    np.testing.assert_allclose(read_image(tmp_path / f"out.{ending}"), estimate, atol=tolerance)


@pytest.mark.parametrize("option", ["--weight", "--norm", "--tol", "--max-iter"])
def test_an_option_is_refused_by_methods_that_do_not_have_it(run, bits, tmp_path, option):
    before = files(tmp_path)
    is_tv_option = option in ("--weight", "--norm")
    owners = ["admm-tv"] if is_tv_option else ITERATIVE
    value = {"--norm": "isotropic"}.get(option, 1)
    for method in METHODS.keys() - owners:
        arguments = ["reconstruct", "box.npy", "-o", "out.png", option, value]
        status, output = run(*arguments, "-m", method)
        assert status == 1
        name = option[2:].replace("-", "_")
        owners_text = "admm-tv" if is_tv_option else "mle-iterative, admm-tv"
        assert output == f"error: {name}: is an option of {owners_text}, not of {method}\n"
    assert files(tmp_path) == before


@pytest.mark.parametrize(
    "arguments", [["--weight", 2], ["--norm", "anisotropic"], ["--tol", 0.002], ["--max-iter", 400]]
)
def test_an_option_of_the_iterative_methods_selects_admm(run, bits, arguments):
    status, output = run("reconstruct", "box.npy", "-o", "out.png", *arguments)
    assert status == 0
    assert f"by {TITLES['admm-tv']} (" in output


@pytest.mark.parametrize("method", ITERATIVE)
@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--inverse", "inverse: is an option of noniterative-gaussian, .*, not of {}"),
        (
            "--model",
            "expected one of --method, --quality, --model, got --method {} and --model exact",
        ),
    ],
)
def test_options_of_other_methods_are_refused_by_the_iterative_ones(
    run, bits, tmp_path, method, option, message
):
    before = files(tmp_path)
    status, output = run("reconstruct", "box.npy", "-o", "out.png", "-m", method, option, "exact")
    assert status == 1
    assert re.fullmatch(f"error: {message.format(method)}\n", output)
    assert files(tmp_path) == before


@pytest.mark.parametrize(
    ("arguments", "expected"),
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
        (["box.npy", "-m", "admm-tv", "--max-iter", 0], "expected at least 1, got 0"),
        (["box.npy", "-m", "mle-iterative", "--max-iter", -2], "expected at least 1, got -2"),
        (["box.npy", "-m", "admm-tv", "--threads", 0], "threads: expected"),
        (["box.npy", "-m", "admm"], "did you mean admm-tv?"),
        (["counts.npy", "-m", "admm-tv"], "--frames"),
    ],
)
def test_bad_input_gets_one_clear_line_and_leaves_no_files(
    run, bits, tmp_path, arguments, expected
):
    before = files(tmp_path)
    status, output = run("reconstruct", *arguments, "-o", "out.png")
    assert status == 1
    [line] = output.splitlines()
    assert line.startswith("error: ")
    assert expected in line
    assert files(tmp_path) == before


@pytest.mark.parametrize("method", ITERATIVE)
@pytest.mark.parametrize("data", [["counts.npy"], ["counts.npz", "--key", "ones"]])
def test_counts_are_not_enough_for_a_smooth_kernel(run, bits, tmp_path, method, data):
    before = files(tmp_path)
    arguments = ["reconstruct", *data, "-o", "out.png", "-m", method]
    status, output = run(*arguments, "-k", 4, "--kernel", "cubic")
    assert status == 1
    [line] = output.splitlines()
    assert line.startswith("error: counts: ")
    assert "cubic kernel" in line
    assert "expected bits" in line
    assert files(tmp_path) == before
