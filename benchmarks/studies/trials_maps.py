"""Measure networks where pixels have different numbers of trials.

    python benchmarks/studies/trials_maps.py PHOTOGRAPHS [--networks small medium large FILE]

The first table shows the PSNR in dB for several maps of trials, averaged over the first six
photographs of the data set gb82 (central 256 x 256 pixels, gray), with 1 photon per jot and frame
at intensity 1. The second table shows how much better an estimate is whose pixels all have the
trials that the map has at a place, each of them measured at these places alone.
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.networks.pretrained import FOLDER

IMAGES = 6
SIDE = 256
Map = npt.NDArray[np.float64]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--networks", nargs="+", default=["small", "medium", "large"])
    options = parser.parse_args()
    images = read_images(options.photographs)
    networks = {Path(name).stem: load(name) for name in options.networks}
    tables = {name: measure(network, images) for name, network in networks.items()}
    for column, title in enumerate(("PSNR in dB", "Loss in dB")):
        print(f"\n{title}\n\n| map | {' | '.join(networks)} |")
        print(f"| --- | {' | '.join('---:' for _ in networks)} |")
        for case in maps():
            values = [f"{np.mean(tables[name][case], axis=0)[column]:.2f}" for name in networks]
            print(f"| {case} | {' | '.join(values)} |")


def read_images(folder: Path) -> list[npt.NDArray[np.float32]]:
    """Return the central parts of the photographs."""
    images = []
    for path in sorted(folder.glob("*.webp"))[:IMAGES]:
        image = jl.read_image(path, gray=True)
        top, left = ((size - SIDE) // 2 for size in image.shape)
        images.append(image[top : top + SIDE, left : left + SIDE])
    return images


def load(name: str) -> jl.Network:
    """Return a network by name or from a file."""
    if Path(name).suffix:
        return jl.Network.load(name)
    return jl.Network.load(FOLDER / f"{name}.safetensors")


def maps() -> dict[str, Map]:
    """Return the maps of trials by name."""
    rng = np.random.default_rng(0)
    shape = SIDE, SIDE
    row, column = np.mgrid[:SIDE, :SIDE] / (SIDE - 1) - 0.5
    full = np.full(shape, 16.0)
    lines = full.copy()
    lines[20::40] = lines[:, 30::50] = 0
    return {
        "1 % dead pixels": np.where(rng.random(shape) < 0.01, 0, full),
        "10 % dead pixels": np.where(rng.random(shape) < 0.1, 0, full),
        "half of the trials in 10 %": np.where(rng.random(shape) < 0.1, 8, full),
        "dead rows and columns": lines,
        "vignetting, 4 to 64": np.rint(64 * 16 ** (-2 * (row**2 + column**2))),
        "halves with 4 and 64": np.where(column < 0, 4.0, 64.0),
        "stripes with 4 and 64": np.where(np.sin(40 * column) < 0, 4.0, 64.0),
        "random, 4 to 64": np.rint(4 * 16 ** rng.random(shape)),
    }


def measure(
    network: jl.Network, images: list[npt.NDArray[np.float32]]
) -> dict[str, list[tuple[float, float]]]:
    """Return the PSNR and the loss of each image, by the name of the map."""
    results: dict[str, list[tuple[float, float]]] = {}
    for name, trials in maps().items():
        results[name] = []
        for number, image in enumerate(images):
            rng = np.random.default_rng(number)
            largest = int(trials.max())
            probability = -np.expm1(-image.astype(np.float64))
            # A pixel's ones with fewer trials are a part of those with more trials.
            ones = rng.random((largest, *image.shape)) < probability
            counts = np.cumsum(ones, axis=0, dtype=np.int32)
            sensor = jl.Sensor(frames=largest, gain=float(largest))
            estimate = reconstruct(network, counts, trials, sensor)
            best = np.empty_like(image)
            levels = np.unique(trials)
            for level in levels[levels > 0]:
                everywhere = reconstruct(network, counts, np.full_like(trials, level), sensor)
                best = np.where(trials == level, everywhere, best)
            known = trials > 0
            error, least = (float(np.mean((each - image)[known] ** 2)) for each in (estimate, best))
            psnr = jl.metrics.psnr(estimate, image)
            results[name].append((psnr, 10 * np.log10(error / least)))
    return results


def reconstruct(
    network: jl.Network, counts: npt.NDArray[np.int32], trials: Map, sensor: jl.Sensor
) -> npt.NDArray[np.float32]:
    """Return the estimate from the first trials of each pixel."""
    index = np.maximum(trials.astype(int) - 1, 0)[None]
    ones = np.where(trials > 0, np.take_along_axis(counts, index, 0)[0], 0)
    return jl.reconstruct(ones, sensor, method=network, trials=trials)


if __name__ == "__main__":
    main()
