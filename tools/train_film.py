"""Train the film network that comes with jotlight, and write its model card.

    python tools/film_data.py DATA SCENES --scenes 540
    python tools/film_data.py DATA VALIDATION --first 100000 --scenes 34 --validation
    python tools/train_film.py SCENES VALIDATION [--rounds 4] [--steps 6000] [--from FILE]

The network that comes with jotlight was trained in several runs, while scenes were added. Its card
lists them, and decision 48 states how its scenes differ from those of these commands.

The network improves the estimates of the gray network "large". Without `--from`, its inner layers
start at the parameters of "medium", which has the same layers. The last image that the network
reads is its own: each round begins with the images that the network of the round before makes of
all scenes. Network and card go to ``python/jotlight/networks/weights``. A run needs the extra
`torch`.
"""

import argparse
import dataclasses
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from film_data import PARTS
from jotlight.estimators.inverse_response import intensity_from_probability
from jotlight.metrics import psnr
from jotlight.motion.films.estimates import displaced
from jotlight.networks.conditioning import conditioning_weights
from jotlight.networks.layer import Layer
from jotlight.networks.planes.film_planes import START, Counts, film_planes, usual_trials
from jotlight.networks.planes_network import FilmNetwork
from jotlight.networks.pretrained import FILM_FILE, FILM_START, FOLDER
from jotlight.networks.stages import stages_of
from jotlight.sensing.likelihood.reference import response_of
from jotlight.sensing.parameters.binomial import arcsin_root
from jotlight.training.film_patches import FilmExample, FilmPatches
from model_cards import ship
from train import report

BATCH, PATCH = 16, 64

INNER = "medium"
"""Size of the gray network at whose inner layers training starts."""

FIRST_GRAY = 3
"""Number of the first layer of the U-Net of the gray network. Here, it has the number 2."""

TEMPLATE = Path(__file__).with_name("film_card.md")

Image = npt.NDArray[np.float32]


def start_from_gray() -> FilmNetwork:
    """Return a film network whose inner layers are those of the gray network."""
    network = FilmNetwork.initial(INNER, rng=0)
    gray = jl.Network.load(FOLDER / f"{INNER}.safetensors")
    layers = [*network.layers[:2]]
    for layer, of_gray in zip(network.layers[2:], gray.layers[FIRST_GRAY:], strict=True):
        layers.append(_of_gray(layer, of_gray, gray.trials_range, network.trials_range))
    return FilmNetwork(layers, network.history, trials_range=network.trials_range)


def _of_gray(layer: Layer, gray: Layer, of_gray: tuple[int, int], own: tuple[int, int]) -> Layer:
    """Return a layer with the parameters of a gray one for each K, adapted to more inputs."""
    if layer.trainable == "filters":  # the last one, which begins at 0
        return layer
    filters = _for_other_range(gray.filters, of_gray, own)
    if layer.filters.shape != filters.shape:
        # The estimate and the deviation of the counts from it are the counts, which it read.
        more = np.zeros_like(layer.filters)
        more[:, :, [0, START]] = filters
        filters = more
    coefficients = gray.coefficients
    if coefficients is not None and coefficients.ndim == 3:
        coefficients = _for_other_range(coefficients, of_gray, own)
    knots = {"start": gray.start, "spacing": gray.spacing}
    return dataclasses.replace(layer, filters=filters, coefficients=coefficients, **knots)


def _for_other_range(
    sets: npt.NDArray[np.float32], before: tuple[int, int], after: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Return parameters with nearly the same values at each K, for another range of K.

    Beyond the range before, they are those at its end.
    """
    number = len(sets)
    trials = np.geomspace(*after, 60)
    known = np.clip(trials, *before)
    old = np.stack([conditioning_weights(each, before, number) for each in known])
    new = np.stack([conditioning_weights(each, after, number) for each in trials.clip(*after)])
    values = old @ sets.reshape(number, -1)
    found = np.linalg.lstsq(new, values, rcond=None)[0]
    return np.ascontiguousarray(found.reshape(sets.shape), np.float32)


class Scene:
    """The images of a scene in the order of time, from a file of `film_data.py`."""

    def __init__(self, path: Path) -> None:
        with np.load(path, allow_pickle=False) as arrays:
            self._arrays = dict(arrays)
        if missing := {f"{name}_trials" for name in PARTS} - set(self._arrays):
            raise ValueError(
                f"{path}: expected the arrays of film_data.py, got none named "
                f"{', '.join(sorted(missing))}; make the scenes again"
            )
        gray = jl.Network.load(FOLDER / f"{FILM_START}.safetensors")
        found = [gray.reconstruct(self._merged(number)) for number in range(len(self))]
        self.of_gray = np.stack(found).astype(np.float16)
        """The estimates of the gray network."""

    def __len__(self) -> int:
        return len(self._arrays["truth"])

    def counts(self, number: int) -> list[Counts]:
        """Return the counts that the network reads of an image."""
        return [
            Counts(self._image(f"{name}_fraction", number), self._image(f"{name}_trials", number))
            for name in PARTS
        ]

    def truth(self, number: int) -> Image:
        """Return the true image."""
        return self._image("truth", number)

    def light(self) -> float:
        """Return the photons per jot and frame at intensity 1."""
        return float(self._arrays["light_per_intensity"][0, 0])

    def sensor(self) -> jl.Sensor:
        """Return a sensor with the light of the scene."""
        return jl.Sensor(frames=256, gain=256 * self.light())

    def _merged(self, number: int) -> jl.Merged:
        window = self.counts(number)[0]
        trials = window.trials.astype(np.float64)
        ones = np.minimum(np.rint(window.fraction * trials), np.floor(trials))
        return jl.Merged(ones.astype(np.int32), trials, self.sensor())

    def planes(self, network: FilmNetwork) -> Iterator[tuple[Image, float, Image]]:
        """Yield what a network reads of each image, its usual trials, and P(b = 1)."""
        last = None
        for number in range(len(self)):
            counts, displacement = self.counts(number), self._image("displacement", number)
            seen = None
            if last is not None and np.isfinite(displacement).all():
                seen = displaced(last, displacement)
            trials = usual_trials(counts[0])
            start = np.float32(response_of(self.sensor())(self.of_gray[number]))
            planes = film_planes(start, counts, trials, seen)
            found = network.estimate_probability(planes, trials)[0].clip(0, 1)
            last = arcsin_root(found)
            yield planes, trials, found

    def _image(self, name: str, number: int) -> Image:
        return np.asarray(self._arrays[name][number], np.float32)


def examples(scenes: list[Scene], network: FilmNetwork) -> list[FilmExample]:
    """Return what a network reads of all images, and the true images."""
    return [
        FilmExample(planes.astype(np.float16), scene.truth(number), trials, scene.light())
        for scene in scenes
        for number, (planes, trials, _) in enumerate(scene.planes(network))
    ]


def scores(scenes: list[Scene], network: FilmNetwork) -> tuple[float, float]:
    """Return the mean PSNR of the gray network for merged counts, and of a film network."""
    rows = []
    for scene in scenes:
        for number, (_, _, found) in enumerate(scene.planes(network)):
            truth = scene.truth(number)
            own = intensity_from_probability(found, scene.sensor(), None)
            images = scene.of_gray[number].astype(np.float32), own
            inner = (slice(8, -8),) * 2
            rows.append([psnr(each[inner], truth[inner], data_range=1.0) for each in images])
    of_gray, own = np.mean(rows, axis=0)
    return float(of_gray), float(own)


def main() -> None:
    from jotlight.torch import train

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scenes", type=Path)
    parser.add_argument("validation", type=Path)
    parser.add_argument("--from", dest="start", type=Path)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--learning-rate", type=float, default=2e-3)
    parser.add_argument("--optimizer", choices=["muon", "adam"], default="muon")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    network = start_from_gray() if options.start is None else FilmNetwork.load(options.start)
    scenes, validation = (
        [Scene(path) for path in sorted(folder.glob("*.npz"))]
        for folder in (options.scenes, options.validation)
    )
    print(f"{len(scenes)} scenes; PSNR of {FILM_START}, and before: {scores(validation, network)}")
    stages = stages_of(network.history)

    for number in range(options.rounds):
        network, _ = train(
            network,
            FilmPatches(examples(scenes, network)),
            steps=options.steps,
            batch=BATCH,
            patch=PATCH,
            learning_rate=options.learning_rate,
            optimizer=options.optimizer,
            rng=options.seed + number,
            callback=partial(report, "film", options.steps),
            device="cpu",
            threads=options.threads,
        )
        stages.append(
            f"{options.steps:,} steps by {options.optimizer.capitalize()} at a learning rate of "
            f"{options.learning_rate:g} on the images of {len(scenes)} scenes"
        )
        network = ship(network, stages, FILM_FILE, TEMPLATE, partial(card_texts, validation))


def card_texts(validation: list[Scene], network: FilmNetwork) -> dict[str, object]:
    """Return the texts of the card of a network, with its scores."""
    of_gray, own = scores(validation, network)
    return {"scenes": len(validation), "of_gray": of_gray, "own": own}


if __name__ == "__main__":
    main()
