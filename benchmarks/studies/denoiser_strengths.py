"""Measure the PSNR of the denoisers by their strength on training images, K = 16.

python benchmarks/studies/denoiser_strengths.py path/to/bsds300/train [--images 20]
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.images.io import read_image

SETTINGS = {
    "gaussian": (jl.denoise.gaussian, "sigma", (1.0, 1.2, 1.4, 1.5, 1.6, 1.8)),
    "tv": (jl.denoise.tv, "weight", (0.4, 0.45, 0.5, 0.6, 0.7)),
    "nlm": (jl.denoise.nlm, "strength", (0.5, 0.6, 0.7, 0.8, 0.9)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--images", type=int, default=20)
    options = parser.parse_args()
    sensor = jl.Sensor(oversampling=4)
    images = [read_image(path, gray=True) for path in sorted(options.folder.glob("*.jpg"))][
        : options.images
    ]
    if not images:
        parser.error(f"{options.folder}: expected .jpg files")
    bits = [sensor.expose(image, rng=seed) for seed, image in enumerate(images)]
    for name, (denoise, parameter, values) in SETTINGS.items():
        for value in values:
            denoiser = partial(denoise, **{parameter: value})
            scores = [
                jl.metrics.psnr(jl.noniterative(b, sensor, denoiser=denoiser), image)
                for b, image in zip(bits, images, strict=True)
            ]
            print(f"{name} {parameter}={value}: {np.mean(scores):.3f} dB", flush=True)


if __name__ == "__main__":
    main()
