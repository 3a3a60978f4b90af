"""Compare images of moving scenes: merged, with the exact motion, and without alignment.

    python benchmarks/studies/moving_scenes.py PHOTOGRAPHS [--images 6] [--seeds 3]
        [--motions static shake rotate fast layers] [--frames 64 256 1000]
        [--photons 0.05 0.2 0.7] [--output docs/results] [--workers 2]

PHOTOGRAPHS is a folder. Its first images in the order of their names are the backgrounds, each with
the next one as foreground. A run continues the table of an earlier one in the same folder. The
network "medium" estimates all images but those of the film network, of 256 x 256 pixels. The table
shows the PSNR in dB without a border of 8 pixels, averaged over images and seeds:

- sum: all frames, without alignment.
- window: the number of frames around the reference time that is best, chosen with the true image.
- DIS: dense optical flow between denoised sums of blocks, as computed by OpenCV, and merged. It is
  left out if the package opencv-python-headless is not installed.
- merged: `jotlight.merge`.
- film network: a film of one image, by the film network.
- true motion: visible bits along the exact motion.

The columns "box merged" and "box true" are the PSNR of merged and of the true motion within the
bounding box of all objects, or of the whole image if there are none. They and "film network" are
empty in rows of earlier versions. The other columns are about single images: the largest difference
of the true motion minus merged; the smallest difference of merged minus window; the mean fraction
of pixels that are flagged; and the fraction of the excess of the squared error over that of the
true motion that is in flagged pixels, of all images together. A scene of 256 frames takes about
eight seconds on one core.
"""

import argparse
import csv
import functools
import importlib.util
import itertools
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from borders import INNER, psnr_inside

import jotlight as jl
from jotlight.datasets.moving_scenes import MovingScene
from jotlight.images.sets import read_image_set
from jotlight.motion.agreement.consistency import find_consistent
from jotlight.motion.align import prepare_burst
from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.sums import Sums
from jotlight.motion.films.estimates import estimate_film
from jotlight.motion.films.film import film

SIZE = 256, 256
WINDOWS = (2, 4, 8, 16, 32, 64, 128, 256, 512)
MAX_FAST = 256
"""Maximum number of frames of "fast" scenes, which would leave the view."""

METHODS = "sum", "window", "DIS", "merged", "film network", "true motion"
BOX = "box merged", "box true"
NUMBERS = (*METHODS, "flagged", "excess", "in_flags", *BOX)
KIND = "motion", "frames", "photons", "image", "seed"
COLUMNS = (*KIND, *METHODS, "model", "flagged", "excess", "in_flags", *BOX)

Image = npt.NDArray[np.float32]
Row = dict[str, Any]


def main() -> None:
    """Measure all scenes, and print a row for each kind."""
    options = arguments()
    path = None if options.output is None else options.output / "moving_scenes.csv"
    rows = read_table(path) if path is not None and path.exists() else []
    print("| motion | frames | photons | " + " | ".join(METHODS), end=" | ")
    print("box merged | box true | largest loss | smallest gain | flagged | explained |")
    print(f"| --- |{' ---: |' * (len(METHODS) + 8)}")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.workers, context) as workers:
        for motion, frames, photons in itertools.product(
            options.motions, options.frames, options.photons
        ):
            if motion == "fast" and frames > MAX_FAST:
                continue
            scenes = [
                {
                    "motion": motion,
                    "frames": frames,
                    "photons": photons,
                    "image": image,
                    "seed": seed,
                }
                for image, seed in itertools.product(range(options.images), range(options.seeds))
            ]
            known = [row for row in rows if any(is_of(row, scene) for scene in scenes)]
            missing = [scene for scene in scenes if not any(is_of(row, scene) for row in known)]
            new = list(workers.map(partial(measure_scene, options.photographs), missing))
            rows += new
            print_row(known + new)
            if path is not None:
                write_table(path, rows)


def is_of(row: Row, scene: Row) -> bool:
    """Return whether a row is that of a scene."""
    return all(row[name] == value for name, value in scene.items())


def measure_scene(photographs: Path, kind: Row) -> Row:
    """Return the row of a scene."""
    images = read_photographs(photographs, kind["image"] + 2)
    scene = jl.datasets.moving(
        images[kind["image"]],
        kind["motion"],
        sensor=jl.Sensor(frames=kind["frames"]),
        foreground=images[kind["image"] + 1],
        shape=SIZE,
        photons=kind["photons"],
        rng=kind["seed"],
    )
    return kind | measure(scene)


@functools.cache
def read_photographs(folder: Path, number: int) -> list[Image]:
    """Return the first images of a folder, in the order of their names."""
    return read_image_set(folder, first=number)[1]


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--images", type=int, default=6)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument(
        "--motions", nargs="+", default=["static", "shake", "rotate", "fast", "layers"]
    )
    parser.add_argument("--frames", nargs="+", type=int, default=[64, 256, 1000])
    parser.add_argument("--photons", nargs="+", type=float, default=[0.05, 0.2, 0.7])
    parser.add_argument("--output", type=Path, help="folder for moving_scenes.csv")
    parser.add_argument("--workers", type=int, help="number of processes, all cores by default")
    return parser.parse_args()


def print_row(rows: list[Row]) -> None:
    """Print the means of scenes of one kind, and the extreme differences."""
    kind = rows[0]
    means = [np.mean([row[name] for row in rows]) for name in (*METHODS, *BOX)]
    loss = max(row["true motion"] - row["merged"] for row in rows)
    gain = min(row["merged"] - row["window"] for row in rows)
    flagged = np.mean([row["flagged"] for row in rows])
    explained = sum(row["in_flags"] for row in rows) / sum(row["excess"] for row in rows)
    cells = " | ".join(
        [f"{mean:.2f}" for mean in means]
        + [f"{loss:.2f}", f"{gain:+.2f}"]
        + [f"{flagged:.2f}", f"{explained:.2f}"]
    )
    print(f"| {kind['motion']} | {kind['frames']} | {kind['photons']} | {cells} |", flush=True)


def write_table(path: Path, rows: list[Row]) -> None:
    """Write all scenes to a CSV file."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for row in rows:
            text = {name: f"{row[name]:.3f}" for name in NUMBERS}
            writer.writerow(row | text)


def read_table(path: Path) -> list[Row]:
    """Return the scenes of a CSV file."""
    with path.open(newline="", encoding="utf-8") as file:
        return [
            {name: read_value(name, row.get(name) or "") for name in COLUMNS}
            for row in csv.DictReader(file)
        ]


def read_value(name: str, text: str) -> Any:
    """Return the value of a column."""
    if name in ("motion", "model"):
        return text
    return int(text) if name in ("frames", "image", "seed") else np.float64(text or "nan")


def measure(scene: MovingScene) -> Row:
    """Return the PSNR of each column, and what is known about the merged image."""
    bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)
    truth, frames = scene.image(), len(bits)
    network = jl.pretrained(scene.sensor)

    def estimate(ones: npt.NDArray[Any], trials: npt.NDArray[Any]) -> Image:
        return network.reconstruct(jl.Merged(ones, trials.astype(np.float64), scene.sensor))

    quality = partial(psnr_inside, truth=truth)
    windows = []
    for length in sorted({min(length, frames) for length in (*WINDOWS, frames)}):
        start = scene.reference - length // 2
        counts = bits[start : start + length].counts()
        windows.append(quality(estimate(counts, np.full(SIZE, length))))
    motion = jl.align(bits)
    merged = jl.merge(bits, motion=motion)
    image = network.reconstruct(merged)
    exact = estimate(*merge_exactly(scene, bits))
    excess = ((image - truth) ** 2 - (exact - truth) ** 2)[INNER]
    flags = merged.flags[INNER]
    box = box_of_objects(scene)
    return {
        "sum": windows[-1],
        "window": max(windows),
        "DIS": quality(estimate(*merge_by_flow(bits))) if has_opencv() else np.float64("nan"),
        "merged": quality(image),
        "film network": quality(next(estimate_film(film(bits, window=frames)))),
        "true motion": quality(exact),
        "model": motion.model,
        "flagged": np.float64(flags.mean()),
        "excess": np.float64(1e6 * excess.mean()),
        "in_flags": np.float64(1e6 * np.where(flags, excess, 0).mean()),
        "box merged": np.float64(jl.metrics.psnr(image[box], truth[box], data_range=1.0)),
        "box true": np.float64(jl.metrics.psnr(exact[box], truth[box], data_range=1.0)),
    }


def box_of_objects(scene: MovingScene) -> tuple[slice, slice]:
    """Return the bounding box of all objects without the border, or the image without it."""
    rows, columns = np.nonzero(scene.planes()[INNER])
    if len(rows) == 0:
        return INNER
    top, left = (INNER[axis].start + index.min() for axis, index in enumerate((rows, columns)))
    return (
        slice(top, top + int(np.ptp(rows)) + 1),
        slice(left, left + int(np.ptp(columns)) + 1),
    )


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


def has_opencv() -> bool:
    """Return whether OpenCV is installed."""
    return importlib.util.find_spec("cv2") is not None


class Flow:
    """A motion with a displacement of each pixel in the middle of each block."""

    def __init__(self, blocks: Blocks, reference: float, fields: list[Image]) -> None:
        self.blocks, self.reference, self.fields = blocks, reference, fields

    def sums(self, block: int) -> Sums:
        """Return the sums of a block, all of whose frames have the same displacements."""
        frames = range(*map(int, self.blocks.edges[block : block + 2]))
        field = self.fields[block]
        return self.blocks.count(frames, (field, field), (frames.start, frames.stop))

    def displacements(self, block: int) -> Image:
        """Return the displacements of all pixels, (2, H, W)."""
        return self.fields[block]


def merge_by_flow(bits: jl.Bits) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the ones and trials along the optical flow between sums of blocks."""
    import cv2

    burst, _ = prepare_burst(bits, None)
    blocks = Blocks(burst, block_edges(len(burst)))
    network = jl.pretrained(bits.sensor)
    images = []
    for start, end in itertools.pairwise(blocks.edges.tolist()):
        fraction = bits[start:end].counts() / np.float32(end - start)
        images.append(255 * network.denoise_probability(fraction.astype(np.float32), end - start))
    scale = 255 / max(float(max(image.max() for image in images)), 1.0)
    bytes_ = [np.clip(scale * image, 0, 255).astype(np.uint8) for image in images]
    reference = len(burst) // 2
    middle = int(np.argmin(abs(blocks.centers - reference)))
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    fields = [
        np.ascontiguousarray(flow.calc(bytes_[middle], image, None)[..., ::-1].transpose(2, 0, 1))
        for image in bytes_
    ]
    total = find_consistent(Flow(blocks, blocks.centers[middle], fields)).total
    return total.ones, total.trials


if __name__ == "__main__":
    main()
