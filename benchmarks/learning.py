"""How far learning gets: synthetic scenes against the limit, CIFAR-10, and BSDS.

    python benchmarks/learning.py path/to/data [synthetic] [cifar] [photographs]

The folder holds ``cifar10_gray.npz`` and ``bsds300/test/*.jpg``. On two cores the synthetic scenes
take some five minutes, CIFAR-10 two, and the photographs, mostly for total variation, twenty.
"""

import argparse
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.image_sets import read_image_set
from jotlight.models import BITS_PER_PIXEL

LIMITS = (14.816, 16.394, 17.769, 18.972, 20.037, 20.990, 21.851, 22.636)
"""The posterior mean's PSNR on intensities uniform in [0, 1], by quadrature: none has more."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("parts", nargs="*", metavar="part", help="Default: all.")
    options = parser.parse_args()
    parts = {"synthetic": synthetic, "cifar": cifar, "photographs": photographs}
    for name in options.parts or parts:
        parts[name](options.data)


def synthetic(_: Path) -> None:
    """The default recipe, then 4096 new scenes."""
    scenes = jl.datasets.uniform_scenes(np.random.default_rng(99), 4096)
    print("\n| K | initial, dB | learned, dB | limit, dB | from the limit, dB |")
    print("| ---: | ---: | ---: | ---: | ---: |")
    for bits, limit in zip(BITS_PER_PIXEL, LIMITS, strict=True):
        sensor = jl.Sensor(oversampling=round(bits**0.5))
        start = jl.Network.initial(sensor)
        learned, _ = jl.train(start, jl.datasets.uniform_scenes, rng=0)
        first, last = (mean_square_psnr(network, scenes) for network in (start, learned))
        print(
            f"| {bits} | {first:.3f} | {last:.3f} | {limit:.3f} | {last - limit:+.3f} |", flush=True
        )


def mean_square_psnr(network: jl.Network, scenes: np.ndarray) -> float:
    """The PSNR of the mean square error over all scenes, which is what the limit is."""
    errors = [
        np.mean((network.reconstruct(network.sensor.expose(scene, rng=index)) - scene) ** 2)
        for index, scene in enumerate(scenes)
    ]
    return float(-10 * np.log10(np.mean(errors)))


def cifar(data: Path) -> None:
    """The default recipe on the lossless training images; the first 512 lossless test images."""
    with np.load(data / "cifar10_gray.npz", allow_pickle=False) as arrays:
        scenes = arrays["x_train"][arrays["train_lossless"]] / np.float32(255)
        tests = arrays["x_test"][arrays["test_lossless"]][:512] / np.float32(255)
    print(
        "\n| K | MLE, dB | initial, σ = 0.5 / 0.7 / 1.0, dB | learned, dB | gain over σ = 0.5, dB |"
    )
    print("| ---: | ---: | ---: | ---: | ---: |")
    for bits in (9, 16, 36):
        sensor = jl.Sensor(oversampling=round(bits**0.5))
        learned, _ = jl.train(jl.Network.initial(sensor), scenes, rng=0)
        starts = [jl.Network.initial(sensor, sigma=sigma) for sigma in (0.5, 0.7, 1.0)]
        mle, *initial, last = (
            jl.evaluate(method, tests, sensor).mean("psnr") for method in (jl.mle, *starts, learned)
        )
        shown = " / ".join(f"{psnr:.2f}" for psnr in initial)
        print(
            f"| {bits} | {mle:.2f} | {shown} | {last:.2f} | {last - initial[0]:.2f} |", flush=True
        )


def photographs(data: Path) -> None:
    """The networks of the package, on all BSDS test images."""
    _, images = read_image_set(data / "bsds300/test")
    print(
        "\n| K | MLE, dB | SSIM | non-iterative, TV, dB | SSIM | network, dB | SSIM "
        "| its worst 5 %, dB | its first 20, dB |"
    )
    print("| ---: |" + " ---: |" * 8)
    for bits in BITS_PER_PIXEL:
        sensor = jl.Sensor(oversampling=round(bits**0.5))
        network = jl.pretrained(sensor)
        methods = (jl.mle, jl.noniterative, network)
        results = [jl.evaluate(method, images, sensor) for method in methods]
        cells = [f"{result.mean('psnr'):.2f} | {result.mean('ssim'):.3f}" for result in results]
        worst = results[-1].worst("psnr", 0.05)
        first = np.mean(results[-1].values("psnr")[:20])
        print(f"| {bits} | {' | '.join(cells)} | {worst:.2f} | {first:.2f} |", flush=True)


if __name__ == "__main__":
    main()
