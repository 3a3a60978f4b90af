"""A command that is ended by a signal leaves no files."""

import contextlib
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import jotlight as jl
from folders import file_names

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sends signals")

NEEDS = {"out.h5": "h5py", "out.zarr": "zarr"}


def start_conversion(folder, target, before=""):
    """Start a long conversion in another process and wait until it writes."""
    arguments = ["jotlight", "convert", "a.npy", "-o", target]
    arguments += ["--to", "matlab"] if target == "out" else []
    code = (
        f"{before}; import sys; sys.argv = {arguments!r}; from jotlight.cli.app import main; main()"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code], cwd=folder, stderr=subprocess.PIPE, text=True
    )
    end = time.monotonic() + 30
    while len(list(folder.iterdir())) == 1 and time.monotonic() < end:
        time.sleep(0.01)
    time.sleep(0.05)
    return child


@pytest.fixture(scope="module")
def large_file(tmp_path_factory):
    """Return a file of 131 MB that compresses badly."""
    path = tmp_path_factory.mktemp("large") / "a.npy"
    np.save(path, np.random.default_rng(0).integers(0, 256, (8000, 256, 64), np.uint8))
    return path


@pytest.fixture
def large_capture(large_file, tmp_path):
    """Return an own folder with the file."""
    os.link(large_file, tmp_path / "a.npy")
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "target"),
    [
        ("SIGTERM", "out.npy.gz"),
        ("SIGTERM", "out.h5"),
        ("SIGHUP", "out.zarr"),
        ("SIGHUP", "out"),
        pytest.param("SIGHUP", "out.npy.gz", marks=pytest.mark.exhaustive),
        pytest.param("SIGHUP", "out.h5", marks=pytest.mark.exhaustive),
        pytest.param("SIGTERM", "out.zarr", marks=pytest.mark.exhaustive),
        pytest.param("SIGTERM", "out", marks=pytest.mark.exhaustive),
    ],
)
def test_a_signal_ends_a_command_silently_and_leaves_no_files(large_capture, name, target):
    pytest.importorskip(NEEDS.get(target, "numpy"))
    before = "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL)"
    with start_conversion(large_capture, target, before) as child:
        assert child.poll() is None
        child.send_signal(getattr(signal, name))
        child.send_signal(signal.SIGHUP)
        _, output = child.communicate(timeout=30)
    assert child.returncode in {128 + getattr(signal, name), 128 + signal.SIGHUP}
    assert [path.name for path in large_capture.iterdir()] == ["a.npy"]
    assert output.strip() == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stop", "status"),
    [("raise KeyboardInterrupt", 130), ("signal.raise_signal(signal.SIGTERM)", 143)],
)
def test_a_stopped_process_does_not_wait_for_its_threads(stop, status):
    code = f"""
import atexit, signal, threading, time
from jotlight.cli import app
atexit.register(print, "Python ended, while a thread still ran")
def command(*arguments, **options):
    print("some output")
    threading.Thread(target=time.sleep, args=[30]).start()
    {stop}
app.app = command
app.main()
"""
    start = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (status, "some output\n")
    assert time.monotonic() - start < 25


def test_a_signal_in_a_destructor_is_not_lost():
    code = """
import os, signal, sys, time
from jotlight.cli.terminal.signals import exit_on_signals
class Slow:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.2)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
exit_on_signals()
Slow()
time.sleep(20)
"""
    start = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (143, b"")
    assert time.monotonic() - start < 15


@pytest.mark.slow
def test_a_command_that_ignores_sighup_survives_it(large_capture):
    before = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    with start_conversion(large_capture, "out.npy.gz", before) as child:
        child.send_signal(signal.SIGHUP)
        time.sleep(0.3)
        assert child.poll() in (None, 0)
        child.kill()


LONG = ["simulate", "large.npy", "-o", "bits.npy", "-k", "16", "-t", "40"]


@contextlib.contextmanager
def long_command(folder):
    """Start a command of many seconds and wait until it has temporary files."""
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
            while len(file_names(folder)) < 3 and time.monotonic() < deadline:
                time.sleep(0.05)
            assert len(file_names(folder)) >= 3, "the command wrote no temporary files"
            time.sleep(0.3)
            yield child
        finally:
            child.kill()


@pytest.mark.slow
def test_ctrl_c_stops_promptly_and_leaves_no_files(tmp_path):
    with long_command(tmp_path) as child:
        child.send_signal(signal.SIGINT)
        _, output = child.communicate(timeout=20)
    assert child.returncode == 130
    assert "stopped" in output
    assert file_names(tmp_path) == ["large.npy"]


@pytest.mark.slow
def test_a_terminated_command_leaves_no_files(tmp_path):
    with long_command(tmp_path) as child:
        child.terminate()
        assert child.wait(timeout=20) == 143
    assert file_names(tmp_path) == ["large.npy"]


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [1.0, 2.0, 3.5])
def test_ctrl_c_ends_a_command_and_its_workers_in_one_line(tmp_path, seconds):
    """Python itself, which has no handler yet, takes a while to start on a busy machine."""
    pytest.importorskip("distributed")
    sensor = jl.Sensor(frames=40_000)
    jl.save(sensor.expose(np.full((64, 64), 0.5), rng=0), tmp_path / "a.npy")
    arguments = ["reconstruct", "a.npy", "-o", "{name}.zarr", "--window", "2", "--workers", "2"]
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler);"
    code += "from jotlight.cli.entry import main; print('begun', flush=True); main()"
    with subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as child:
        assert child.stdout.readline() == "begun\n"
        time.sleep(seconds)
        os.killpg(child.pid, signal.SIGINT)  # as a terminal does
        _, output = child.communicate(timeout=60)
    assert (child.returncode, output) == (130, "error: stopped\n")


IMPORTING = """
import importlib.abc, os, signal, sys
class Stop(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "jotlight.cli.app":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Stop())
sys.argv = ["jotlight", "--version"]
signal.signal(signal.SIGINT, {handler})
from jotlight.cli.entry import main
main()
"""


@pytest.mark.parametrize(
    ("handler", "status", "expected"),
    [
        ("signal.default_int_handler", 130, "error: stopped\n"),
        pytest.param("signal.SIG_IGN", 0, "", marks=pytest.mark.slow),
    ],
)
def test_ctrl_c_during_the_imports_ends_the_command_in_one_line(handler, status, expected):
    code = IMPORTING.replace("{handler}", handler)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (status, expected)
    assert done.stdout.startswith("jotlight ") == (status == 0)


def test_ctrl_c_raises_again_after_the_imports():
    code = """
import signal, sys
import jotlight.cli.app as app
from jotlight.cli.entry import main
signal.signal(signal.SIGINT, signal.default_int_handler)
app.app = lambda *arguments, **options: signal.raise_signal(signal.SIGINT)
main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "error: stopped\n")
