"""Signals that end a command leave nothing behind."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends signals")

NEEDS = {"out.h5": "h5py", "out.zarr": "zarr"}


def started(folder, output, before=""):
    """Start a long conversion in a program of its own, and wait until it writes."""
    words = ["jotlight", "convert", "a.npy", "-o", output]
    words += ["--to", "matlab"] if output == "out" else []
    code = f"{before}; import sys; sys.argv = {words!r}; from jotlight.cli.app import main; main()"
    child = subprocess.Popen(
        [sys.executable, "-c", code], cwd=folder, stderr=subprocess.PIPE, text=True
    )
    end = time.monotonic() + 30
    while len(list(folder.iterdir())) == 1 and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(0.05)
    return child


@pytest.fixture
def long(tmp_path):
    cube = np.random.default_rng(0).integers(0, 256, (8000, 256, 64), np.uint8)
    np.save(tmp_path / "a.npy", cube)
    return tmp_path


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("output", ["out.npy.gz", "out.h5", "out.zarr", "out"])
def test_a_signal_to_end_leaves_nothing_and_says_nothing(long, name, output):
    pytest.importorskip(NEEDS.get(output, "numpy"))
    before = "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL)"
    with started(long, output, before) as child:
        assert child.poll() is None
        child.send_signal(getattr(signal, name))
        child.send_signal(signal.SIGHUP)
        _, said = child.communicate(timeout=30)
    assert child.returncode in {128 + getattr(signal, name), 128 + signal.SIGHUP}
    assert [path.name for path in long.iterdir()] == ["a.npy"]
    assert said.strip() == ""


def test_a_signal_in_a_destructor_is_not_lost():
    code = """
import os, signal, sys, time
from jotlight.cli.signals import exit_on_signals
class Slow:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.2)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
exit_on_signals()
Slow()
time.sleep(20)
"""
    begun = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (143, b"")
    assert time.monotonic() - begun < 15


def test_what_is_to_survive_its_terminal_does(long):
    before = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    with started(long, "out.npy.gz", before) as child:
        child.send_signal(signal.SIGHUP)
        time.sleep(0.3)
        assert child.poll() in (None, 0)
        child.kill()
