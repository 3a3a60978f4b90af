"""A photograph into bits and back by three methods, saved as pictures.

python examples/three_methods.py [--quick]
"""

import argparse
from pathlib import Path

import jotlight as jl
from jotlight.images.io import image_writer


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="a small part of the photograph")
    options = parser.parse_args()
    image = jl.datasets.photograph("coffee")
    if options.quick:
        image = image[100:200, 200:300]
    sensor = jl.Sensor(oversampling=2, frames=4)  # 16 bits per pixel
    bits = sensor.expose(image, rng=0)
    print(bits)
    for name, estimate in {
        "mle": jl.mle(bits, sensor),
        "tv": jl.noniterative(bits, sensor),
        "network": jl.pretrained(sensor).reconstruct(bits),
    }.items():
        path = Path(f"coffee-{name}.png")
        image_writer(path)(path, estimate)
        print(
            f"{path}: {jl.metrics.psnr(estimate, image):.2f} dB, "
            f"SSIM {jl.metrics.ssim(estimate, image):.3f}"
        )


if __name__ == "__main__":
    main()
