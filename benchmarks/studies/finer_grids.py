"""Compare images with twice as many rows and columns as a shaking sensor has.

    python benchmarks/studies/finer_grids.py PHOTOGRAPHS [--images 6] [--frames 256 1000]
        [--photons 0.05 0.2 0.7] [--size 128]
    python benchmarks/studies/finer_grids.py PHOTOGRAPHS --figure docs/guide/finer_grid.jpg

The scenes are a zone plate, a smooth scene without fine detail, and the first photographs of a
folder in the order of their names. Each pixel of the sensor integrates over 2 x 2 pixels of the
scene. The table shows the PSNR in dB against the scene, without a border of 16 fine pixels:

- enlarged: bicubic enlargement of the image of `jotlight.merge`.
- deconvolved: the network estimates the light of the squares, from which a regularized inverse of
  their mean follows.
- TV: the image with the largest likelihood minus total variation, with the weight that is best for
  this scene, chosen with the true image.
- upsample: `jotlight.merge(bits, upsample=2)` and the network.
- direct: counts of a sensor with pixels of half the size and the same light per pixel of it and
  trial, a fourth of the trials each. It shows about what can be gained.

The network "medium" estimates all of them but TV. For the zone plate, the contrast at half a cycle
per pixel of the sensor follows: that of the enlarged image, and that of upsample. For the smooth
scene, it is the root mean square of the error of differences of neighboring pixels, in 1/1000 of
the largest intensity.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates
from skimage.restoration import denoise_tv_chambolle

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.networks.inference.finer_grid import Squares, average_squares, enlarge, fit_light
from jotlight.networks.inference.trials_map import denoise_map

Image = npt.NDArray[Any]

BORDER = 16
METHODS = "enlarged", "deconvolved", "TV", "upsample", "direct"
NYQUIST = 0.25
"""Half a cycle per pixel of the sensor, in cycles per fine pixel."""


def main() -> None:
    """Print a row for each scene, or write a figure."""
    options = arguments()
    scenes = {
        "zone plate": zone_plate(2 * options.size),
        "smooth": smooth(2 * options.size),
        **photographs(options.photographs, options.images),
    }
    if options.figure is not None:
        draw(scenes, options.figure, options.size)
        return
    print("| frames | photons | scene | " + " | ".join(METHODS) + " | gain | detail |")
    print(f"| ---: | ---: | --- |{' ---: |' * (len(METHODS) + 2)}")
    for frames in options.frames:
        for photons in options.photons:
            gains = []
            for name, image in scenes.items():
                gain = measure(name, image, frames, photons, options.size)
                if name not in ("zone plate", "smooth"):
                    gains.append(gain)
            mean = f"{np.mean(gains):+.2f}" if gains else ""
            print(
                f"| {frames} | {photons} | mean of photographs |"
                + " |" * len(METHODS)
                + f" {mean} | |",
                flush=True,
            )


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=6)
    parser.add_argument("--frames", nargs="+", type=int, default=[256, 1000])
    parser.add_argument("--photons", nargs="+", type=float, default=[0.05, 0.2, 0.7])
    parser.add_argument("--size", type=int, default=128, help="rows and columns of the sensor")
    parser.add_argument("--figure", type=Path, help="figure of the zone plate and a photograph")
    return parser.parse_args()


def photographs(folder: Path, number: int) -> dict[str, Image]:
    """Return the first images of a folder by their names."""
    files = sorted(path.stem.removesuffix("-lossless") for path in folder.iterdir())
    images = read_image_set(folder, first=number)[1]
    return dict(zip(files[:number], images, strict=True))


def zone_plate(size: int) -> Image:
    """Return a zone plate with a margin: 0.34 cycles per pixel at the middle of the border."""
    radius = squared_radius(size + 160)
    return 0.5 + 0.45 * np.cos(2 * np.pi * 0.34 / size * radius)


def squared_radius(size: int) -> Image:
    """Return the squared distance from the center, in pixels."""
    rows, columns = np.indices((size, size)) - (size - 1) / 2
    return rows**2 + columns**2


def smooth(size: int) -> Image:
    """Return a scene without fine detail."""
    rows, columns = np.indices((size + 160, size + 160))
    return 0.5 + 0.3 * np.sin(rows / 60) * np.cos(columns / 45)


def record(image: Image, frames: int, photons: float, size: int) -> tuple[Any, jl.Bits]:
    """Return a shaken scene and its bits."""
    scene = jl.datasets.moving(
        image,
        "shake",
        sensor=jl.Sensor(frames=frames),
        shape=(size, size),
        photons=photons,
        detail=2,
        rng=0,
    )
    return scene, jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)


def estimates(bits: jl.Bits, truth: Image) -> dict[str, Image]:
    """Return the images of all methods."""
    network, motion = jl.pretrained(bits.sensor), jl.align(bits)
    coarse = network.reconstruct(jl.merge(bits, motion=motion))
    fine = jl.merge(bits, motion=motion, upsample=2)
    return {
        "enlarged": bicubic(coarse),
        "deconvolved": deconvolve(network, fine),
        "TV": best_total_variation(network, fine, truth),
        "upsample": network.reconstruct(fine),
        "direct": direct(network, fine, truth),
    }


def measure(name: str, image: Image, frames: int, photons: float, size: int) -> float:
    """Print the row of a scene, and return the gain over the enlarged image."""
    scene, bits = record(image, frames, photons, size)
    truth = scene.image(upsample=2)
    images = estimates(bits, truth)
    values = {method: quality(each, truth) for method, each in images.items()}
    gain = values["upsample"] - values["enlarged"]
    detail = ""
    if name in ("zone plate", "smooth"):
        function = contrast if name == "zone plate" else lines
        format_ = "{:.2f}" if name == "zone plate" else "{:.1f}"
        pair = (function(images[method], truth) for method in ("enlarged", "upsample"))
        detail = ", ".join(format_.format(each) for each in pair)
    cells = " | ".join(f"{values[method]:.2f}" for method in METHODS)
    print(f"| {frames} | {photons} | {name} | {cells} | {gain:+.2f} | {detail} |", flush=True)
    return gain


def inner(image: Image) -> Image:
    """Return an image without its border."""
    return np.asarray(image[BORDER:-BORDER, BORDER:-BORDER], np.float32)


def quality(image: Image, truth: Image) -> float:
    """Return the PSNR in dB."""
    clipped = np.clip(inner(image), 0, 1)
    return float(jl.metrics.psnr(clipped, inner(truth), data_range=1.0))


def contrast(image: Image, truth: Image) -> float:
    """Return the contrast of the zone plate around the Nyquist frequency of the sensor."""
    size = len(truth)
    frequency = 2 * 0.34 / size * np.sqrt(squared_radius(size))
    ring = inner(abs(frequency - NYQUIST) < 0.02) > 0
    shown, wanted = inner(image)[ring], inner(truth)[ring] - 0.5
    return float(((shown - shown.mean()) * wanted).sum() / (wanted**2).sum())


def lines(image: Image, truth: Image) -> float:
    """Return the root mean square error of differences of neighbors, times 1,000."""
    error = inner(image) - inner(truth)
    squares = [np.mean(np.diff(error, axis=axis) ** 2) for axis in (0, 1)]
    return 1000 * float(np.sqrt(np.mean(squares)))


def bicubic(image: Image) -> Image:
    """Return an image with twice as many rows and columns."""
    places = np.meshgrid(*[(np.arange(2 * n) - 0.5) / 2 for n in image.shape], indexing="ij")
    return map_coordinates(image, places, order=3, mode="nearest")


def deconvolve(network: jl.Network, fine: jl.Merged, weight: float = 0.1) -> Image:
    """Return the regularized inverse of the mean of squares, from the light of the squares."""
    ones, trials = (np.asarray(each, np.float32) for each in (fine.ones, fine.trials))
    p = np.clip(denoise_map(network, ones, trials), 0, 1 - 1e-6)
    means = -np.log1p(-p) / fine.sensor.light_per_intensity
    height, width = means.shape
    mirrored = np.pad(means, ((0, height), (0, width)), mode="symmetric")
    frequencies = np.meshgrid(
        *[np.fft.fftfreq(length) for length in mirrored.shape], indexing="ij", sparse=True
    )
    rows, columns = (0.5 + 0.5 * np.exp(2j * np.pi * each) for each in frequencies)
    response = rows * columns
    inverse = (1 + weight) * response.conj() / (abs(response) ** 2 + weight)
    return np.fft.ifft2(inverse * np.fft.fft2(mirrored)).real[:height, :width]


def best_total_variation(network: jl.Network, fine: jl.Merged, truth: Image) -> Image:
    """Return the image with the best weight of total variation, known from the true image."""
    squares, scale = Squares.of(fine), fine.sensor.light_per_intensity
    best, most = np.zeros_like(truth), -np.inf
    for weight in np.geomspace(0.1, 1.6, 5):
        light = scale * np.clip(bicubic_of_counts(network, fine), 1e-3, 1)
        for penalty in np.geomspace(1, 64, 8):
            information = squares.derivatives(average_squares(light))[1]
            precision = 0.03 * penalty * float(information.mean())
            noisy = fit_light(squares, light, np.full(light.shape, precision))
            # The noise has at most the variance 1/(4 precision), and TV needs about its deviation.
            light = denoise_tv_chambolle(noisy, weight / (2 * precision**0.5))
            light = np.maximum(light, 1e-3 * scale)
        found = quality(light / scale, truth)
        if found > most:
            best, most = light / scale, found
    return best


def bicubic_of_counts(network: jl.Network, fine: jl.Merged) -> Image:
    """Return the enlarged image from which the iterations start."""
    from jotlight.networks.inference.finer_grid import coarse_counts

    return enlarge(network.reconstruct(coarse_counts(fine)))


def direct(network: jl.Network, fine: jl.Merged, truth: Image) -> Image:
    """Return the image from counts of single fine pixels with the same numbers of trials."""
    rng = np.random.default_rng(0)
    trials = np.full(fine.shape, round(float(np.mean(fine.trials))))
    p = -np.expm1(-fine.sensor.light_per_intensity * truth.astype(np.float64))
    ones = rng.binomial(trials, p)
    return network.reconstruct(jl.Merged(ones, trials.astype(float), fine.sensor))


def draw(scenes: dict[str, Image], path: Path, size: int) -> None:
    """Write a figure: the enlarged image, that of the finer grid, and the scene, of two scenes."""
    from jotlight.figures import Figure

    figure = Figure(9.0, 6.6)
    axes = figure.subplots(2, 3)
    for row, name in zip(axes, ("zone plate", list(scenes)[-1]), strict=True):
        scene, bits = record(scenes[name], 256, 0.7, size)
        truth = scene.image(upsample=2)
        network, motion = jl.pretrained(bits.sensor), jl.align(bits)
        enlarged = bicubic(network.reconstruct(jl.merge(bits, motion=motion)))
        fine = network.reconstruct(jl.merge(bits, motion=motion, upsample=2))
        images = {"enlarged": enlarged, "upsample=2": fine, "scene": truth}
        # The rings are fine in the corners.
        start = size - BORDER if name == "zone plate" else size // 2
        part = slice(start, start + size), slice(start, start + size)
        for place, (title, image) in zip(row, images.items(), strict=True):
            note = "" if title == "scene" else f", {quality(image, truth):.1f} dB"
            place.imshow(image[part], cmap="gray", vmin=0, vmax=1, interpolation="nearest")
            place.set_title(title + note)
            place.set_axis_off()
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
