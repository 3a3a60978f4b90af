"""Measure networks for any K on the validation photographs, to choose between checkpoints.

    python tools/validate.py path/to/data small.safetensors other.safetensors

The folder holds the images of the module `training_data`. The table shows the mean PSNR in dB for
trials and light: photons per jot and frame at intensity 1, for display-encoded photographs in gray,
and on average, for the same photographs in linear light.
"""

import argparse
from pathlib import Path

import numpy as np

import jotlight as jl
import training_data

ENCODED = *((bits, 1.0) for bits in (1, 4, 16, 64, 256)), (16, 0.05), (16, 0.2), (16, 4.0)
"""Trials, and light at intensity 1."""

LINEAR = tuple((bits, 0.44) for bits in (4, 16, 64, 256))
"""Trials, and average light: that of a display-encoded photograph with 1 photon at intensity 1."""

Image = np.ndarray


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("networks", type=Path, nargs="+")
    options = parser.parse_args()
    encoded = training_data.validation_images(options.data)
    linear = [linear_light(image) for image in encoded]
    titles = [f"K={bits},{light:g}" for bits, light in ENCODED]
    print("network", *titles, *(f"linear,K={bits}" for bits, _ in LINEAR))
    for path in options.networks:
        network = jl.Network.load(path)
        scores = [psnr(network, encoded, bits, light) for bits, light in ENCODED]
        means = [float(image.mean()) for image in linear]
        scores += [psnr(network, linear, bits, light, means) for bits, light in LINEAR]
        print(path.name, *(f"{score:.3f}" for score in scores), flush=True)


def linear_light(image: Image) -> Image:
    """Return the intensities of a display-encoded image by the inverse of the sRGB curve."""
    curve = np.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
    return curve.astype(np.float32)


def psnr(
    network: jl.Network,
    images: list[Image],
    bits: int,
    light: float,
    intensities: list[float] | None = None,
) -> float:
    """Return the mean PSNR, with this light at an intensity of each image; default: at 1."""
    scores = []
    for number, image in enumerate(images):
        intensity = 1.0 if intensities is None else max(intensities[number], 0.02)
        sensor = jl.Sensor(frames=bits, gain=light * bits / intensity)
        estimate = network.reconstruct(sensor.expose(image, rng=number), sensor)
        scores.append(jl.metrics.psnr(estimate, image))
    return float(np.mean(scores))


if __name__ == "__main__":
    main()
