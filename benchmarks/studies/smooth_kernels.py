"""Compare methods on sensors whose kernel spreads the light smoothly.

    python benchmarks/studies/smooth_kernels.py PHOTOGRAPHS

The table shows the PSNR in dB, averaged over the first six photographs of the data set gb82
(central 128 x 128 pixels, gray), with 1 photon per jot and frame at intensity 1. "Without
deconvolution" is the mean light of each pixel by medium. "Box kernel" is medium on a sensor that
does not blur.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np

import jotlight as jl

IMAGES, SIDE = 6, 128
SENSORS = [
    *((kernel, 1, trials) for kernel in ("linear", "quadratic", "cubic") for trials in (4, 16, 64)),
    *((kernel, 4, trials) for kernel in ("linear", "quadratic", "cubic") for trials in (16, 256)),
]
COLUMNS = "mle-iterative", "admm-tv", "two-layer", "small", "medium", "large"
OTHERS = "without deconvolution", "box kernel"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("ignore", jl.JotlightWarning)
    images = [center(path) for path in sorted(options.photographs.glob("*.webp"))[:IMAGES]]
    print(f"| kernel | K\u0302 | K | {' | '.join((*COLUMNS, *OTHERS))} |")
    print(f"| --- | ---: | ---: | {' | '.join('---:' for _ in (*COLUMNS, *OTHERS))} |")
    for kernel, side, trials in SENSORS:
        sensor = jl.Sensor(oversampling=side, frames=trials // side**2, kernel=kernel)
        scores = np.mean([measure(image, sensor, rng) for rng, image in enumerate(images)], axis=0)
        columns = " | ".join(f"{score:.2f}" for score in scores)
        print(f"| {kernel} | {side} | {trials} | {columns} |", flush=True)


def center(path: Path) -> np.ndarray:
    """Return the central part of a photograph."""
    image = jl.read_image(path, gray=True)
    top, left = ((size - SIDE) // 2 for size in image.shape)
    return image[top : top + SIDE, left : left + SIDE]


def measure(image: np.ndarray, sensor: jl.Sensor, rng: int) -> list[float]:
    """Return the PSNR of each method."""
    bits, box = sensor.expose(image, rng=rng), sensor.replace(kernel="box")
    estimates = [jl.reconstruct(bits, method=name) for name in ("mle-iterative", "admm-tv")]
    estimates += [jl.reconstruct(bits, quality=name) for name in COLUMNS[2:]]
    estimates.append(jl.reconstruct(bits.counts(sensor.oversampling), box))
    estimates.append(jl.reconstruct(box.expose(image, rng=rng)))
    return [jl.metrics.psnr(estimate, image) for estimate in estimates]


if __name__ == "__main__":
    main()
