"""How good the deep networks are: PSNR on the Berkeley test images, for every K and exposure.

    python benchmarks/studies/deep.py path/to/data [--images 100] [--model FILE ...] [--output docs/results]

The folder holds ``bsds300/test/*.jpg``. The bits of image i have the seed i. Every K is measured on
all of them and on the first 20, other exposures on the first 20 alone. Besides the networks in the
package it tries those of `--model`, where they are for the sensor.
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
from jotlight.networks.pretrained import BITS_PER_PIXEL, unsupported_reason

BITS = 1, 4, *BITS_PER_PIXEL, 256
FLUX = 0.05, 0.2, 1.0, 4.0
"""Photons per jot and frame at intensity 1; photographs have 0.44 of that in the mean."""
EXPOSED = 4, 16, 64
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
    for bits, flux in [*((bits, 1.0) for bits in BITS), *exposures()]:
        sensor = jl.Sensor(frames=bits, gain=flux * bits)
        shown = images if flux == 1 else images[:FIRST]
        for name, run in methods(sensor, options.model):
            found = psnr(run, sensor, shown)
            for number in sorted({min(FIRST, len(shown)), len(shown)}):
                rows.append((bits, flux, name, number, f"{np.mean(found[:number]):.3f}"))
                print(*rows[-1], flush=True)
    if options.output is not None:
        with (
            atomic_write(options.output / "deep.csv") as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
        print(f"written: {options.output / 'deep.csv'}")


def exposures() -> list[tuple[int, float]]:
    return [(bits, flux) for bits in EXPOSED for flux in FLUX if flux != 1]


def methods(sensor: jl.Sensor, models: list[Path]) -> list[tuple[str, Reconstruct]]:
    """The networks that serve a sensor, and the best of the quick classical methods."""
    found: list[tuple[str, Reconstruct]] = [
        ("maximum likelihood", jl.mle),
        ("total variation", lambda bits, sensor: jl.noniterative(bits, sensor, denoiser="tv")),
    ]
    found += [
        (quality, jl.pretrained(sensor, quality).reconstruct)
        for quality in SIZES
        if unsupported_reason(sensor, quality) is None
    ]
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
