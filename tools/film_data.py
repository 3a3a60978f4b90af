"""Images of films of moving photographs, which train the film network.

    python tools/film_data.py DATA FOLDER [--scenes 400] [--first 0] [--validation]
        [--photons 0.03 1.0] [--auto 0.25]

Each scene is a burst of a random photograph that moves in a random way, and its film. A file of
`FOLDER` holds the images of a scene in the order of time: the counts that the network reads, the
displacement from each image to the one before, and the true image. Validation scenes show other
photographs.
"""

import argparse
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

import jotlight as jl
import training_data
from jotlight.motion.films.film import film
from jotlight.networks.planes.film_planes import NEIGHBORS

Image = npt.NDArray[np.float32]

MOTIONS = {
    "static": 1.0,
    "shake": 3.0,
    "rotate": 2.0,
    "fast": 1.0,
    "layers": 4.0,
    "two": 2.0,
    "three": 1.0,
    "small": 1.0,
    "person": 4.0,
    "parallax": 1.5,
    "sheet": 2.0,
    "appear": 0.5,
    "stop": 1.0,
}
"""Motions of the scenes, and their weights."""

FOLDERS = "photographs/cid22", "photographs/clic2025", "photographs/gb82", "bsds300/train"
"""Folders of photographs, which are equally frequent."""

SIDE = 160
"""Height and width of the scenes."""

IMAGES = 6
"""Number of images per scene."""

WINDOWS = {256: 0.6, 128: 0.25, 64: 0.15}
"""Frames of a window, and how frequent they are."""

STEPS = 4, 8, 8, 16
"""A window has this number of steps."""

VIDEO, PER_FRAME, SPEEDS = 0.6, 16, (1, 2, 3, 4)
"""Fraction of the scenes that stand still for the frames of a video, the number of binary frames of
each, and factors of their speed."""

PARTS = "long", "middle", "short", *(f"neighbor{number}" for number in range(1, NEIGHBORS + 1))
"""Names of the counts in a file: those of the window, and the parts of `FilmImage.nearest`."""

CAUSAL = 0.75
"""Fraction of the films that show the last frame of a window."""


def main() -> None:
    """Write the scenes that do not exist yet."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--scenes", type=int, default=400)
    parser.add_argument("--validation", action="store_true")
    parser.add_argument(
        "--photons",
        type=float,
        nargs=2,
        default=(0.03, 1.0),
        metavar=("FEWEST", "MOST"),
        help="range of the mean number of photons per pixel and frame",
    )
    parser.add_argument(
        "--auto",
        type=float,
        default=0.25,
        metavar="FRACTION",
        help="fraction of the scenes whose model of the motion is chosen by the bits; all others "
        "have an affine motion, which is found faster, so the bits of objects disagree with it",
    )
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for number in range(options.first, options.first + options.scenes):
        path = options.folder / f"{number:05}.npz"
        if not path.exists():
            rng = np.random.default_rng(number)
            recipe = Recipe.draw(rng, options.photons, options.auto)
            images = scene_images(options.data, rng, recipe, options.validation)
            arrays = as_arrays(images)
            with path.with_suffix(".part").open("wb") as file:
                np.savez(file, **arrays)
            path.with_suffix(".part").rename(path)
            print(path.name, flush=True)


class Recipe(NamedTuple):
    """How a film is made."""

    window: int
    step: int
    model: str
    causal: bool
    photons: float

    @classmethod
    def draw(cls, rng: np.random.Generator, photons: tuple[float, float], auto: float) -> "Recipe":
        """Return a random recipe for a range of photons and a fraction of chosen models."""
        window = int(rng.choice(list(WINDOWS), p=_shares(WINDOWS)))
        return cls(
            window,
            window // int(rng.choice(STEPS)),
            "auto" if rng.random() < auto else "affine",
            bool(rng.random() < CAUSAL),
            float(np.exp(rng.uniform(*np.log(photons)))),
        )

    @property
    def frames(self) -> int:
        """Number of frames of the burst."""
        return self.window + (IMAGES - 1) * self.step


def scene_images(
    data: Path, rng: np.random.Generator, recipe: Recipe, is_validation: bool
) -> Iterator[dict[str, npt.NDArray[np.floating]]]:
    """Yield the counts, the displacement from the image before, and the truth of each image."""
    is_video = rng.random() < VIDEO
    bits, truth = (video_burst if is_video else burst)(data, rng, recipe, is_validation)
    before = None
    for image in film(
        bits,
        window=recipe.window,
        step=recipe.step,
        model=recipe.model,
        causal=recipe.causal,
        threads=1,
    ):
        values = {}
        parts = image.merged, *image.nearest
        for name, part in zip(PARTS, parts, strict=True):
            trials = np.broadcast_to(part.trials, part.ones.shape).astype(np.float32)
            values[f"{name}_trials"] = trials
            values[f"{name}_fraction"] = part.ones / np.maximum(trials, 1)
        displacement = None if before is None else image.displacement_from(before)
        if displacement is None:
            displacement = np.full((2, SIDE, SIDE), np.nan, np.float32)
        before = image.time
        scale = np.full(1, bits.sensor.light_per_intensity)
        yield {
            **values,
            "displacement": displacement,
            "truth": truth(round(image.time)),
            "light_per_intensity": scale,
        }


def burst(
    data: Path, rng: np.random.Generator, recipe: Recipe, is_validation: bool
) -> tuple[jl.Bits, Callable[[int], Image]]:
    """Return the bits of a scene that moves in each frame, and a function for its true images."""
    scene = _scene(data, rng, recipe.frames, recipe.photons, is_validation)
    return jl.Bits(np.asarray(scene.bits.packed), SIDE, scene.sensor), scene.image


def video_burst(
    data: Path, rng: np.random.Generator, recipe: Recipe, is_validation: bool
) -> tuple[jl.Bits, Callable[[int], Image]]:
    """Return the bits of a scene that stands still for each frame of a video, and its images."""
    number, speed = recipe.frames // PER_FRAME + 2, int(rng.choice(SPEEDS))
    scene = _scene(data, rng, speed * number, recipe.photons, is_validation)
    # Images show the middle of the binary frames of a frame of the video.
    first = PER_FRAME // 2
    frames = recipe.frames
    sensor = scene.sensor.replace(frames=frames, gain=scene.sensor.light_per_intensity * frames)
    part = sensor.replace(frames=PER_FRAME, gain=scene.sensor.light_per_intensity * PER_FRAME)
    images = [scene.image(speed * index) for index in range(number)]
    packed = [np.asarray(part.expose(image, rng).packed) for image in images]
    bits = jl.Bits(np.concatenate(packed)[first : first + frames], SIDE, sensor)
    return bits, lambda time: images[(time + first) // PER_FRAME]


def _scene(
    data: Path, rng: np.random.Generator, frames: int, photons: float, is_validation: bool
) -> jl.datasets.MovingScene:
    """Return a random photograph that moves in a random way."""
    motion = str(rng.choice(list(MOTIONS), p=_shares(MOTIONS)))
    back, front = (_photograph(data, rng, is_validation) for _ in range(2))
    return jl.datasets.moving(
        back,
        motion,
        sensor=jl.Sensor(frames=frames),
        foreground=front,
        shape=(SIDE, SIDE),
        photons=photons,
        rng=rng,
    )


def as_arrays(
    images: Iterator[dict[str, npt.NDArray[np.floating]]],
) -> dict[str, npt.NDArray[np.float16]]:
    """Return the values of all images, stacked."""
    found = list(images)
    return {name: np.stack([each[name] for each in found]).astype(np.float16) for name in found[0]}


def _photograph(
    data: Path, rng: np.random.Generator, is_validation: bool
) -> npt.NDArray[np.float32]:
    """Return a random photograph in gray."""
    files = training_data.training_files(data, FOLDERS[rng.integers(len(FOLDERS))])
    if is_validation:
        files = training_data.validation_files(data)
    image = jl.read_image(files[rng.integers(len(files))], gray=True)
    # Photographs are often blurred at full size.
    size = min(image.shape) // 2
    if size >= SIDE and rng.random() < 0.5:
        rows, columns = (length - length % 2 for length in image.shape)
        image = image[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3))
    return np.asarray(image, np.float32)


def _shares(weights: dict) -> npt.NDArray[np.float64]:
    values = np.array(list(weights.values()))
    return values / values.sum()


if __name__ == "__main__":
    warnings.simplefilter("ignore", jl.JotlightWarning)
    main()
