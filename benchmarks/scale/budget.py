"""The CPU time and the page faults of ways to count a file in the page cache, without a cluster.

    python benchmarks/scale/budget.py --folder FOLDER

All ways count 1024 frames per image in one thread, in turns. The script prints the least CPU time
of some rounds for each way, in milliseconds per GiB. The mapped file with one call of the engine
per window is the bare counting of `measure.py speed`.
"""

import argparse
import mmap
import os
import resource
from pathlib import Path

import numpy as np
from timing import FRAME, FRAME_BYTES, GIB, make_capture

import jotlight as jl
from jotlight.runs.chunk_counting import add_counts

WINDOW = 1024
FRAMES = GIB // FRAME_BYTES
HEADER = 128
"""Number of bytes before the frames of a .npy file."""


def count(frames):
    """Count the frames, each window in one call of the engine."""
    for start in range(0, len(frames), WINDOW):
        counts = np.zeros((512, 512), np.int32)
        add_counts(frames[start : start + WINDOW], 512, 1, counts, threads=1)


def count_bare(frames):
    """Count the frames as a user does who has them in memory."""
    for start in range(0, len(frames), WINDOW):
        jl.Bits(frames[start : start + WINDOW]).counts(1, threads=1)


def count_mapped(path, advice=None, flags=mmap.MAP_SHARED, frames=4096):
    """Count parts of a mapped file."""
    with path.open("rb") as file:
        for start in range(0, FRAMES, frames):
            size, offset = frames * FRAME_BYTES, start * FRAME_BYTES
            part = mmap.mmap(file.fileno(), HEADER + size, flags, mmap.PROT_READ, offset=offset)
            if advice is not None:
                part.madvise(advice)
            count(np.frombuffer(part, np.uint8, size, HEADER).reshape(-1, *FRAME))


def read_parts(path, frames, counts=None):
    """Read a file part by part into the same memory, and count each part if there are counts."""
    part = np.empty((frames, *FRAME), np.uint8)
    with path.open("rb", buffering=0) as file:
        for start in range(0, FRAMES, frames):
            os.preadv(file.fileno(), [part], HEADER + start * FRAME_BYTES)
            if counts is not None:
                add_counts(part, 512, 1, counts, threads=1)


def ways(path):
    """Return functions by name."""
    data = np.random.default_rng(0).integers(0, 256, (FRAMES, *FRAME), np.uint8)
    # The windows of 1024 frames of this view are the same 96 KiB.
    cached = np.lib.stride_tricks.as_strided(data, (WINDOW, *FRAME), (64, 64, 1))
    populate = mmap.MAP_SHARED | mmap.MAP_POPULATE
    found = {
        "in memory, Bits.counts": lambda: count_bare(data),
        "in memory, windows in one call": lambda: count(data),
        "in the processor's cache": lambda: [count(cached) for _ in range(FRAMES // WINDOW)],
        "mapped": lambda: count_mapped(path),
        "mapped, MAP_POPULATE": lambda: count_mapped(path, flags=populate),
        "mapped, MADV_SEQUENTIAL": lambda: count_mapped(path, mmap.MADV_SEQUENTIAL),
        "mapped, MADV_HUGEPAGE": lambda: count_mapped(path, mmap.MADV_HUGEPAGE),
        "read 1 MiB, not counted": lambda: read_parts(path, 32),
    }
    for frames in (32, 128):
        found[f"read {frames // 32} MiB, and count it"] = lambda frames=frames: read_parts(
            path, frames, np.zeros((512, 512), np.int32)
        )
    return found


def cost(function):
    """Return the user time, the system time, and the page faults of a call."""
    before = resource.getrusage(resource.RUSAGE_SELF)
    function()
    after = resource.getrusage(resource.RUSAGE_SELF)
    return [getattr(after, n) - getattr(before, n) for n in ("ru_utime", "ru_stime", "ru_minflt")]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    path = options.folder / "capture.npy"
    make_capture(path, FRAMES)
    functions = ways(path)
    found = {name: [] for name in functions}
    for _ in range(options.rounds):
        for name, function in functions.items():
            found[name].append(cost(function))
    for name, costs in found.items():
        user, system, faults = min(costs, key=lambda each: each[0] + each[1])
        total = 1000 * (user + system)
        print(f"{name:32} {total:5.0f} ms per GiB, {1000 * system:4.0f} in the system", end="")
        print(f", {faults} page faults")
    path.unlink()


if __name__ == "__main__":
    main()
