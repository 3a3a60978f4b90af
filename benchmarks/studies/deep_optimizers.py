"""Compare Muon with Adam: deep networks after the same number of training steps.

    python benchmarks/studies/deep_optimizers.py DATA [--sizes medium] [--steps 1500]
        [--rates 1.5e-3 3e-3 6e-3] [--seeds 5]

DATA is the folder with the photographs of `tools/training_data.py`. Each K-conditioned network
starts at random parameters and sees the same patches in the same order, 32 of 64 x 64 pixels per
step. The table shows the mean PSNR in dB of the middle of every third validation photograph, for
K = 4, 16, and 64 and one photon per jot and frame at intensity 1, and seconds per step on one
thread. It needs the extra `torch`.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.torch import fastest_precision, train
from jotlight.torch.optimizers import OPTIMIZERS

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
import training_data

BATCH, PATCH = 32, 64
TRIALS = 4, 16, 64


def main() -> None:
    """Print a row for each network."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--sizes", nargs="+", default=["medium"])
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--rates", nargs="+", type=float, default=[1.5e-3, 3e-3, 6e-3])
    parser.add_argument("--seeds", nargs="+", type=int, default=[5])
    options = parser.parse_args()
    source = training_data.training_source(options.data)
    images = training_data.validation_images(options.data)[::3]
    print("| size | optimizer | learning rate | seed | K = 4 | K = 16 | K = 64 | s per step |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for size in options.sizes:
        start = jl.Network.conditional(size, rng=0)
        settings = {"batch": BATCH, "patch": PATCH, "device": "cpu", "threads": 1}
        precision = fastest_precision(start, **settings)
        for seed in options.seeds:
            for rate in options.rates:
                for optimizer in OPTIMIZERS:
                    begun = time.perf_counter()
                    network, _ = train(
                        start,
                        source,
                        steps=options.steps,
                        learning_rate=rate,
                        optimizer=optimizer,
                        precision=precision,
                        rng=seed,
                        **settings,
                    )
                    seconds = (time.perf_counter() - begun) / options.steps
                    found = " | ".join(f"{quality(network, images, k):.2f}" for k in TRIALS)
                    row = f"| {size} | {optimizer} | {rate:g} | {seed} | {found} | {seconds:.3f} |"
                    print(row, flush=True)


def quality(network: jl.Network, images: list[np.ndarray], trials: int) -> float:
    """Return the mean PSNR of a network in dB."""
    sensor = jl.Sensor(frames=trials)
    values = [
        jl.metrics.psnr(network.reconstruct(sensor.expose(image, rng=seed)), image, data_range=1.0)
        for seed, image in enumerate(images)
    ]
    return float(np.mean(values))


if __name__ == "__main__":
    main()
