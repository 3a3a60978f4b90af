"""Clusters of processes: lazy arrays, and errors that name the worker."""

import re
import time

import numpy as np
import pytest

import jotlight as jl
from jotlight.errors import error_message
from jotlight.runs.capture_source import CaptureSource
from jotlight.runs.cluster import connected
from jotlight.runs.jobs import VideoJob
from jotlight.runs.running import Cluster
from jotlight.runs.spans import Spans
from jotlight.runs.store import VideoStore
from worker_tasks import read_file

pytestmark = pytest.mark.slow


def test_an_unreadable_file_is_an_error_of_lazy_arrays_and_ends_no_worker(tmp_path):
    path = tmp_path / "capture.npy"
    jl.save(jl.Bits.from_array(np.zeros((400, 8, 8), bool)), path)
    with connected(None, 1) as client:
        counts = jl.dask.count(jl.open(path), 40)
        path.unlink()
        with pytest.raises(FileNotFoundError, match=r"capture\.npy"):
            client.compute(counts.sum()).result(timeout=60)
        assert len(client.nthreads()) == 1


def test_warnings_of_lazy_arrays_reach_the_client():
    bits = jl.Sensor(frames=32, max_intensity=9.0).expose(np.full((32, 32), 4.0), rng=0)
    bits = jl.Bits(bits.packed, 32, jl.Sensor(frames=32))
    video = jl.dask.reconstruct(bits, window=16, method="mle")

    def compute():
        video.compute()
        time.sleep(1)  # until the client gets the message

    with connected(None, 1), pytest.warns(jl.JotlightWarning, match="brighter than the largest"):
        compute()


def test_errors_of_files_name_the_worker(tmp_path):
    store = VideoStore(tmp_path / "a.zarr", {"values": "int32"}, (1, 4, 8), "int32", 1)
    source = CaptureSource(str(tmp_path / "a.npy"))
    job = VideoJob("a", source, Spans(4, 4, 1), 1, None, store)
    with connected(None, 1) as client:
        ((_, _, failure),) = Cluster(client).run(unit for unit in [(0, job, 0)])
        task = client.submit(read_file, tmp_path / "b.npy")
        for error in (failure, task.exception()):
            message = error_message(error)
            assert re.search(r"; on the worker tcp://127\S+, which must see all files", message)
