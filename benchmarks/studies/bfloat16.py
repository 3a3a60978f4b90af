"""Measure what the precision bf16 costs on Berkeley test images, for many K.

    python benchmarks/studies/bfloat16.py path/to/data [--images 100] [--output docs/results]

The folder holds ``bsds300/test/*.jpg``. The bits of image i have the seed i. The table states by
how much the PSNR of the same network in f32 is higher, in dB: the mean over the images, and that of
the worst one.
"""

import argparse
import csv
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.files import atomic_write
from jotlight.images.sets import read_image_set
from jotlight.networks.architectures import ARCHITECTURES

TRIALS = 1, 4, 16, 64, 256
COLUMNS = "bits", "network", "images", "mean_loss_db", "worst_loss_db"


def main() -> None:
    """Measure everything, and print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--images", type=int, default=100)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    _, images = read_image_set(options.data / "bsds300/test", first=options.images)
    rows = []
    for trials in TRIALS:
        for name in ARCHITECTURES:
            found = losses(trials, name, images)
            rows.append((trials, name, len(images), f"{np.mean(found):.5f}", f"{max(found):.5f}"))
            print(*rows[-1], flush=True)
    print(f"\n| K | {' | '.join(f'{name}: mean, worst' for name in ARCHITECTURES)} |")
    print(f"|{' ---: |' * (len(ARCHITECTURES) + 1)}")
    for trials in TRIALS:
        cells = [f"{float(row[3]):.4f}, {float(row[4]):.4f}" for row in rows if row[0] == trials]
        print(f"| {trials} | {' | '.join(cells)} |")
    if options.output is not None:
        path = options.output / "bfloat16.csv"
        with (
            atomic_write(path) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
        print(f"written: {path}")


def losses(trials: int, name: str, images: list[np.ndarray]) -> list[float]:
    """Return the PSNR in f32 minus that in bf16, of each image."""
    sensor = jl.Sensor(frames=trials)
    network = jl.pretrained(sensor, name)
    rounded = network.with_precision("bf16")
    found = []
    for number, image in enumerate(images):
        bits = sensor.expose(image, rng=number)
        f32, bf16 = (jl.metrics.psnr(each.reconstruct(bits), image) for each in (network, rounded))
        found.append(f32 - bf16)
    return found


if __name__ == "__main__":
    main()
