"""Compare images of moving scenes: aligned, with the exact motion, and without alignment.

    python benchmarks/studies/moving_scenes.py PHOTOGRAPHS [--images 2] [--seeds 1]
        [--motions shake layers] [--frames 64 256] [--photons 0.2]

PHOTOGRAPHS is a folder. Its first images in the order of their names are the backgrounds, each with
the next one as foreground. The network "medium" estimates all images of 256 x 256 pixels. The table
shows the PSNR in dB without a border of 8 pixels, averaged over images and seeds:

- sum: all frames, without alignment.
- window: the number of frames around the reference time that is best, chosen with the true image.
- aligned: all bits along the estimated motion.
- consistent: without the bits that disagree with the rest.
- true motion: visible bits along the exact motion.

A scene of 256 frames takes about ten seconds on two cores.
"""

import argparse
import itertools
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.datasets.moving_scenes import MovingScene
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.images.sets import read_image_set
from jotlight.motion.align import divide
from jotlight.motion.blocks import Blocks, Sums
from jotlight.networks.trials_map import denoise_map

SIZE = 256, 256
BORDER = 8
WINDOWS = (4, 8, 16, 32, 64, 128, 256)
COLUMNS = ("sum", "window", "aligned", "consistent", "true motion")

Image = npt.NDArray[np.float32]


def main() -> None:
    """Measure all scenes, and print a row for each kind."""
    options = arguments()
    _, images = read_image_set(options.photographs, first=options.images + 1)
    print(f"| motion | frames | photons | {' | '.join(COLUMNS)} | model |")
    print(f"| --- |{' ---: |' * (len(COLUMNS) + 2)} --- |")
    kinds = itertools.product(options.motions, options.frames, options.photons)
    for motion, frames, photons in kinds:
        rows, models = [], []
        for index, seed in itertools.product(range(options.images), range(options.seeds)):
            scene = jl.datasets.moving(
                images[index],
                motion,
                sensor=jl.Sensor(frames=frames),
                foreground=images[index + 1],
                shape=SIZE,
                photons=photons,
                rng=seed,
            )
            row, model = measure(scene)
            rows.append(row)
            models.append(model)
        cells = " | ".join(f"{value:.2f}" for value in np.mean(rows, axis=0))
        names = ", ".join(f"{models.count(name)} {name}" for name in sorted(set(models)))
        print(f"| {motion} | {frames} | {photons} | {cells} | {names} |", flush=True)


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=2)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--motions", nargs="+", default=["static", "shake", "rotate", "fast"])
    parser.add_argument("--frames", nargs="+", type=int, default=[256])
    parser.add_argument("--photons", nargs="+", type=float, default=[0.2])
    return parser.parse_args()


def measure(scene: MovingScene) -> tuple[list[float], str]:
    """Return the PSNR of each column, and the model of the estimated motion."""
    bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)
    truth, frames = scene.image(), len(bits)

    def quality(ones: npt.NDArray[np.generic], trials: npt.NDArray[np.generic]) -> float:
        inner = (slice(BORDER, -BORDER),) * 2
        image = estimate(scene.sensor, ones.astype(np.float32), trials.astype(np.float32))
        return float(jl.metrics.psnr(image[inner], truth[inner], peak=1.0))

    windows = []
    for length in sorted({min(length, frames) for length in (*WINDOWS, frames)}):
        start = scene.reference - length // 2
        counts = bits[start : start + length].counts()
        windows.append(quality(counts, np.full(SIZE, length)))
    blocks = Blocks(bits, divide(frames), None, None)
    motion = estimate_motion(blocks, scene.reference)
    track = Track(
        blocks,
        scene.reference,
        np.stack([motion.nodes_at(time) for time in blocks.centers]).astype(np.float64),
        np.ones(len(blocks.centers), bool),
    )
    aligned = Sums.zeros(SIZE)
    for block in range(len(blocks.centers)):
        aligned = aligned + track.sums(block)
    consistent, _ = merge_consistent(track)
    row = [
        windows[-1],
        max(windows),
        quality(aligned.ones, aligned.trials),
        quality(consistent.ones, consistent.trials),
        quality(*merge_exactly(scene, bits)),
    ]
    return row, motion.model


def estimate(sensor: jl.Sensor, ones: Image, trials: Image) -> Image:
    """Return the intensities that the network "medium" estimates."""
    probability = denoise_map(jl.pretrained(jl.Sensor()), ones, trials)
    return intensity_from_probability(probability, sensor, None)


def merge_exactly(scene: MovingScene, bits: jl.Bits) -> tuple[npt.NDArray[np.int64], ...]:
    """Return the ones and the trials of the visible bits along the exact motion."""
    ones, trials = np.zeros((2, *SIZE), np.int64)
    positions = np.indices(SIZE)
    for time, frame in enumerate(bits.to_array()):
        rows, columns = positions + np.rint(scene.motion(time)).astype(int)
        seen = scene.visible(time)
        seen &= (rows >= 0) & (rows < SIZE[0]) & (columns >= 0) & (columns < SIZE[1])
        ones[seen] += frame[rows[seen], columns[seen]]
        trials += seen
    return ones, trials


if __name__ == "__main__":
    main()
