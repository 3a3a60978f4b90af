"""Measure the coverage of the intervals of colors behind a mosaic.

    python benchmarks/studies/color_intervals.py DATA [--mosaics RGGB RGBW random channels]

The images are the first ten photographs of ``photographs/gb82``, which neither train nor validate.
For each mosaic, K, and method, the table shows how many exact intensities lie in the intervals of
90 %: of each color, of a color behind its own filter and behind others, of the darkest and the
brightest third of the pixels, and of the third with the least and the most activity. The last
columns are the median of the width, and of the error.

"channels" are three counts per pixel. "RGGB bracket" has the gains 4, 1, and 1/4, each in a third
of at least three frames. "RGGB thresholds" has a checkerboard of thresholds 1 and 3.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import jotlight as jl
from jotlight.sensing.parameters.mosaic import Mosaic

SIDE = 256
LEVEL = 0.9
Array = NDArray[np.float64]

METHODS = {
    "color network": {},
    "medium, differences": {"quality": "medium", "demosaicing": "differences"},
}
"""Arguments of `jl.reconstruct` by the name of the method."""

COLUMNS = (
    *("mosaic", "K", "photons", "method", "all", "red", "green", "blue", "own", "others"),
    *("dark", "bright", "flat", "active", "width", "error"),
)


def photographs(data: Path, number: int) -> list[Array]:
    """Return the central parts of the first photographs."""
    files = sorted((data / "photographs/gb82").iterdir())[:number]
    images = []
    for file in files:
        image = jl.read_image(file).astype(np.float64)
        top, left = (max(0, (size - SIDE) // 2) for size in image.shape[:2])
        images.append(image[top : top + SIDE, left : left + SIDE])
    return images


def mosaic_of(name: str, shape: tuple[int, ...]) -> Mosaic:
    """Return a mosaic by its name; "random" is the RGBW of SwissSPAD2."""
    if not name.startswith("random"):
        return Mosaic.of(name.split()[0])
    rng = np.random.default_rng(5)
    pattern = rng.choice(4, shape[:2], p=[0.0807, 0.0807, 0.0807, 0.7579]).astype(np.uint8)
    return Mosaic(pattern, "RGBW")


def sensor_of(name: str, trials: int, photons: float, shape: tuple[int, ...]) -> jl.Sensor:
    """Return the sensor of a row."""
    if name == "channels":
        return jl.Sensor(frames=trials, gain=photons * trials)
    sensor = jl.Sensor(frames=trials, gain=photons * trials, mosaic=mosaic_of(name, shape))
    if name.endswith("bracket"):
        frames = max(3, trials // 3 * 3)
        return sensor.replace(frames=frames, gain=photons * np.repeat([4, 1, 1 / 4], frames // 3))
    if name.endswith("thresholds"):
        return sensor.replace(threshold=np.where(np.indices(shape[:2]).sum(axis=0) % 2, 1, 3))
    return sensor


def activity(image: Array) -> Array:
    """Return the standard deviation of the gray image in windows of 3 x 3 pixels."""
    from scipy.ndimage import uniform_filter

    gray = image.mean(axis=-1)
    return np.sqrt(np.maximum(uniform_filter(gray**2, 3) - uniform_filter(gray, 3) ** 2, 0))


def classes(image: Array, mosaic: Mosaic | None) -> dict[str, NDArray[np.bool_]]:
    """Return the pixels and colors of each class, (H, W, 3)."""
    ones = np.ones(image.shape, bool)
    shares = np.ones(image.shape)
    if mosaic is not None:
        shares = mosaic.transmission[mosaic.full(*image.shape[:2])]
    found = {"all": ones}
    for index, name in enumerate(("red", "green", "blue")):
        found[name] = ones & (np.arange(3) == index)
    found |= {"own": shares > 0, "others": shares == 0}
    for values, names in ((image, ("dark", "bright")), (activity(image), ("flat", "active"))):
        low, high = np.quantile(values, (1 / 3, 2 / 3))
        each = values if values.ndim == 3 else values[..., None]
        found[names[0]], found[names[1]] = ones & (each <= low), ones & (each >= high)
    return found


def measure(
    images: list[Array], name: str, trials: int, photons: float, options: dict[str, str]
) -> list[str]:
    """Return the coverage of each class, and the medians of width and error, as texts."""
    inside: dict[str, list[NDArray[np.bool_]]] = {}
    widths, errors = [], []
    for seed, image in enumerate(images):
        sensor = sensor_of(name, trials, photons, image.shape)
        options = {key: options[key] for key in options if sensor.mosaic or key == "quality"}
        bits = sensor.expose(image, rng=seed, channel_axis=-1)
        estimate = jl.reconstruct(bits, **options)
        found = jl.uncertainty(bits, estimate=estimate, confidence_level=LEVEL, **options)
        covered = (found.low <= image) & (image <= found.high)
        for key, chosen in classes(image, sensor.mosaic).items():
            inside.setdefault(key, []).append(covered[chosen])
        widths.append(np.median(found.high - found.low))
        errors.append(np.median(abs(estimate - image)))
    shares = [
        f"{100 * np.concatenate(parts).mean():.1f}" if sum(map(len, parts)) else ""
        for parts in inside.values()
    ]
    return [*shares, f"{np.mean(widths):.3f}", f"{np.mean(errors):.3f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--mosaics", nargs="+", default=["RGGB", "RGBW", "random"])
    parser.add_argument("--trials", nargs="+", type=int, default=[1, 4, 16, 64, 256])
    parser.add_argument("--photons", nargs="+", type=float, default=[0.2, 1.0])
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=list(METHODS))
    parser.add_argument("--images", type=int, default=10)
    options = parser.parse_args()
    warnings.simplefilter("ignore", jl.JotlightWarning)
    images = photographs(options.data, options.images)
    print("| " + " | ".join(COLUMNS) + " |")
    print("| --- | ---: | ---: | --- |" + " ---: |" * (len(COLUMNS) - 4))
    for name in options.mosaics:
        for trials in options.trials:
            for photons in options.photons:
                for method in options.methods:
                    row = measure(images, name, trials, photons, METHODS[method])
                    first = [name, str(trials), f"{photons:g}", method]
                    print("| " + " | ".join([*first, *row]) + " |", flush=True)


if __name__ == "__main__":
    main()
