"""Runs on clusters of processes: the same bytes everywhere, deaths of workers, and bad input."""

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time

import dask
import distributed
import numpy as np
import pytest

import jotlight as jl
from jotlight._engine import __version__
from jotlight.cli.app import run
from jotlight.runs.cluster import check_workers, connected
from jotlight.runs.running import compute_unit

pytestmark = pytest.mark.slow
exhaustive = pytest.mark.exhaustive

WINDOW = ("--window", "40", "--step", "30", "-m", "mle")


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    path = tmp_path_factory.mktemp("capture") / "capture.npy"
    rng = np.random.default_rng(0)
    bits = jl.Bits.from_array(rng.random((1500, 64, 96)) < 0.3, jl.Sensor(frames=1500))
    jl.save(bits, path)
    return path


def content(folder):
    """Return the bytes of all files of a folder by name."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def expected(capture, tmp_path_factory):
    output = tmp_path_factory.mktemp("expected") / "video.zarr"
    assert run(["reconstruct", str(capture), "-o", str(output), *WINDOW]) == 0
    return content(output)


@pytest.mark.parametrize(
    "options",
    [
        pytest.param(("--workers", "1"), marks=exhaustive),
        pytest.param(("--workers", "2"), marks=exhaustive),
        pytest.param(("--workers", "4"), marks=exhaustive),
        ("--chunks", "64KiB"),
        ("--chunks", "1MiB"),
        ("--chunks", "1GiB"),
        ("--threads", "1"),
        ("--workers", "2", "--chunks", "64KiB"),
    ],
)
def test_the_bytes_do_not_depend_on_workers_and_chunks(capture, expected, options, tmp_path):
    output = tmp_path / "video.zarr"
    assert run(["reconstruct", str(capture), "-o", str(output), *WINDOW, *options]) == 0
    assert content(output) == expected


@pytest.mark.parametrize("total", [3, pytest.param(64, marks=exhaustive)])
def test_the_bytes_do_not_depend_on_parts(capture, expected, total, tmp_path):
    output = tmp_path / "video.zarr"
    base = ["reconstruct", str(capture), "-o", str(output), *WINDOW, "--chunks", "64KiB"]
    for number in range(1, total + 1):
        assert not output.exists()
        assert run([*base, "--part", f"{number}/{total}"]) == 0
    assert run(["gather", str(tmp_path)]) == 0
    assert content(output) == expected


@pytest.mark.parametrize(
    "scheduler", ["sync", "threads", pytest.param("processes", marks=exhaustive)]
)
def test_lazy_videos_do_not_depend_on_the_scheduler(capture, expected, scheduler):
    bits = jl.open(capture)
    video = jl.dask.reconstruct(bits, window=40, step=30, method="mle")
    with dask.config.set(scheduler=scheduler):
        images = video.compute()
    assert images[3].tobytes() == expected["c.3.0.0"][:-4]


@pytest.mark.parametrize(
    "workers", [pytest.param(1, marks=exhaustive), 2, pytest.param(4, marks=exhaustive)]
)
def test_lazy_videos_do_not_depend_on_the_number_of_workers(capture, expected, workers):
    bits = jl.open(capture)
    with connected(None, workers):
        video = jl.dask.reconstruct(
            bits.to_dask("128KiB"), bits.sensor, 40, 30, method="mle", width=96
        )
        images = video.compute()
    assert [image.tobytes() for image in images] == [
        expected[f"c.{index}.0.0"][:-4] for index in range(len(images))
    ]


def test_a_worker_that_is_killed_is_replaced(capture, expected, tmp_path, monkeypatch):
    from jotlight.runs import running

    output, deaths = tmp_path / "video.zarr", []
    submit = running.Cluster._take

    def take(self, completed, tasks):
        if len(deaths) < 2:
            pids = list(self.client.run(os.getpid).values())
            os.kill(random.choice(pids), signal.SIGKILL)
            deaths.append(1)
        yield from submit(self, completed, tasks)

    monkeypatch.setattr(running.Cluster, "_take", take)
    options = ("--workers", "2", "--chunks", "64KiB")
    assert run(["reconstruct", str(capture), "-o", str(output), *WINDOW, *options]) == 0
    assert len(deaths) == 2
    assert content(output) == expected


SLOW = """
import time
from jotlight.cli.app import main
from jotlight.runs.store import VideoStore

mark = VideoStore.mark

def mark_slowly(*arguments):
    mark(*arguments)
    time.sleep(0.1)

VideoStore.mark = mark_slowly
main()
"""
"""A command whose groups take a while, so that a busy machine does not miss the time to kill it."""


def test_a_run_that_is_killed_continues(capture, expected, tmp_path):
    output = tmp_path / "video.zarr"
    command = ["reconstruct", str(capture), "-o", str(output)]
    command += [*WINDOW, "--chunks", "16KiB", "--threads", "1"]
    groups = output.with_name("video.zarr.part") / "groups"
    for kills in (2, 9):
        process = subprocess.Popen([sys.executable, "-c", SLOW, *command])
        while process.poll() is None and len(list(groups.glob("*.json"))) < kills:
            time.sleep(0.001)
        process.kill()
        process.wait()
    assert not output.exists()
    before = {path: path.stat().st_mtime_ns for path in groups.glob("*.json")}
    assert before
    assert run(command) == 0
    assert content(output) == expected


def test_a_damaged_capture_is_reported_at_the_end(capture, expected, tmp_path, capsys):
    folder = tmp_path / "captures"
    folder.mkdir()
    for name in ("a", "c"):
        (folder / f"{name}.npy").hardlink_to(capture)
        (folder / f"{name}.json").hardlink_to(capture.with_suffix(".json"))
    (folder / "b.npy").write_bytes(capture.read_bytes()[:1000])
    command = ["reconstruct", f"{folder}/*.npy", "-o", f"{tmp_path}/{{name}}.zarr", *WINDOW]
    assert run([*command, "--workers", "2"]) == 1
    assert "1 of 3 captures failed: b: " in capsys.readouterr().err
    for name in ("a", "c"):
        images = content(tmp_path / f"{name}.zarr")
        assert {key: value for key, value in images.items() if key != "zarr.json"} == {
            key: value for key, value in expected.items() if key != "zarr.json"
        }


@exhaustive
def test_an_address_where_nothing_listens(capture, tmp_path, capsys):
    output = tmp_path / "video.zarr"
    address = ("--scheduler", "tcp://127.0.0.1:9")
    assert run(["reconstruct", str(capture), "-o", str(output), *WINDOW, *address]) == 1
    assert "no scheduler of dask answers at tcp://127.0.0.1:9" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_worker_with_another_version():
    class Client:
        def nthreads(self):
            return {"tcp://a": 1, "tcp://b": 1}

        def run(self, function, on_error):
            return {"tcp://a": function(), "tcp://b": ("0.0.1", [])}

    with pytest.raises(ValueError, match=r"1 have another one, such as 0.0.1 on tcp://b"):
        check_workers(Client())


def test_a_worker_without_a_package_that_units_need(monkeypatch):
    class Client:
        def nthreads(self):
            return {"tcp://a": 1, "tcp://b": 1}

        def run(self, function, on_error):
            with monkeypatch.context() as on_b:
                on_b.setitem(sys.modules, "fsspec", None)
                return {"tcp://b": function(), "tcp://a": (__version__, [])}

    text = r"1 have not .*; fsspec \(import of fsspec halted.*\) cannot be imported on tcp://b"
    with pytest.raises(ValueError, match=text):
        check_workers(Client())


def _wait_for_address(file):
    """Return the address of a scheduler from its file, when it has written all of it."""
    deadline = time.monotonic() + 60
    while True:
        try:
            return json.loads(file.read_text())["address"]
        except (FileNotFoundError, ValueError):
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)


@contextlib.contextmanager
def scheduler_with_workers(folder, *preloads):
    """Yield the address of a scheduler with a worker process for each preloaded module."""
    file = folder / "scheduler.json"
    command = [sys.executable, "-m", "distributed.cli.dask_"]
    starts = [("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")]
    for preload in preloads:
        options = ("--preload", str(preload)) if preload else ()
        starts.append(("worker", "--nthreads", "1", "--no-nanny", "--no-dashboard", *options))
    with contextlib.ExitStack() as stack:
        for kind, *options in starts:
            process = subprocess.Popen(
                [*command[:2], command[2] + kind, "--scheduler-file", str(file), *options],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                cwd=folder,
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
        address = _wait_for_address(file)
        with distributed.Client(address) as client:
            client.wait_for_workers(len(preloads), timeout=60)
        yield address


def test_a_worker_process_with_another_version_is_refused_before_work(capture, tmp_path, capsys):
    preload = tmp_path / "older.py"
    preload.write_text("import jotlight._engine\njotlight._engine.__version__ = '0.0.1'\n")
    output = tmp_path / "video.zarr"
    command = ["reconstruct", str(capture), "-o", str(output), *WINDOW]
    with scheduler_with_workers(tmp_path, None, preload) as address:
        assert run([*command, "--scheduler", address]) == 1
    error = " ".join(capsys.readouterr().err.split())
    assert (
        f"expected jotlight {__version__} on all 2, but 1 have another one, such as 0.0.1" in error
    )
    assert "install the same version everywhere" in error
    assert list(tmp_path.glob("video*")) == []


@exhaustive
def test_a_worker_process_without_jotlight_is_refused_before_work(capture, tmp_path, capsys):
    preload = tmp_path / "missing.py"
    preload.write_text(
        "import sys\nsys.modules['jotlight'] = sys.modules['jotlight.dask'] = None\n"
    )
    output = tmp_path / "video.zarr"
    command = ["reconstruct", str(capture), "-o", str(output), *WINDOW]
    with scheduler_with_workers(tmp_path, preload) as address:
        assert run([*command, "--scheduler", address]) == 1
    error = " ".join(capsys.readouterr().err.split())
    assert "1 have another one, such as none that can be imported" in error
    assert list(tmp_path.glob("video*")) == []


@exhaustive
def test_a_worker_with_another_version_that_joins_later_computes_nothing(tmp_path):
    preload = tmp_path / "older.py"
    preload.write_text("import jotlight._engine\njotlight._engine.__version__ = '0.0.1'\n")
    with (
        scheduler_with_workers(tmp_path, preload) as address,
        distributed.Client(address) as client,
    ):
        task = client.submit(compute_unit, None, 0, __version__)
        with pytest.raises(RuntimeError, match=f"expected jotlight {__version__} .* got 0.0.1"):
            task.result(timeout=60)


def test_the_command_runs_on_a_scheduler_whose_workers_are_in_another_folder(
    capture, expected, tmp_path, capsys, monkeypatch
):
    with connected(None, 2) as client:
        monkeypatch.chdir(tmp_path)
        address = ("--scheduler", client.scheduler.address)
        assert run(["reconstruct", str(capture), "-o", "video.zarr", *WINDOW, *address]) == 0
    assert "dashboard of dask: http" in capsys.readouterr().out
    assert content(tmp_path / "video.zarr") == expected


def test_warnings_of_workers_are_issued_by_the_command(tmp_path, capfd):
    mask = np.zeros((8, 9), bool)
    mask[3, 4] = True
    frames = np.random.default_rng(0).random((32, 8, 9)) < 0.3
    jl.save(jl.Bits.from_array(frames, jl.Sensor(frames=32, mask=mask)), tmp_path / "a.npy")
    command = ["reconstruct", str(tmp_path / "a.npy"), "-o", str(tmp_path / "a.zarr"), "-m", "mle"]
    with pytest.warns(jl.JotlightWarning, match="1 of 72 pixels have no valid bit"):
        assert run([*command, "--window", "16", "--workers", "1"]) == 0
    assert "no valid bit" not in "".join(capfd.readouterr())
