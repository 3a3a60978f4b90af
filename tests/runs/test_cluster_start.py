"""Workers that die while a cluster of processes starts."""

import multiprocessing
import os
import signal
import threading
import time

import numpy as np
import pytest

import jotlight as jl
from jotlight.cli.app import run
from jotlight.runs.cluster import connected

pytestmark = pytest.mark.slow
exhaustive = pytest.mark.exhaustive


def test_a_worker_that_ends_while_the_cluster_starts_is_one_line(tmp_path, capsys):
    def kill_the_first():
        while not (children := multiprocessing.active_children()):
            time.sleep(0.01)
        os.kill(children[0].pid, signal.SIGKILL)

    jl.save(jl.Bits.from_array(np.zeros((80, 8, 8), bool)), tmp_path / "capture.npy")
    thread = threading.Thread(target=kill_the_first)
    thread.start()
    output = str(tmp_path / "video.zarr")
    assert (
        run(
            [
                "reconstruct",
                str(tmp_path / "capture.npy"),
                "-o",
                output,
                "--window",
                "40",
                "--workers",
                "2",
            ]
        )
        == 1
    )
    thread.join()
    error = " ".join(capsys.readouterr().err.split())
    assert "error: workers: one of 2 ended while it started" in error
    assert not multiprocessing.active_children()


@exhaustive
def test_workers_that_die_while_they_start_are_replaced():
    with connected(None, 2) as client:
        for _ in range(8):
            for process in multiprocessing.active_children():
                os.kill(process.pid, signal.SIGKILL)
            time.sleep(0.3)
        assert client.submit(lambda: 42).result(timeout=100) == 42
