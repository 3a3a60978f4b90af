"""Measure the colors of mosaics on photographs: choices, tables, and images.

    python benchmarks/studies/mosaics.py choices DATA
    python benchmarks/studies/mosaics.py table DATA
    python benchmarks/studies/mosaics.py dim DATA
    python benchmarks/studies/mosaics.py patterns DATA
    python benchmarks/studies/mosaics.py channels DATA
    python benchmarks/studies/mosaics.py light DATA
    python benchmarks/studies/mosaics.py motion DATA
    python benchmarks/studies/mosaics.py images DATA FOLDER

`choices` uses six photographs of photographs/cid22, on which the constants were chosen: the spread
of the differences, and planes by position or by filter. The others use the first ten of
photographs/gb82, which nothing was chosen on, or their middle. All numbers are PSNR in dB,
averaged over the images.
"""

import argparse
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.estimators import demosaicing
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.networks import pretrained
from jotlight.networks.color import mosaic_planes
from jotlight.networks.color.color_inference import planes_of_channels, planes_of_mosaic
from jotlight.networks.planes.color_planes import CENTER, START
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.reading_groups import without_mosaic

Array = npt.NDArray[np.floating]

XTRANS = "GBGGRG/RGRBGB/GBGGRG/GRGGBG/BGBRGR/GRGGBG"
"""The mosaic of X-Trans sensors."""

CLEAR = 0.758
"""Share of clear pixels in the RGBW mosaic of SwissSPAD2. Each color has 8.07 %."""


def photographs(data: Path, folder: str, number: int, side: int | None = None) -> Iterator[Array]:
    """Yield color photographs from 0 to 1, the first ones of a folder or their middle."""
    for path in sorted((data / "photographs" / folder).glob("*.webp"))[:number]:
        image = np.asarray(jl.read_image(path), np.float64)
        if side is not None:
            top, left = ((size - side) // 2 for size in image.shape[:2])
            image = image[top : top + side, left : left + side]
        yield image


def random_rgbw(shape: tuple[int, ...]) -> Mosaic:
    """Return a random mosaic with the shares of SwissSPAD2, a map of all pixels."""
    color = (1 - CLEAR) / 3
    places = np.random.default_rng(0).choice(4, size=shape[:2], p=[color] * 3 + [CLEAR])
    return Mosaic(places, "RGBW")


def psnr(estimate: Array, image: Array) -> float:
    """Return the PSNR in dB, for a largest value of 1."""
    return float(-10 * np.log10(np.mean((estimate - image) ** 2)))


def mixed_filters() -> Mosaic:
    """Return a Bayer mosaic whose filters pass 80 % of their color, and some light of others."""
    mixed = [[0.8, 0.15, 0.05], [0.1, 0.8, 0.1], [0.05, 0.2, 0.8]]
    return Mosaic("RGGB", transmission=mixed)


def measure(mosaic: str, images: list[Array], trials: int, light: float = 1.0, **options) -> float:
    """Return the mean PSNR of reconstructions of images through a mosaic."""
    values = []
    for seed, image in enumerate(images):
        own = _mosaic_of(mosaic, image.shape)
        sensor = jl.Sensor(frames=trials, gain=trials * light, mosaic=own)
        bits = sensor.expose(image, rng=seed)
        values.append(psnr(jl.reconstruct(bits, **options), image))
    return float(np.mean(values))


def _mosaic_of(name: str, shape: tuple[int, ...]) -> Mosaic:
    if name == "mixed RGGB":
        return mixed_filters()
    return random_rgbw(shape) if name == "random RGBW" else Mosaic.of(name)


def patterns(data: Path) -> None:
    """Print the color network beside its start, color differences, for all kinds of mosaics."""
    images = list(photographs(data, "gb82", 10, 256))
    print("mosaic: differences, K = 4, 16, 64; color network")
    names = "RGGB", "RGBW", "RRGG/RRGG/GGBB/GGBB", XTRANS, "random RGBW", "CMYG", "mixed RGGB"
    for name in names:
        row = [
            measure(name, images, trials, demosaicing=after)
            for after in ("differences", "network")
            for trials in (4, 16, 64)
        ]
        print(name, *(f"{value:.2f}" for value in row), flush=True)


def channels(data: Path) -> None:
    """Print three counts per pixel: the color network, and gray networks for each channel."""
    images = list(photographs(data, "gb82", 10))
    print("method: K = 4, 16, 64")
    methods = {
        "color network": jl.reconstruct,
        "its start": start_of_channels,
        "medium": partial(jl.reconstruct, quality="medium"),
        "large": partial(jl.reconstruct, quality="large"),
    }
    for title, method in methods.items():
        row = []
        for trials in (4, 16, 64):
            sensor = jl.Sensor(frames=trials)
            values = []
            for seed, image in enumerate(images):
                bits = sensor.expose(image, rng=seed, channel_axis=-1)
                values.append(psnr(method(bits), image))
            row.append(float(np.mean(values)))
        print(title, *(f"{value:.2f}" for value in row), flush=True)


def light(data: Path) -> None:
    """Print three counts per pixel in bright light: the color network, and medium per channel."""
    images = list(photographs(data, "gb82", 4, 256))
    mean = float(np.mean(images))
    print("K = 16, detections per jot and frame: color network, medium")
    for photons in (1, 2, 4, 8, 16):
        sensor = jl.Sensor(frames=16, gain=16 * photons)
        exposed = [
            sensor.expose(image, rng=seed, channel_axis=-1) for seed, image in enumerate(images)
        ]
        row = []
        for options in ({}, {"method": "network-medium"}):
            pairs = zip(exposed, images, strict=True)
            row.append(
                np.mean([psnr(jl.reconstruct(bits, **options), image) for bits, image in pairs])
            )
        print(f"{photons * mean:.2f}:", *(f"{value:.2f}" for value in row), flush=True)


def start_of_channels(bits: jl.Bits) -> Array:
    """Return the classical colors of three channels that the color network improves."""
    sensor = bits.sensor
    counted = [count_pixels(each, sensor, None) for each in bits.channels()]
    gray = pretrained.pretrained_conditional(sensor, pretrained.COLOR_START)
    return _start(planes_of_channels(gray, counted, None), sensor)


def start_of_mosaic(bits: jl.Bits) -> Array:
    """Return the classical colors of a mosaic that the color network improves."""
    mosaic, sensor = bits.sensor.mosaic, without_mosaic(bits.sensor)
    gray = pretrained.pretrained_conditional(sensor, pretrained.COLOR_START)
    counted = count_pixels(bits, sensor, None)
    return _start(planes_of_mosaic(gray, counted, mosaic, None), sensor)


def _start(planes: Array, sensor: jl.Sensor) -> Array:
    probability = np.sin(planes[START] + CENTER).astype(np.float32) ** 2
    return np.moveaxis(intensity_from_probability(probability, sensor, None), 0, -1)


def motion(data: Path) -> None:
    """Print the colors of moving scenes behind RGGB: merged, and by the best window."""
    images = list(photographs(data, "gb82", 6))
    print("scene, photons: merged; best window; its frames; flagged pixels in %")
    frames, shape = 256, (256, 384)
    for kind in ("static", "shake"):
        for photons in (0.05, 0.2):
            rows = [_moving(image, kind, photons, frames, shape) for image in images]
            merged, window, length, flagged = np.mean(rows, axis=0)
            print(
                f"{kind}, {photons}: {merged:.2f} {window:.2f} {length:.0f} {100 * flagged:.0f}",
                flush=True,
            )


def _moving(
    image: Array, kind: str, photons: float, frames: int, shape: tuple[int, int]
) -> tuple[float, float, int, float]:
    sensor = jl.Sensor(frames=frames, mosaic="RGGB")
    scene = jl.datasets.moving(image, kind, sensor=sensor, shape=shape, photons=photons, rng=7)
    bits = jl.Bits(np.asarray(scene.bits.packed), shape[1], scene.bits.sensor)
    found, truth = jl.align(bits), scene.image()
    data = bits if found.model == "none" else jl.merge(bits, motion=found)
    value = psnr(jl.reconstruct(data), truth)
    flagged = 0.0 if data is bits else float(data.flags.mean())
    windows = {}
    for length in (4, 8, 16, 32, 64, 128, 256):
        first = (frames - length) // 2
        windows[length] = psnr(jl.reconstruct(bits[first : first + length]), truth)
    best = max(windows, key=windows.__getitem__)
    return value, windows[best], best, flagged


def choices(data: Path) -> None:
    """Print what the spread of differences and the kind of planes change."""
    images = list(photographs(data, "cid22", 6, 256))
    spreads = (0.5, 1.0, 1.5, 2.0, 3.0)
    print("mosaic, K:", *(f"spread {spread}" for spread in spreads))
    for mosaic in ("RGGB", "RGBW", "RRGG/RRGG/GGBB/GGBB", XTRANS, "random RGBW"):
        for trials in (4, 64):
            row = []
            for demosaicing.SPREAD in spreads:
                row.append(measure(mosaic, images, trials, demosaicing="differences"))
            print(mosaic, trials, *(f"{value:.2f}" for value in row), flush=True)
    demosaicing.SPREAD = 1.5  # the middle of the spreads, for the comparison of planes
    print("mosaic, K: planes by position, by filter")
    for mosaic in ("RGGB", "RGBW", "RRGG/RRGG/GGBB/GGBB", XTRANS):
        for trials in (4, 64):
            row = []
            for mosaic_planes.MAX_POSITIONS in (36, 0):
                row.append(measure(mosaic, images, trials, demosaicing="differences"))
            print(mosaic, trials, *(f"{value:.2f}" for value in row), flush=True)


def table(data: Path) -> None:
    """Print the table of RGGB: methods and demosaicing, K = 4, 16, and 64."""
    images = list(photographs(data, "gb82", 10))
    print("method, demosaicing: K = 4, 16, 64")
    for pretrained.MOSAIC_ROTATIONS in (1, 4):  # at the end, the default number
        row = [measure("RGGB", images, trials) for trials in (4, 16, 64)]
        rotations = pretrained.MOSAIC_ROTATIONS
        print(
            f"color network, {rotations} rotations", *(f"{value:.2f}" for value in row), flush=True
        )
    row = []
    for trials in (4, 16, 64):
        sensor = jl.Sensor(frames=trials, mosaic="RGGB")
        exposed = [sensor.expose(image, rng=seed) for seed, image in enumerate(images)]
        pairs = zip(exposed, images, strict=True)
        row.append(np.mean([psnr(start_of_mosaic(bits), image) for bits, image in pairs]))
    print("its start", *(f"{value:.2f}" for value in row), flush=True)
    for method in ("network-medium", "mle"):
        for after in ("menon", "differences"):
            row = [
                measure("RGGB", images, trials, method=method, demosaicing=after)
                for trials in (4, 16, 64)
            ]
            print(method, after, *(f"{value:.2f}" for value in row), flush=True)


def dim(data: Path) -> None:
    """Print RGGB and RGBW side by side in dim light: photons per jot and frame at intensity 1."""
    images = list(photographs(data, "gb82", 10))
    print("light, K = 16: RGGB menon; RGGB, RGBW, random RGBW differences; the same by the network")
    for light in (1.0, 0.25, 0.0625):
        row = [measure("RGGB", images, 16, light, demosaicing="menon")]
        row += [
            measure(mosaic, images, 16, light, demosaicing="differences")
            for mosaic in ("RGGB", "RGBW", "random RGBW")
        ]
        row += [measure(mosaic, images, 16, light) for mosaic in ("RGGB", "RGBW", "random RGBW")]
        print(light, *(f"{value:.2f}" for value in row), flush=True)


def zone_plate(side: int = 256) -> Array:
    """Return rings whose frequency rises to half a cycle per pixel, as a gray color image."""
    y, x = np.mgrid[:side, :side] - side / 2
    rings = 0.5 + 0.5 * np.cos(np.pi * (x**2 + y**2) / side)
    return np.repeat(rings[..., None], 3, axis=2)


def by_frequency(chroma: Array) -> list[str]:
    """Return the errors of the color of a zone plate, for ranges of cycles per pixel."""
    side = len(chroma)
    y, x = np.abs(np.mgrid[:side, :side] - side / 2) / side
    frequency, squares = np.maximum(y, x), (chroma**2).mean(axis=2)
    ranges = (0, 0.1), (0.1, 0.2), (0.2, 0.3), (0.3, 0.35), (0.35, 0.4), (0.4, 0.5)
    texts = []
    for low, high in ranges:
        error = np.sqrt(squares[(frequency >= low) & (frequency < high)].mean())
        texts.append(f"{low} to {high} cycles per pixel {error:.3f}")
    return texts


def text(side: int = 256) -> Array:
    """Return black text on white, and white text on a colored ground."""
    from PIL import Image, ImageDraw

    image = Image.new("RGB", (side, side), "white")
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, side // 2, side, side), fill=(30, 60, 160))
    for row in range(16):
        ink = "black" if row < 8 else "white"
        draw.text((6, 16 * row + 2), "Photons arrive one by one. 0123456789", fill=ink)
    return np.asarray(image, np.float64) / 255


def images(data: Path, folder: Path) -> None:
    """Write estimates of a zone plate and of text, and their deviation from gray or the truth."""
    for name, image in (("zone_plate", zone_plate()), ("text", text())):
        for mosaic in ("RGGB", "RGBW"):
            for after in ("menon", "differences", "network")[mosaic != "RGGB" :]:
                bits = jl.Sensor(frames=64, mosaic=mosaic).expose(image, rng=0)
                estimate = jl.reconstruct(bits, demosaicing=after)
                chroma = estimate - estimate.mean(axis=2, keepdims=True)
                chroma -= image - image.mean(axis=2, keepdims=True)
                error = float(np.sqrt(np.mean(chroma**2)))
                print(f"{name} {mosaic} {after}: PSNR {psnr(estimate, image):.2f}", end=", ")
                print(f"root mean square error of the color {error:.4f}")
                if name == "zone_plate":
                    print("    of rings:", ", ".join(by_frequency(chroma)))
                both = np.concatenate([image, estimate], axis=1).astype(np.float32)
                jl.save_image(folder / f"{name}_{mosaic}_{after}.png", both)


MEASUREMENTS = {
    each.__name__: each for each in (choices, table, dim, patterns, channels, light, motion)
}


def main() -> None:
    """Run one of the measurements."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=[*MEASUREMENTS, "images"])
    parser.add_argument("data", type=Path)
    parser.add_argument("folder", type=Path, nargs="?")
    arguments = parser.parse_args()
    if arguments.what == "images":
        arguments.folder.mkdir(exist_ok=True)
        images(arguments.data, arguments.folder)
    else:
        MEASUREMENTS[arguments.what](arguments.data)


if __name__ == "__main__":
    main()
