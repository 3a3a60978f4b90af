"""Counting the ones of a long capture, beside NumPy and reading alone, in one interleaved run.

    python benchmarks/counting.py [--frames 20000]

Writes a photon cube of 256 x 512 jots (16 KiB a frame) to the temporary folder, and counts it once,
so that the file is warm: in the page cache, from where all of them read it. NumPy unpacks and sums
a hundred frames at a time. Reading alone is NumPy's sum of the same bytes as 64-bit words, which is
bound by memory. The most memory that a process takes which opens and counts the file, imports and
all, is measured beside (on Linux).
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight import _engine

ROUNDS, HEIGHT, WIDTH, AT_ONCE = 5, 256, 512, 100
MEMORY = """
import sys
import jotlight as jl

jl.open(sys.argv[1]).counts()
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=20_000)
    frames = parser.parse_args().frames
    if _engine.DEBUG_BUILD:
        raise SystemExit("this is a debug build of jotlight; build it with --release")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cube.npy"
        write(path, frames)
        bits = jl.open(path)
        counts = bits.counts(threads=1)  # which warms the file
        assert all((bits.counts(threads=threads) == counts).all() for threads in (2, 7))
        runs = {
            "jotlight, one thread": lambda: bits.counts(threads=1),
            "jotlight, all threads": lambda: bits.counts(),
            "NumPy, unpack and sum": lambda: unpack_and_sum(bits.packed),
            "reading alone, one thread": lambda: bits.packed.reshape(-1).view(np.uint64).sum(),
        }
        np.testing.assert_array_equal(unpack_and_sum(bits.packed[:1000]), bits[:1000].counts())
        seconds: dict[str, list[float]] = {name: [] for name in runs}
        for _ in range(ROUNDS):
            for name, run in runs.items():
                begun = time.perf_counter()
                run()
                seconds[name].append(time.perf_counter() - begun)
        medians = {name: statistics.median(times) for name, times in seconds.items()}
        size = bits.packed.nbytes
        print(f"| {frames} frames, median of {ROUNDS} | frames/s | GB/s | ratio to NumPy |")
        print("| --- | ---: | ---: | ---: |")
        for name, median in medians.items():
            ratio = medians["NumPy, unpack and sum"] / median
            print(f"| {name} | {frames / median:.0f} | {size / median / 1e9:.2f} | {ratio:.1f} |")
        if sys.platform == "linux":
            command = [sys.executable, "-c", MEMORY, str(path)]
            peak = int(subprocess.run(command, check=True, capture_output=True).stdout) / 1024
            print(f"\n{peak:.0f} MiB at most for a process that counts these {size >> 20} MiB")


def write(path: Path, frames: int) -> None:
    rng = np.random.default_rng(0)
    shape = (frames, HEIGHT, WIDTH // 8)
    cube = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint8, shape=shape)
    for start in range(0, frames, AT_ONCE):
        stop = min(start + AT_ONCE, frames)
        cube[start:stop] = rng.integers(0, 256, (stop - start, *shape[1:]), np.uint8)
    cube.flush()


def unpack_and_sum(packed: np.ndarray) -> np.ndarray:
    total = np.zeros((HEIGHT, WIDTH), np.int64)
    for start in range(0, len(packed), AT_ONCE):
        part = np.unpackbits(packed[start : start + AT_ONCE], axis=2)
        total += part.sum(axis=0, dtype=np.int64)
    return total


if __name__ == "__main__":
    main()
