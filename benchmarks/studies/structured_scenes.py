"""Compare the networks with BM3D on images of strong structure: buildings, text, and gratings.

    python benchmarks/studies/structured_scenes.py path/to/data [--trials 16]

The photographs are the eight validation photographs (see ``tools/training_data.py``) whose edges
are most coherent, which are mostly buildings; their names are printed. Text and gratings are drawn.
None of the images took part in training. BM3D has the exact inverse, and needs its package. The
table shows the PSNR in dB, and the SSIM in parentheses.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, sobel
from unlike_photographs import text

import jotlight as jl

sys.path.append(str(Path(__file__).parents[2] / "tools"))
import training_data

NUMBER, SIDE = 8, 256
METHODS = "noniterative-bm3d", "network-small", "network-medium", "network-large"

Image = npt.NDArray[np.float64]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--trials", type=int, default=16)
    options = parser.parse_args()
    sensor = jl.Sensor(frames=options.trials)
    print(f"| image | {' | '.join(METHODS)} | large above BM3D |")
    print(f"| --- |{' ---: |' * (len(METHODS) + 1)}")
    gains = []
    for number, (name, image) in enumerate(scenes(options.data).items()):
        bits = sensor.expose(image, rng=number)
        cells, values = [], []
        for method in METHODS:
            estimate = jl.reconstruct(bits, method=method)
            values.append(jl.metrics.psnr(estimate, image))
            cells.append(f"{values[-1]:.2f} ({jl.metrics.ssim(estimate, image):.3f})")
        gains.append(values[-1] - values[0])
        print(f"| {name} | {' | '.join(cells)} | {gains[-1]:+.2f} |", flush=True)
    print(
        f"\nLarge is {np.mean(gains):+.2f} dB above BM3D in the mean, {min(gains):+.2f} at least."
    )


def scenes(data: Path) -> dict[str, Image]:
    """Return the images by name."""
    files = training_data.validation_files(data)
    photographs = training_data.validation_images(data)
    order = np.argsort([-structure(image) for image in photographs])[:NUMBER]
    found = {files[index].stem: center(photographs[index]) for index in order}
    found["text"] = text()[:SIDE, :SIDE]
    y, x = np.mgrid[:SIDE, :SIDE]
    for period, angle in ((4.0, 0.3), (6.5, 1.1), (10.0, 2.2)):
        wave = np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
        found[f"grating, {period:g} pixels"] = 0.5 + 0.4 * wave
    return found


def center(image: npt.NDArray[np.floating]) -> Image:
    top, left = (max(0, (size - SIDE) // 2) for size in image.shape)
    return image[top : top + SIDE, left : left + SIDE].astype(np.float64)


def structure(image: npt.NDArray[np.floating]) -> float:
    """Return the energy of the coherent edges of an image."""
    part = center(image)
    slopes = sobel(part, 0), sobel(part, 1)
    first, mixed, second = (
        gaussian_filter(slopes[i] * slopes[j], 3.0) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    return float(np.sqrt((first - second) ** 2 + 4 * mixed**2).mean())


if __name__ == "__main__":
    main()
