"""Measure all methods on static scenes with many trials per pixel.

    python benchmarks/studies/large_trials.py PHOTOGRAPHS [--images 6] [--output docs/results]

PHOTOGRAPHS is a folder. The study takes its first images in the order of their names, the central
256 x 256 pixels in gray. A jot receives 0.2 photons per frame on average. The table shows the PSNR
in dB, averaged over the images, and two columns of differences:

- network at 256: the network without further runs. It gets all counts, and works for K = 256.
- default, worst: PSNR of the default minus the best of mle, noniterative-tv, and admm-tv, for the
  image where it is smallest.
- held-out, worst: the same for held-out, minus the best of all other methods.

The default is network-medium up to K = 1000, and held-out above. The study takes two minutes on two
cores.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.evaluation.choice import choose_method
from jotlight.evaluation.methods import METHODS
from jotlight.experiments.bsds_methods import crop_center
from jotlight.images.sets import read_image_set

SIZE = 256
PHOTONS = 0.2
ALL_TRIALS = 256, 512, 1000, 2048, 4096, 10_000, 20_000, 50_000, 100_000
CLASSICAL = "mle", "noniterative-tv", "admm-tv"
NAMES = *CLASSICAL, "network-medium", "held-out"
CLAMPED = "network at 256"
COLUMNS = ("trials", "image", *NAMES, CLAMPED, "default")


def main() -> None:
    """Measure all images, and print a row for each K."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=6)
    parser.add_argument("--output", type=Path, help="folder for large_trials.csv")
    options = parser.parse_args()
    names, images = read_image_set(options.photographs, first=options.images)
    rows = []
    print(f"| K | {' | '.join((*NAMES, CLAMPED))} | default, worst | held-out, worst |")
    print(f"| ---: |{' ---: |' * (len(NAMES) + 3)}")
    for trials in ALL_TRIALS:
        own = [
            {"trials": trials, "image": Path(name).stem}
            | measure(crop_center(image, SIZE), trials, i)
            for i, (name, image) in enumerate(zip(names, images, strict=True))
        ]
        rows += own
        means = [np.mean([row[name] for row in own]) for name in (*NAMES, CLAMPED)]
        worst = min(row["default"] - max(row[name] for name in CLASSICAL) for row in own)
        blend = min(row["held-out"] - max(row[name] for name in NAMES[:-1]) for row in own)
        cells = " | ".join(f"{mean:.2f}" for mean in means)
        print(f"| {trials:,} | {cells} | {worst:+.2f} | {blend:+.2f} |", flush=True)
    if options.output is not None:
        write_table(options.output / "large_trials.csv", rows)


def measure(image: npt.NDArray[np.float32], trials: int, seed: int) -> dict[str, float]:
    """Return the PSNR of each method on random counts of a static scene."""
    scene = jl.datasets.moving(image, "static", photons=PHOTONS, sensor=jl.Sensor(frames=trials))
    truth, sensor = scene.image(), scene.sensor
    probability = sensor.probability(truth).astype(np.float64)
    counts = np.random.default_rng(seed).binomial(trials, probability)
    found = {
        name: float(jl.metrics.psnr(METHODS[name].run(counts, sensor), truth)) for name in NAMES
    }
    clamped = jl.pretrained(sensor).denoise_probability((counts / trials).astype(np.float32), 256)
    estimate = intensity_from_probability(np.clip(clamped, 0, 1), sensor, None)
    found[CLAMPED] = float(jl.metrics.psnr(estimate, truth))
    found["default"] = found[choose_method(sensor).method]
    return found


def write_table(path: Path, rows: list[dict[str, float]]) -> None:
    """Write all PSNR to a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            text = {
                name: f"{value:.3f}"
                for name, value in row.items()
                if name in (*NAMES, CLAMPED, "default")
            }
            writer.writerow(row | text)


if __name__ == "__main__":
    main()
