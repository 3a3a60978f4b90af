"""What splines gain: the small network with them, and with ReLU at no less cost, three seeds each.

    python benchmarks/studies/splines_or_relu.py path/to/data [--steps 10000] [--seeds 3] [--output DIR]

The folder holds ``bsds300/train/*.jpg`` to learn from and ``bsds300/test/*.jpg``, of which the
first 20 are measured, K = 16. It needs the extra `torch`. ReLU has 13 channels in place of 12,
since a spline costs as much as ten operations, and learns from the same patches and bits.
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
from jotlight.networks import architectures as deep
from jotlight.torch import NetworkModule, training
from jotlight.torch.distributed import ProcessGroup
from jotlight.torch.patches import PatchLoader

SENSOR = jl.Sensor(frames=16)
COLUMNS = "nonlinearity", "channels", "steps", "seed", "psnr_db"


class Rectified(NetworkModule):
    """The same with max(z, 0) for every spline that is learned."""

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
    for name, kind, channels in (("spline", NetworkModule, 12), ("ReLU", Rectified, 13)):
        for seed in range(options.seeds):
            found = learned(kind, channels, seed, scenes, tests, options)
            rows.append((name, channels, options.steps, seed, f"{found:.3f}"))
            print(", ".join(map(str, rows[-1])), flush=True)
        values = [float(row[-1]) for row in rows if row[0] == name]
        print(f"{name}: {statistics.mean(values):.3f} dB, {min(values)} to {max(values)}")
    if options.output is not None:
        with (
            atomic_write(options.output / "splines.csv") as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


def learned(
    kind: type[NetworkModule],
    channels: int,
    seed: int,
    scenes: list[np.ndarray],
    tests: list[np.ndarray],
    options: argparse.Namespace,
) -> float:
    with patch.dict(deep.ARCHITECTURES, small=deep.Architecture((channels,), (3,))):
        network = jl.Network.residual(SENSOR, "small", rng=seed)
    module = kind(network)
    loader = PatchLoader(scenes, network, SENSOR, seed, training.BATCH, training.PATCH)
    trainer = training.ImageTrainer(
        module, loader, {}, training.LEARNING_RATE, None, ProcessGroup()
    )
    for step in range(options.steps):
        trainer.step(step, options.steps)
    found = []
    with torch.inference_mode():
        for number, image in enumerate(tests):
            counts = SENSOR.expose(image, rng=number).counts(1).astype(np.float32)
            picture = module(torch.from_numpy(counts)[None, None])[0, 0].numpy()
            found.append(jl.metrics.psnr(picture, image))
    return float(np.mean(found))


if __name__ == "__main__":
    main()
