"""Measure how long a training step takes, by precision and by the size of patches.

    python benchmarks/studies/training_speed.py [--repetitions 10] [--threads 1]

It prints CPU time per pixel in microseconds: of drawing patches and bits, and of a pass forward and
back in float32 and in bfloat16. The smallest of all repetitions counts. It needs the extra `torch`.
"""

import argparse
import time
from collections.abc import Callable

import torch

import jotlight as jl
from jotlight.torch import Network
from jotlight.torch.distributed import thread_limit
from jotlight.torch.patches import PatchLoader
from jotlight.torch.precision import PRECISIONS
from jotlight.training import PhotographPatches

SHAPES = (16, 48), (32, 64), (16, 96)
"""Numbers of patches and their sides."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repetitions", type=int, default=10)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    names = ("astronaut", "coffee", "chelsea")
    photographs = [(255 * jl.datasets.photograph(name)).astype("uint8") for name in names]
    source = PhotographPatches(photographs)
    print("network batch patch data", *PRECISIONS)
    with thread_limit(options.threads):
        for name in ("small", "medium"):
            network = jl.Network.conditional(name, rng=0)
            for number, side in SHAPES:
                loader = PatchLoader(source, network, network.sensor, 0, number, side)
                times = measure(network, loader, options.repetitions, options.threads)
                per_pixel = (f"{1e6 * seconds / (number * side**2):.3f}" for seconds in times)
                print(name, number, side, *per_pixel, flush=True)


def measure(
    network: jl.Network, loader: PatchLoader, repetitions: int, threads: int
) -> list[float]:
    """Return seconds: for the data, and for a pass in each precision."""
    module = Network(network)
    batch = loader.batch(0, slice(None), threads)

    def run(dtype: torch.dtype) -> None:
        module.filter_dtype = dtype
        module.zero_grad()
        batch.squared_errors(module).mean().backward()

    tasks = [lambda: loader.batch(0, slice(None), threads)]
    tasks += [lambda dtype=dtype: run(dtype) for dtype in PRECISIONS.values()]
    best = [float("inf")] * len(tasks)
    # Interleaved, so that other load on the machine affects all tasks alike. The first round, which
    # compiles kernels, is slower.
    for _ in range(1 + repetitions):
        for index, task in enumerate(tasks):
            best[index] = min(best[index], cpu_seconds(task))
    return best


def cpu_seconds(task: Callable[[], object]) -> float:
    begun = time.process_time()
    task()
    return time.process_time() - begun


if __name__ == "__main__":
    main()
