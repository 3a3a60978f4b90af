"""Measure the PSNR of the deep networks on Berkeley test images, for every K and exposure.

    python benchmarks/studies/network_quality.py path/to/data [--output docs/results]

The folder holds ``bsds300/test/*.jpg``. The bits of image i have the seed i. Every K is measured on
all images and on the first 20, other exposures on the first 20 only. `--model` adds networks to
those of the package, where they serve the sensor.
"""

import argparse
import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.files import atomic_write
from jotlight.images.sets import read_image_set
from jotlight.networks.architectures import SIZES
from jotlight.networks.pretrained import TRAINED_TRIALS

ALL_TRIALS = 1, 4, *TRAINED_TRIALS, 256
FLUXES = 0.05, 0.2, 1.0, 4.0
"""Photons per jot and frame at intensity 1. The mean of photographs is 0.44 of that."""

EXPOSURE_BITS = 4, 16, 64
"""Trials per pixel at which all fluxes are measured."""

FIRST = 20
COLUMNS = "bits", "flux", "method", "images", "psnr_db"

Reconstruct = Callable[[jl.Bits, jl.Sensor], np.ndarray]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--images", type=int, default=100)
    parser.add_argument("--model", type=Path, nargs="*", default=[])
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    _, images = read_image_set(options.data / "bsds300/test", first=options.images)
    rows = []
    for bits, flux in [*((bits, 1.0) for bits in ALL_TRIALS), *exposures()]:
        sensor = jl.Sensor(frames=bits, gain=flux * bits)
        tested = images if flux == 1 else images[:FIRST]
        for name, run in methods(sensor, options.model):
            values = psnr(run, sensor, tested)
            for number in sorted({min(FIRST, len(tested)), len(tested)}):
                rows.append((bits, flux, name, number, f"{np.mean(values[:number]):.3f}"))
                print(*rows[-1], flush=True)
    if options.output is not None:
        with (
            atomic_write(options.output / "deep.csv") as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
        print(f"written: {options.output / 'deep.csv'}")


def exposures() -> list[tuple[int, float]]:
    return [(bits, flux) for bits in EXPOSURE_BITS for flux in FLUXES if flux != 1]


def methods(sensor: jl.Sensor, models: list[Path]) -> list[tuple[str, Reconstruct]]:
    """Return the trained networks, and the fast classical methods."""
    found: list[tuple[str, Reconstruct]] = [
        ("maximum likelihood", jl.mle),
        ("total variation", lambda bits, sensor: jl.noniterative(bits, sensor, denoiser="tv")),
    ]
    found += [(quality, jl.pretrained(sensor, quality).reconstruct) for quality in SIZES]
    for path in models:
        network = jl.Network.load(path)
        try:
            network.reconstruct(np.zeros((8, 8), np.int32), sensor)
        except ValueError:
            continue
        found.append((path.stem, network.reconstruct))
    return found


def psnr(run: Reconstruct, sensor: jl.Sensor, images: list[np.ndarray]) -> list[float]:
    return [
        jl.metrics.psnr(run(sensor.expose(image, rng=number), sensor), image)
        for number, image in enumerate(images)
    ]


if __name__ == "__main__":
    main()
