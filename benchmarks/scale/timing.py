"""Captures for measurements, and the times and the memory of processes and of workers."""

import multiprocessing
import os
import time
from pathlib import Path

import numpy as np

GIB = 1 << 30
FRAME = 512, 64
FRAME_BYTES = 512 * 64
_IDLE_SECONDS = 0.5


def make_capture(path, frames, sparse=False):
    """Write a photon cube of random bits, or a sparse one of zeros."""
    header = {"descr": "|u1", "fortran_order": False, "shape": (frames, *FRAME)}
    block = np.random.default_rng(0).integers(0, 256, (4096, *FRAME), np.uint8)
    with path.open("wb", buffering=0) as file:
        np.lib.format.write_array_header_1_0(file, header)
        if sparse:
            file.truncate(file.tell() + frames * FRAME_BYTES)
            return
        for start in range(0, frames, len(block)):
            file.write(block[: frames - start].data)
        os.fsync(file.fileno())


def drop_from_cache(path):
    """Remove a file from the page cache."""
    handle = os.open(path, os.O_RDONLY)
    os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(handle)


def warm_memory():
    """Write and free 1 GiB of memory before a measurement.

    A virtual machine returns free memory to its host within seconds, and needs time to get it
    again. After this call, it has it.
    """
    np.ones(1 << 27, np.int64)


def in_processes(target, arguments, prepare=lambda: None):
    """Return the time of the slowest of some processes that begin together, and their CPU time.

    `prepare` is called right before they begin.
    """
    context = multiprocessing.get_context("spawn")
    ready, times = context.Barrier(len(arguments) + 1), context.Queue()
    processes = [context.Process(target=target, args=(*each, ready, times)) for each in arguments]
    for process in processes:
        process.start()
    ready.wait()
    prepare()
    ready.wait()
    found = [times.get() for _ in processes]
    for process in processes:
        process.join()
    return max(seconds for seconds, _ in found), sum(cpu for _, cpu in found)


def wait_twice(ready):
    """Wait until all processes have begun, and until the comparison is prepared."""
    ready.wait()
    ready.wait()


def on_workers(client, function, prepare=lambda: None):
    """Return the seconds that a function takes, and the CPU time of the workers for it.

    `prepare` is called right before.
    """
    per_second = cpu_of_workers(client, lambda: time.sleep(_IDLE_SECONDS))[1] / _IDLE_SECONDS
    prepare()
    seconds, cpu = cpu_of_workers(client, function)
    # On a busy machine, the workers wait for long, and the ticks of their event loops add up.
    return seconds, cpu - per_second * seconds


def cpu_of_workers(client, function):
    before = sum(client.run(time.process_time).values())
    seconds = timed(function)
    return seconds, sum(client.run(time.process_time).values()) - before


def timed(function):
    """Return the seconds that a function takes."""
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def cpu_time(function):
    """Return the CPU time that a function takes in this process."""
    start = time.process_time()
    function()
    return time.process_time() - start


def peak_memory():
    """Return the peak of the resident memory of this process in MiB, and its part not in files."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return {name: int(status[name].split()[0]) // 1024 for name in ("VmHWM", "RssAnon", "RssFile")}
