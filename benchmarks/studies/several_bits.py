"""Measure methods on readings of several bits with read noise.

    python benchmarks/studies/several_bits.py IMAGES [--number 10] [--read-noise 0.3]

IMAGES is a folder, whose first images in the order of their names are exposed with a mean of one
photon per reading at intensity 1. The first table states the mean PSNR of each method by the bits
and the number of readings per pixel. The network receives equivalent counts. BM3D runs only if its
package is installed. The second table states the coverage of intervals of 95 %.
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.errors import MissingExtraError
from jotlight.images.sets import read_image_set

BITS = 1, 2, 3, 4
FRAMES = 4, 16, 64
METHODS = "mle", "noniterative-tv", "noniterative-nlm", "noniterative-bm3d", "network-medium"


def main() -> None:
    """Measure, and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("--number", type=int, default=10)
    parser.add_argument("--read-noise", type=float, default=0.3)
    options = parser.parse_args()
    images = [image.astype(float) for image in read_image_set(options.images)[1]]
    images = images[: options.number]
    print(f"| bits, readings | {' | '.join(METHODS)} |")
    print("| --- |" + " --- |" * len(METHODS))
    coverage = []
    for bits in BITS:
        for frames in FRAMES:
            sensor = jl.Sensor(frames=frames, bit_depth=bits, read_noise=options.read_noise)
            values = [measure(method, sensor, images) for method in METHODS]
            row = " | ".join("" if value is None else f"{value:.2f}" for value in values)
            print(f"| {bits}, {frames} | {row} |", flush=True)
            known = [covered(method, sensor, images[:3]) for method in ("mle", "network-medium")]
            coverage.append((f"{bits}, {frames}", *(f"{value:.1%}" for value in known)))
    print("\n| bits, readings | mle | network-medium |\n| --- | --- | --- |")
    for row in coverage:
        print(f"| {' | '.join(row)} |")


def measure(method: str, sensor: jl.Sensor, images: list[npt.NDArray[np.float64]]) -> float | None:
    """Return the mean PSNR of a method, or None if its package is missing."""
    values = []
    for index, image in enumerate(images):
        data = sensor.expose(image, rng=index)
        try:
            values.append(jl.metrics.psnr(image, jl.reconstruct(data, method=method)))
        except MissingExtraError:
            return None
    return float(np.mean(values))


def covered(method: str, sensor: jl.Sensor, images: list[npt.NDArray[np.float64]]) -> float:
    """Return the fraction of the intervals of 95 % that contain the intensity."""
    inside = []
    for index, image in enumerate(images):
        known = jl.uncertainty(sensor.expose(image, rng=index), method=method)
        inside.append((known.low <= image) & (image <= known.high))
    return float(np.mean([part.mean() for part in inside]))


if __name__ == "__main__":
    main()
