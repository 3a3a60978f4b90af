"""Compare two costs of networks for any K: the error of z = arcsin √p, and that of the intensity.

    python benchmarks/studies/deep_costs.py DATA [--from FILE] [--steps 1500]
        [--learning-rate 1e-3] [--seed 5]

DATA is the folder with the photographs of `tools/training_data.py`, and FILE a network to start
from, by default the pretrained medium. It takes the same steps with each cost. The error of z has
the weight (dc/dz)² of the true intensity, so both costs agree for small errors. The table shows the
mean PSNR in dB of the middle of every third validation photograph, for one photon per jot and frame
at intensity 1. It needs the extra `torch`.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from deep_optimizers import BATCH, PATCH, quality, training_data

import jotlight as jl
from jotlight.networks.pretrained import FOLDER
from jotlight.torch import fastest_precision, patches, train
from jotlight.torch.response import detection_probability

TRIALS = 1, 4, 16, 64
SETTINGS = {"batch": BATCH, "patch": PATCH, "device": "cpu", "threads": 1}


def main() -> None:
    """Print a row for the start, and for the network after the steps with each cost."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--from", dest="start", type=Path, default=FOLDER / "medium.safetensors")
    parser.add_argument("--steps", type=int, default=1500)
    parser.add_argument("--learning-rate", type=float, default=1e-3)
    parser.add_argument("--seed", type=int, default=5)
    options = parser.parse_args()
    source = training_data.training_source(options.data)
    images = training_data.validation_images(options.data)[::3]
    start = jl.Network.load(options.start)
    print("| cost |", *(f"K = {trials} |" for trials in TRIALS))
    print("| --- |" + " ---: |" * len(TRIALS))
    print_row("start", start, images)
    precision = fastest_precision(start, **SETTINGS)
    of_intensity = patches.Batch.errors_of
    for name, cost in (("error of z", errors_of_z), ("error of the intensity", of_intensity)):
        patches.Batch.errors_of = cost
        network, _ = train(
            start,
            source,
            steps=options.steps,
            learning_rate=options.learning_rate,
            precision=precision,
            rng=options.seed,
            **SETTINGS,
        )
        print_row(name, network, images)


def errors_of_z(self: patches.Batch, z: torch.Tensor) -> torch.Tensor:
    """Return the mean square error of estimates z of each patch, as `Batch.errors_of` does."""
    slope, dark = (each.view(-1, 1, 1, 1) for each in (self.light_per_intensity, self.dark_counts))
    rates = (self.truth * slope + dark).clamp(max=20)
    target = torch.asin(torch.sqrt(detection_probability(1, rates)))
    usual = torch.expm1((0.44 * slope + dark).clamp(max=20))
    errors = 4 * torch.expm1(rates).minimum(4 * usual) * (z - target) ** 2
    scale = slope**2 * (usual / (self.trials * slope**2)) ** 0.6
    return (errors / scale).mean((1, 2, 3))


def print_row(name: str, network: jl.Network, images: list[np.ndarray]) -> None:
    """Print the mean PSNR of a network in dB for each number of trials."""
    cells = [f"{quality(network, images, trials):.2f}" for trials in TRIALS]
    print(f"| {name} |", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
