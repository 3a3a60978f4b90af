"""Record a video with a simulated sensor, and make a film of its bits.

    python benchmarks/studies/film_of_video.py VIDEO [--video-frames 48] [--window 256]
        [--step 16] [--output FOLDER]

VIDEO is a folder with the frames of a video as numbered images. Each is reduced to half its size
and seen by 16 binary frames, with 0.2 photons per pixel and frame on average. The table shows for
each image of the film its time in frames of the video, the model of the motion, whether it was
carried from the image before, the fraction of flagged pixels, and the PSNR in dB against the frame
of the video at this time: of the film, and of the best window without alignment, chosen with the
true image. "recurrent" is the PSNR of the film by the film network.

Three more columns show what limits the film: the PSNR of pixels without flags; that of the best of
the film and all windows in each tile of 16 pixels, chosen with the true image; and that of a still
image of the same number of binary frames, which all see the frame of the video. The network
"medium" estimates all images. With --output, comparisons are written to a folder: the video, the
best window; the film, also with flags in red; the film and that by the film network.
"""

import argparse
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from borders import INNER, psnr_inside
from PIL import Image

import jotlight as jl
from jotlight.motion.films.estimates import FilmEstimates
from jotlight.motion.films.film import film
from jotlight.motion.films.image import FilmImage

PER_FRAME = 16
"""Number of binary frames of each frame of the video."""

PHOTONS = 0.2
"""Mean number of photons per pixel and binary frame."""

WINDOWS = (2, 4, 8, 16, 32, 64, 128, 256)
TILE = 16

Gray = npt.NDArray[np.float32]


def main() -> None:
    """Print a row for each image of the film, and the means."""
    options = arguments()
    paths = sorted(options.video.glob("*.jpg"), key=lambda path: int(path.stem))
    video = np.stack([read_gray(path) for path in paths[: options.video_frames]])
    # Images show the middle of the binary frames of a frame of the video.
    bits = record(video)[PER_FRAME // 2 :]
    titles = "window", "film", "gain", "recurrent", "gain", "trusted", "tiles", "still"
    print(f"| time | model | carried | flagged | {' | '.join(titles)} |")
    print("| ---: | --- | --- |" + " ---: |" * 9)
    rows = []
    estimates = FilmEstimates()
    for index, image in enumerate(film(bits, window=options.window, step=options.step)):
        middle = index * options.step + options.window // 2
        time = (middle + PER_FRAME // 2) / PER_FRAME
        truth = video[int(time)]
        recurrent = estimates.add(image)
        measured = measure(bits, middle, truth, (image, recurrent), options.output)
        rows.append((*measured, still(bits.sensor, options.window, truth)))
        kind = f"{time:.1f} | {image.motion.model} | {image.is_carried}"
        print(f"| {kind} | {image.merged.flags.mean():.2f} | {cells(rows[-1])} |", flush=True)
    print(f"| mean | | | | {cells(np.mean(rows, axis=0))} |")


def cells(row: Sequence[float] | npt.NDArray[np.float64]) -> str:
    """Return the numbers of a row, with the gains of both films."""
    window, merged, recurrent, *others = row
    numbers = [f"{window:.2f}"]
    for each in (merged, recurrent):
        numbers += [f"{each:.2f}", f"{each - window:+.2f}"]
    return " | ".join(numbers + [f"{number:.2f}" for number in others])


def still(sensor: jl.Sensor, window: int, truth: Gray) -> float:
    """Return the PSNR of a window of binary frames that all see the same image."""
    part = sensor.replace(frames=window, gain=sensor.gain / sensor.frames * window)
    return psnr_inside(jl.pretrained(part).reconstruct(part.expose(truth, rng=0)), truth)


def arguments() -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("video", type=Path)
    parser.add_argument("--video-frames", type=int, default=48)
    parser.add_argument("--window", type=int, default=256)
    parser.add_argument("--step", type=int, default=PER_FRAME)
    parser.add_argument("--output", type=Path)
    return parser.parse_args()


def read_gray(path: Path) -> Gray:
    """Return an image in gray at half its size, in [0, 1]."""
    with Image.open(path) as file:
        gray = file.convert("L").reduce(2)
    return np.asarray(gray, np.float32) / 255


def record(video: Gray) -> jl.Bits:
    """Return the bits of a video."""
    frames = PER_FRAME * len(video)
    # A pixel of intensity 1 receives `gain` photons in all frames together.
    sensor = jl.Sensor(frames=frames, gain=PHOTONS / float(video.mean()) * frames)
    part = sensor.replace(frames=PER_FRAME, gain=sensor.gain / len(video))
    packed = [np.asarray(part.expose(image, rng=seed).packed) for seed, image in enumerate(video)]
    return jl.Bits(np.concatenate(packed), video.shape[2], sensor)


def measure(
    bits: jl.Bits, middle: int, truth: Gray, found: tuple[FilmImage, Gray], folder: Path | None
) -> tuple[float, float, float, float, float]:
    """Return the PSNR of the window, both films, trusted pixels, and the best of each tile.

    Also write a comparison.
    """
    image, recurrent = found
    network = jl.pretrained(bits.sensor)

    def estimate(data: jl.Bits | jl.Merged) -> Gray:
        return network.reconstruct(data, data.sensor)

    lengths = [length for length in WINDOWS if length <= 2 * middle]
    windows = [estimate(bits[middle - n // 2 : middle + n // 2]) for n in lengths]
    best = max(windows, key=lambda each: psnr_inside(each, truth))
    merged = estimate(image.merged)
    if folder is not None:
        folder.mkdir(exist_ok=True)
        flagged = np.where(image.merged.flags, 0.5 * merged, merged)
        colors = np.stack(
            [np.maximum(flagged, 0.4 * image.merged.flags), flagged, flagged], axis=-1
        )
        grays = [each[..., None].repeat(3, axis=-1) for each in (truth, best, merged, recurrent)]
        rows = [np.concatenate(pair, axis=1) for pair in (grays[:2], [grays[2], colors], grays[2:])]
        pixels = np.clip(255 * np.concatenate(rows), 0, 255).astype(np.uint8)
        Image.fromarray(pixels).save(folder / f"{middle:05}.jpg", quality=90)
    trusted = ~image.merged.flags[INNER]
    errors = (merged - truth)[INNER][trusted] ** 2
    of_trusted = -10 * np.log10(errors.mean()) if trusted.any() else np.nan
    return (
        psnr_inside(best, truth),
        psnr_inside(merged, truth),
        psnr_inside(recurrent, truth),
        float(of_trusted),
        psnr_inside(choose_tiles([merged, *windows], truth), truth),
    )


def choose_tiles(images: list[Gray], truth: Gray) -> Gray:
    """Return the image whose tiles are those with the smallest errors."""
    (height, width), chosen = truth.shape, np.empty_like(truth)
    for top, left in itertools.product(range(0, height, TILE), range(0, width, TILE)):
        tile = slice(top, top + TILE), slice(left, left + TILE)
        chosen[tile] = min(
            (image[tile] for image in images), key=lambda each: ((each - truth[tile]) ** 2).sum()
        )
    return chosen


if __name__ == "__main__":
    main()
