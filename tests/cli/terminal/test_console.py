"""The output of the commands on a terminal: progress, iterations, and the end by Ctrl-C."""

import re
import signal

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.terminal import console
from jotlight.evaluation.methods import METHODS
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.training import Record
from terminals import on_a_terminal

ITERATIVE = {"admm-tv": jl.admm_tv, "mle-iterative": jl.mle_iterative}
TITLES = {name: METHODS[name].title for name in ITERATIVE}
BOX = jl.Sensor(oversampling=4)


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_names_in_files_cannot_command_the_terminal(run):
    np.savez("a.npz", **{"\x1b[2J": np.ones(2), "\x9b2K": np.ones(2)})
    provenance = Provenance("npy", "\x1b[8mhidden", ("a note\x1b[2J",))
    jl.save(jl.Bits(np.ones((4, 3, 1), np.uint8), provenance=provenance), "b.npy")
    shown = [run("info", "a.npz")[1], run("reconstruct", "a.npz", "-o", "a.tif")[1]]
    shown += [run("info", "b.npy")[1], run("reconstruct", "b.npy", "-o", "b.tif")[1]]
    shown.append(run("info", "\x1b[2Jnone.npy")[1])
    for text in shown:
        assert r"\x1b[" in text
        assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", text)


def test_names_with_brackets_are_printed_as_they_are(run):
    """They are no markup of rich, which raises an error for a closing tag alone."""
    name = "night [dark] [/x]"
    np.savez("a.npz", **{name: np.ones(2), "b": np.ones(2)})
    bits = jl.Bits(np.ones((4, 3, 1), np.uint8), provenance=Provenance("npy", name, (name,)))
    jl.save(bits, "b.npy")
    for path in ("a.npz", "b.npy"):
        status, output = run("info", path)
        assert status == 0
        assert name in output


@pytest.mark.slow
def test_a_long_command_shows_its_progress_on_a_terminal(tmp_path, photo):
    with on_a_terminal(tmp_path, "compare", photo, "-m", "mle,noniterative-nlm") as (child, texts):
        *_, text = texts
        assert child.wait() == 0
    assert "drawing the figure" in text
    assert "%" in text


@pytest.mark.slow
@pytest.mark.parametrize("method", ITERATIVE)
def test_the_iteration_and_the_residual_are_shown_on_a_terminal(tmp_path, method):
    bits = BOX.expose(jl.datasets.photograph("camera")[100:120, 180:204], rng=1)
    jl.save(bits, tmp_path / "box.npy")
    arguments = ["reconstruct", "box.npy", "-o", "out.png", "-m", method, "--tol", 0.002]
    with on_a_terminal(tmp_path, *arguments) as (child, texts):
        *_, text = texts
        assert child.wait() == 0
    # The last iteration is always shown. Its residual is within the tolerance.
    last = ITERATIVE[method](bits, BOX, tol=0.002, return_history=True)[1].iterations
    found = re.findall(r"iteration (\d+), residual (\S+) \(to 0\.002\)", text)
    assert int(found[-1][0]) == last
    assert float(found[-1][1]) <= 0.002


@pytest.mark.slow
def test_ctrl_c_stops_promptly_and_leaves_the_old_image(tmp_path):
    rng = np.random.default_rng(0)
    np.save(tmp_path / "counts.npy", rng.integers(0, 17, (300, 300)))
    (tmp_path / "out.png").write_bytes(b"an older image")
    before = files(tmp_path)
    arguments = ["reconstruct", "counts.npy", "-o", "out.png", "-m", "admm-tv", "--frames", 16]
    endless = ["--tol", 1e-300, "--max-iter", 10**9]
    with on_a_terminal(tmp_path, *arguments, *endless) as (child, texts):
        next(text for text in texts if "iteration" in text)
        child.send_signal(signal.SIGINT)
        *_, text = texts
        assert child.wait(timeout=10) == 130
    assert "stopped" in text
    assert "Traceback" not in text
    assert files(tmp_path) == before


@pytest.mark.parametrize("seconds_per_step", [1, 90])
def test_a_training_prints_ten_lines_and_one_each_minute(monkeypatch, capsys, seconds_per_step):
    show = console.print_steps("training", 40)
    now = console.time.monotonic()
    for step in range(41):
        moment = now + step * seconds_per_step
        monkeypatch.setattr(console.time, "monotonic", lambda moment=moment: moment)
        show(Record(step, 1.0, 1.0, None))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "training"
    assert len(lines) == 1 + (11 if seconds_per_step == 1 else 41)
