"""Compare the counting of camera files with that of a photon cube (`.npy`), per byte.

    python benchmarks/speed/capture_counting.py [--frames 2000] [--rounds 21] [--density 0.1]

The frames have 512 x 512 jots, and the files are in the system's cache. A sparse file has as many
frames as fit into twice the bytes of the cube. All files are counted in turn, round by round, so
all of them meet the same state of the machine. The ratios are medians over the rounds: of the
elapsed time, and of the CPU time of all threads.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl

SIDE = 512
REFERENCE = "npy"
FORMATS = (REFERENCE, "spad512s", "spad512s-sparse", "swissspad2", "swissspad2-full")


def main() -> None:
    """Write the files, count them, and print the table."""
    options = arguments()
    with tempfile.TemporaryDirectory() as folder:
        files = write_files(Path(folder), options.frames, options.density)
        times: dict[str, list[tuple[float, float]]] = {name: [] for name in FORMATS}
        for _ in range(options.rounds + 1):
            for name, path in files.items():
                start, start_cpu = time.perf_counter(), time.process_time()
                jl.open(path, format=name).counts()
                elapsed = time.perf_counter() - start, time.process_time() - start_cpu
                times[name].append(tuple(np.array(elapsed) / path.stat().st_size))
    # The first round also starts the threads.
    costs = {name: np.array(each[1:]) for name, each in times.items()}
    print("| format | GB/s | time per byte, relative to .npy | CPU time, relative |")
    print("| --- | ---: | ---: | ---: |")
    for name, cost in costs.items():
        elapsed, cpu = np.median(cost / costs[REFERENCE], axis=0)
        speed = 1e-9 / np.median(cost[:, 0])
        print(f"| {name} | {speed:.2f} | {elapsed:.2f} | {cpu:.2f} |")


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--density", type=float, default=0.1, help="share of ones")
    return parser.parse_args()


def write_files(folder: Path, frames: int, density: float) -> dict[str, Path]:
    """Return the path of the file of each format, after writing it."""
    rng = np.random.default_rng(0)
    packed = np.concatenate([random_frames(rng, 1, density) for _ in range(frames)])
    bits = jl.Bits(packed)
    # A one takes 32 bits in a sparse file.
    sparse = bits[: max(1, int(frames / (16 * density)))]
    halves = jl.Bits(packed.reshape(2 * frames, SIDE // 2, SIDE // 8))
    files = {}
    for name in FORMATS:
        data = {"spad512s-sparse": sparse, "swissspad2": halves}.get(name, bits)
        files[name] = folder / f"{name}{'.npy' if name == REFERENCE else '.bin'}"
        if name == REFERENCE:
            np.save(files[name], packed)
        else:
            jl.save(data, files[name], format=name)
    return files


def random_frames(rng: np.random.Generator, frames: int, density: float) -> npt.NDArray[np.uint8]:
    """Return packed frames of random bits."""
    return np.packbits(rng.random((frames, SIDE, SIDE), np.float32) < density, axis=2)


if __name__ == "__main__":
    main()
