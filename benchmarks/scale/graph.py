"""The graph of a run for collections of growing size: tasks, bytes, memory, and the scheduler.

    python benchmarks/scale/graph.py [--tasks 1000000]

First, the script computes the number of tasks of a run from the size of the collection, and lists
the tasks of a lazy array of 8 TiB, whose file is sparse. Then it runs a scheduler of dask with
workers that do nothing, and submits as many tasks as the largest run has, in the way that a run
does. It prints the seconds per task, and the memory of the scheduler.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

import dask
from timing import make_capture

import jotlight as jl
from jotlight.runs.jobs import CaptureSource, VideoJob
from jotlight.runs.running import Cluster
from jotlight.runs.spans import Spans
from jotlight.runs.store import VideoStore

GIB = 1 << 30
FRAME_BYTES = 512 * 64
CHUNK, MAX_GROUPS = 1 << 27, 1024
GROUPS = 5
"""Units of a capture of 655 MB. Another task holds the job."""

THREADS = 64
"""Threads of the cluster. A run submits four tasks per thread ahead of time."""


def tasks_of(captures, size):
    """Return the tasks of a run over equal captures: their groups, and one for each job."""
    group = max(CHUNK, size // MAX_GROUPS)
    return captures * (1 + -(-size // group))


class NoWork(VideoJob):
    """A job of real size whose units do nothing."""

    def compute(self, unit, threads, mapped):
        """Do nothing."""


def make_job(number, groups):
    """Return a job as `jotlight reconstruct` makes it, with this number of groups."""
    run = {"values": "float32", "capture": f"scene{number}", "method": "mle", "x": "0" * 1500}
    store = VideoStore(f"v{number}.zarr", run, (groups, 512, 512), "float32", 1)
    spans = Spans(4096, 4096, groups)
    return NoWork(f"scene{number}", CaptureSource("/x.npy"), spans, 1, None, store)


def list_lazy_tasks():
    """Print the CPU time in which a scheduler lists the tasks of a lazy array.

    The other way is `map_blocks`, with a function that gets the place of its block.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "capture.npy"
        make_capture(path, 8 * 1024 * GIB // FRAME_BYTES, sparse=True)
        bits = jl.open(path, counts=False)
        arrays = {
            "jl.dask.count": jl.dask.count(bits, 4096),
            "map_blocks": bits.to_dask("1GiB").map_blocks(count_block, dtype="i4"),
        }
        for name, images in arrays.items():
            start = time.process_time()
            (listed,) = dask.optimize(images)
            tasks = len(dict(listed.dask))
            each = 1e6 * (time.process_time() - start) / tasks
            print(f"lazy array of 8 TiB by {name}: {tasks} tasks, {each:.0f} CPU µs per task")


def count_block(block, block_info=None):
    """Do nothing. The tasks of this function are listed, but not run."""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", type=int, default=1_000_000)
    options = parser.parse_args()
    print("captures x size: tasks, bytes per task")
    for captures, size in (
        (10_532, 655_360_000),
        (1, 7 * 1024 * GIB),
        (100, 7 * 1024 * GIB),
        (10**6 // 6, 655_360_000),
        (1000, 1024 * GIB),
    ):
        tasks = tasks_of(captures, size)
        total = captures * size
        each = total / tasks / 2**20
        print(f"{captures:7} x {size / GIB:9.2f} GiB: {tasks:8} tasks, {each:8.0f} MiB")

    list_lazy_tasks()

    from distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=1, threads_per_worker=THREADS, processes=False, dashboard_address=None
        ) as cluster,
        Client(cluster) as client,
    ):

        def units():
            for number in range(options.tasks // (GROUPS + 1)):
                job = make_job(number, GROUPS)
                for unit in range(GROUPS):
                    yield number, job, unit

        shown = [10**exponent for exponent in range(3, 10)] + [options.tasks]
        start = time.perf_counter()
        for units_done, (_, _, error) in enumerate(Cluster(client).run(units()), 1):
            assert error is None, error
            done = units_done + units_done // GROUPS  # each job is a task, too
            if done >= shown[0] or done == options.tasks // (GROUPS + 1) * (GROUPS + 1):
                shown.pop(0)
                seconds, cpu = time.perf_counter() - start, time.process_time()
                memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
                times = f"{1000 * seconds / done:.2f} ms, {1000 * cpu / done:.2f} CPU ms"
                print(
                    f"{done:8} tasks in {seconds:.0f} s: {times} per task; scheduler, client, and "
                    f"worker together take at most {memory:.0f} MiB",
                    flush=True,
                )


if __name__ == "__main__":
    main()
