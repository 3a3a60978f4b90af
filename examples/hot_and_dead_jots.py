"""A camera with dark counts and dead jots, known to the estimate and not known to it.

python examples/hot_and_dead_jots.py [--quick]
"""

import argparse
import warnings

import numpy as np

import jotlight as jl


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a small part of the photograph")
    options = parser.parse_args()
    image = jl.datasets.photograph("camera")
    if options.quick:
        image = image[100:180, 180:300]
    rng = np.random.default_rng(0)
    dark = np.full(image.shape, 0.01, np.float32)
    hot = rng.random(image.shape) < 0.01
    dark[hot] = 0.5
    dead = rng.random(image.shape) < 0.03
    camera = jl.Sensor(frames=32, dark_counts=dark, mask=dead)
    bits = camera.expose(image, rng=1)

    naive = jl.Sensor(frames=32)
    with warnings.catch_warnings():
        # Each dead jot is a pixel of its own here, which is filled from its neighbours and said so.
        warnings.simplefilter("ignore", jl.JotlightWarning)
        for name, sensor in (
            ("ideal sensor assumed", naive),
            ("dark counts and mask known", camera),
        ):
            estimate = jl.noniterative(bits, sensor)
            print(f"{name}: {jl.metrics.psnr(estimate, image):.2f} dB")


if __name__ == "__main__":
    main()
