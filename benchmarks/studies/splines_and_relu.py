"""Compare splines with ReLU in the small network at the same cost, with several seeds.

    python benchmarks/studies/splines_and_relu.py path/to/data [--steps 10000] [--seeds 3]

The folder holds ``bsds300/train/*.jpg`` for training and ``bsds300/test/*.jpg``, of which the first
20 are measured, K = 16. The study needs the extra `torch`. ReLU has 13 channels instead of 12,
because a spline costs as much as ten operations. It trains on the same patches and bits.
"""

import argparse
import csv
import statistics
from pathlib import Path
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor

import jotlight as jl
from jotlight.files import atomic_write
from jotlight.images.sets import read_image_set
from jotlight.networks.architectures import ARCHITECTURES, Architecture
from jotlight.torch import Network, training
from jotlight.torch.ahead import AheadLoader
from jotlight.torch.distributed import ProcessGroup
from jotlight.torch.patches import PatchLoader
from jotlight.training import ImagePatches

SENSOR = jl.Sensor(frames=16)
COLUMNS = "nonlinearity", "channels", "steps", "seed", "psnr_db"


class Rectified(Network):
    """The same network with max(z, 0) for every trainable spline."""

    def activate(self, index: int, sums: Tensor, coefficients: Tensor | None) -> Tensor:
        if coefficients is not None and coefficients.requires_grad:
            return sums.relu()
        return super().activate(index, sums, coefficients)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    _, scenes = read_image_set(options.data / "bsds300/train")
    _, tests = read_image_set(options.data / "bsds300/test", first=20)
    rows = []
    if options.threads is not None:
        torch.set_num_threads(options.threads)
    for name, kind, channels in (("spline", Network, 12), ("ReLU", Rectified, 13)):
        for seed in range(options.seeds):
            psnr = train_and_measure(kind, channels, seed, scenes, tests, options)
            rows.append((name, channels, options.steps, seed, f"{psnr:.3f}"))
            print(", ".join(map(str, rows[-1])), flush=True)
        values = [float(row[-1]) for row in rows if row[0] == name]
        print(f"{name}: {statistics.mean(values):.3f} dB, {min(values)} to {max(values)}")
    if options.output is not None:
        with (
            atomic_write(options.output / "splines.csv") as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


def train_and_measure(
    kind: type[Network],
    channels: int,
    seed: int,
    scenes: list[np.ndarray],
    tests: list[np.ndarray],
    options: argparse.Namespace,
) -> float:
    """Return the mean PSNR of a network after training."""
    with patch.dict(ARCHITECTURES, small=Architecture((channels,), (3,))):
        network = jl.Network.residual(SENSOR, "small", rng=seed)
    module = kind(network)
    source = ImagePatches(scenes)
    loader = PatchLoader(source, network, SENSOR, seed, training.BATCH, training.PATCH)
    with AheadLoader(loader, slice(None), options.steps - 1) as ahead:
        trainer = training.ImageTrainer(
            module, ahead, {}, training.LEARNING_RATE, None, ProcessGroup(), "adam"
        )
        for step in range(options.steps):
            trainer.step(step, options.steps)
    values = []
    with torch.inference_mode():
        for number, image in enumerate(tests):
            counts = SENSOR.expose(image, rng=number).counts(1).astype(np.float32)
            estimate = module(torch.from_numpy(counts)[None, None])[0, 0].numpy()
            values.append(jl.metrics.psnr(estimate, image))
    return float(np.mean(values))


if __name__ == "__main__":
    main()
