"""Train a color network that comes with jotlight, and write its model card.

    python tools/train_color.py path/to/data mosaic|channels [--steps 20000] [--from FILE]

The folder holds the photographs of the module `training_data`. Without `--from`, the inner layers
start at the parameters of the gray network "medium". Network and card go to
``python/jotlight/networks/weights``. A run needs the extra `torch`. An interrupted one resumes from
the checkpoint in `--scratch`.
"""

import argparse
import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

import jotlight as jl
import training_data
from jotlight.metrics import psnr
from jotlight.networks.layer import Layer
from jotlight.networks.planes.color_planes import PLANES
from jotlight.networks.planes_network import ColorNetwork
from jotlight.networks.pretrained import CHANNELS_FILE, FOLDER, MOSAIC_FILE, pretrained_color
from jotlight.networks.stages import stages_of, with_stage
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.training import ColorDrawings, ColorPatches, PatchMixture, random_mosaic
from model_cards import ship
from train import report

BATCH, PATCH = 16, 64

FIRST_GRAY = 3
"""Number of the first layer of the U-Net of the gray network. Here, it has the number 2."""

GRAY_WEIGHTS = dict.fromkeys(range(3), 0.6) | {3: 0.8} | dict.fromkeys((8, 9, 10), 1 / 3)
"""Weights of the gray filters for the planes, at the start: all colors together are gray."""

NOISE = 0.15
"""Factor of the random filters that are added to them."""

DRAWINGS = 4.5
"""Weight of the drawings, where that of all photographs is 9."""

TEMPLATE = Path(__file__).with_name("color_card.md")


class Kind(NamedTuple):
    """A color network that comes with jotlight."""

    file: Path
    mosaics: Callable[..., Mosaic] | None
    """The mosaics of the patches, or None for color channels."""
    sensor: dict[str, str]
    """Parameters of the sensor of the scores."""
    use: str
    """What the network is for."""
    patches: str
    """The patches that train it."""
    scored: str
    """The data of the scores."""


KINDS = {
    "mosaic": Kind(
        MOSAIC_FILE,
        random_mosaic,
        {"mosaic": "RGGB"},
        "red, green, and blue of mosaics",
        "Of the patches, 74 % are behind RGGB, 8 % behind RGBW, 6 % behind quad Bayer and X-Trans, "
        "8 % behind random filters R, G, B, and W, 2 % behind C, M, Y, and G, and 2 % behind Bayer "
        "filters that pass other colors, too.",
        "behind RGGB",
    ),
    "channels": Kind(
        CHANNELS_FILE,
        None,
        {},
        "images with three counts per pixel: red, green, and blue",
        "Each pixel of a patch has three counts.",
        "with three counts per pixel",
    ),
}


def start_from_gray() -> ColorNetwork:
    """Return a color network whose inner layers are those of the gray network."""
    network = ColorNetwork.initial("medium", rng=0)
    gray = jl.Network.load(FOLDER / "medium.safetensors").layers[FIRST_GRAY:]
    layers = [*network.layers[:2]]
    for layer, of_gray in zip(network.layers[2:], gray, strict=True):
        layers.append(_of_gray(layer, of_gray))
    return ColorNetwork(layers, network.history, trials_range=network.trials_range)


def _of_gray(layer: Layer, gray: Layer) -> Layer:
    """Return a layer with the parameters of a gray one, adapted to more inputs or outputs."""
    filters = gray.filters
    if layer.shape[1] == PLANES:
        weights = np.zeros((PLANES, 1, 1), np.float32)
        weights[list(GRAY_WEIGHTS), 0, 0] = list(GRAY_WEIGHTS.values())
        filters = filters * weights + NOISE * layer.filters
    if layer.shape[0] != gray.shape[0]:  # the last one, which begins at 0
        return layer
    coefficients = gray.coefficients
    knots = {"start": gray.start, "spacing": gray.spacing}
    return dataclasses.replace(layer, filters=filters, coefficients=coefficients, **knots)


def color_source(data: Path, kind: Kind) -> PatchMixture:
    """Return patches of all color photographs, and drawings."""
    photographs = [
        (ColorPatches(training_data.photographs(data, folder), mosaics=kind.mosaics), weight)
        for folder, weight in training_data.WEIGHTS.items()
    ]
    return PatchMixture([*photographs, (ColorDrawings(kind.mosaics), DRAWINGS)])


def score(data: Path, kind: Kind) -> str:
    """Return the PSNR of the pretrained network on validation photographs, as text."""
    files = training_data.validation_files(data)
    images = [jl.read_image(path) for path in files if path.parent.name == "cid22"]
    images = [image[96:416, 96:416] for image in images if image.ndim == 3]
    texts = []
    for trials in (4, 16, 64, 256):
        sensor = jl.Sensor(frames=trials, **kind.sensor)
        values = [
            psnr(
                jl.reconstruct(sensor.expose(image, rng=seed, channel_axis=-1)),
                image,
                data_range=1.0,
            )
            for seed, image in enumerate(images)
        ]
        texts.append(f"{np.mean(values):.2f} dB for K = {trials}")
    return ", ".join(texts)


def main() -> None:
    from jotlight.torch import train

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--from", dest="start", type=Path)
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--learning-rate", type=float, default=2e-3)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--precision", choices=["f32", "bf16"], default="f32")
    parser.add_argument("--threads", type=int)
    parser.add_argument("--scratch", type=Path, default=Path("target/models"))
    options = parser.parse_args()
    options.scratch.mkdir(parents=True, exist_ok=True)
    checkpoint = options.scratch / f"{options.kind}.{options.seed}.checkpoint.safetensors"
    start = start_from_gray() if options.start is None else ColorNetwork.load(options.start)

    network, _ = train(
        start,
        color_source(options.data, KINDS[options.kind]),
        steps=options.steps,
        batch=BATCH,
        patch=PATCH,
        learning_rate=options.learning_rate,
        precision=options.precision,
        rng=options.seed,
        checkpoint=checkpoint,
        resume=checkpoint.exists(),
        callback=partial(report, options.kind, options.steps),
        device="cpu",
        threads=options.threads,
    )
    source = "" if options.start is None else " --from FILE"
    stage = (
        f"`python tools/train_color.py DATA {options.kind}{source}` with {options.steps:,} steps "
        f"by Muon at a learning rate of {options.learning_rate:g}"
    )
    network.history = with_stage(start.history, stage)
    # The next stage starts from these parameters, which are not rounded.
    network.save(options.scratch / f"{options.kind}.{options.seed}.safetensors")
    stages, kind = stages_of(network.history), KINDS[options.kind]
    ship(network, stages, kind.file, TEMPLATE, lambda _: card_texts(kind, options.data))
    checkpoint.unlink()


def card_texts(kind: Kind, data: Path) -> dict[str, object]:
    """Return the texts of the card of the network in the file of a kind, with its scores."""
    return {
        "name": kind.file.stem,
        "use": kind.use,
        "patches": kind.patches,
        "scored": kind.scored,
        "rotations": pretrained_color(kind.file).rotations,
        "scores": score(data, kind),
    }


if __name__ == "__main__":
    main()
