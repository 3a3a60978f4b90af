"""Draw images of moving scenes, their errors, and their flags.

    python benchmarks/studies/moving_scene_flags.py PHOTOGRAPHS [--frames 256] [--photons 0.2]
        [--output docs/results/motion_flags.jpg]

PHOTOGRAPHS is a folder, whose second image in the order of the names is the background, and the
third one the foreground. Each row shows a scene: the best window without alignment, the merged
image, its absolute error, from 0 to 0.2 of the largest intensity, and its flags in red.
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

import jotlight as jl
from jotlight.images.sets import read_image_set

SCENES = "shake", "layers", "spin", "parallax", "sheet", "flicker", "appear"
WINDOWS = (4, 8, 16, 32, 64, 128)
MAX_ERROR = 0.2

Image = npt.NDArray[np.float32]


def main() -> None:
    """Draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--frames", type=int, default=256)
    parser.add_argument("--photons", type=float, default=0.2)
    parser.add_argument("--output", type=Path, default=Path("docs/results/motion_flags.jpg"))
    options = parser.parse_args()
    _, images = read_image_set(options.photographs, first=3)
    figure = Figure(figsize=(8, 2.15 * len(SCENES)), facecolor="white", layout="constrained")
    axes = figure.subplots(len(SCENES), 4)
    for name, row in zip(SCENES, axes, strict=True):
        scene = jl.datasets.moving(
            images[1],
            name,
            sensor=jl.Sensor(frames=options.frames),
            foreground=images[2],
            shape=(192, 192),
            photons=options.photons,
            rng=0,
        )
        for panel, (title, image) in zip(row, panels(name, scene), strict=True):
            panel.imshow(image, cmap="gray", vmin=0, vmax=1)
            panel.set_title(title, fontsize=8)
            panel.set_axis_off()
        print(name, *(panel.get_title() for panel in row), sep=" | ", flush=True)
    figure.savefig(options.output, dpi=100)


def panels(name: str, scene: jl.datasets.MovingScene) -> list[tuple[str, Image]]:
    """Return the titles and the images of a row."""
    bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)
    truth, network = scene.image(), jl.pretrained(scene.sensor)
    windows = {}
    for length in (*WINDOWS, len(bits)):
        start = scene.reference - length // 2
        part = bits[start : start + length]
        windows[length] = network.reconstruct(part, part.sensor)
    best = max(windows, key=lambda length: jl.metrics.psnr(windows[length], truth))
    merged = jl.merge(bits)
    image = network.reconstruct(merged)
    gray = np.clip(image, 0, 1)[..., None].repeat(3, axis=2)
    gray[merged.flags] = 0.6 * gray[merged.flags] + [0.4, 0, 0]
    return [
        (f"{name}: {best} frames, {quality(windows[best], truth)}", windows[best]),
        (f"merged, {quality(image, truth)}", image),
        ("error", abs(image - truth) / MAX_ERROR),
        (f"flags, {merged.flags.mean():.0%} of the pixels", gray),
    ]


def quality(image: Image, truth: Image) -> str:
    """Return the PSNR as text."""
    return f"{jl.metrics.psnr(image, truth, data_range=1.0):.1f} dB"


if __name__ == "__main__":
    main()
