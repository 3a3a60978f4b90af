"""Train the networks that come with jotlight, and write their model cards.

    python tools/train.py path/to/data [--only two-layer-k16 medium ...] [--threads 2]
    python tools/train.py path/to/data --only small --from small.safetensors [--steps 5000]

The folder holds the images of the module `training_data`, and ``bsds300/test/*.jpg`` for the
scores. Networks and cards go to ``python/jotlight/networks/weights``.

The two-layer networks take ten minutes on two cores. The others need the extra `torch`, and the
deep ones take days. An interrupted run resumes from the last checkpoint in `--scratch`. `--from`
skips all stages but one by Muon. `small` starts from `templates`, `large` from `medium`, and small
networks for one K from the first stage of `small-k16`. `medium-k16` goes to `--scratch`.
"""

import argparse
import dataclasses
import itertools
import time
from functools import cache, partial
from pathlib import Path

import numpy as np

import jotlight as jl
import model_cards
import training_data
from jotlight.images.sets import read_image_set
from jotlight.networks.pretrained import FOLDER, TRAINED_TRIALS
from jotlight.networks.stages import last_run, with_stage
from jotlight.training.parameters import fingerprint_network
from rounding import round_layers
from widening import widen


@dataclasses.dataclass(frozen=True)
class Stage:
    """A part of a training. It starts where the previous one ended."""

    steps: int
    learning_rate: float
    batch: int = 16
    patch: int = 48
    images: str = "bsds300"
    """``bsds300``: the training images of BSDS300. ``bsds500``: also those of ``bsds500_extra``.
    ``mixture``: those of `training_data`."""
    share: float = 1.0
    """The parameters are start + share × (found - start)."""
    optimizer: str = "adam"
    """The optimizer of `jotlight.torch.train`."""


def bsds300_stages(*stages: tuple[int, float]) -> tuple[Stage, ...]:
    """Return stages with the training images of BSDS300, from steps and learning rates."""
    return tuple(Stage(steps, learning_rate) for steps, learning_rate in stages)


STAGES: dict[str, tuple[Stage, ...]] = {
    "two-layer": (Stage(6_000, 2e-3, batch=32, images="mixture"),),
    "small-k16": (
        *bsds300_stages((40_000, 3e-3), (20_000, 1.5e-3)),
        Stage(20_000, 1.5e-3, batch=32, patch=64, images="mixture"),
        Stage(9_000, 6e-4, batch=32, patch=64, images="mixture"),
        Stage(24_000, 1e-3, batch=32, patch=64, images="bsds500", share=0.75),
    ),
    "medium": (
        *bsds300_stages((36_000, 3e-3), (24_000, 2e-3), (70_000, 2.5e-3), (45_000, 2e-3)),
        *bsds300_stages((7_000, 1e-3), (75_000, 2e-3), (22_000, 1.2e-3)),
        Stage(44_000, 2e-3, batch=32, patch=64, images="mixture", share=0.85, optimizer="muon"),
        Stage(16_000, 2e-3, batch=32, patch=64, images="mixture", optimizer="muon"),
        Stage(16_000, 2e-3, batch=32, patch=64, images="mixture", share=0.5, optimizer="muon"),
        Stage(12_000, 1.2e-3, batch=32, patch=64, images="mixture", share=0.5, optimizer="muon"),
    ),
    "templates": bsds300_stages((16_000, 3e-3), (8_000, 1.2e-3), (30_000, 2.5e-3), (12_000, 1e-3)),
    "small": (
        Stage(10_000, 1.5e-3, batch=32, patch=64, images="mixture", share=0.5, optimizer="muon"),
        Stage(15_000, 1e-3, batch=32, patch=64, images="mixture", share=0.6, optimizer="muon"),
    ),
    "large": (
        Stage(22_000, 1.5e-3, batch=32, patch=64, images="mixture"),
        Stage(21_000, 1.5e-3, batch=32, patch=64, images="mixture"),
        Stage(9_000, 1.5e-3, batch=32, patch=64, images="mixture", share=0.7, optimizer="muon"),
        Stage(9_000, 1.5e-3, batch=32, patch=64, images="mixture", optimizer="muon"),
        Stage(9_000, 1.5e-3, batch=32, patch=64, images="mixture", share=0.5, optimizer="muon"),
        Stage(6_000, 1e-3, batch=32, patch=64, images="mixture", share=0.5, optimizer="muon"),
    ),
    "medium-k16": bsds300_stages((25_000, 3e-3)),
}
"""Stages of the deep networks. The seed of a stage is its number, from 1."""

OTHER_SMALL_STAGES = bsds300_stages((8_000, 1.5e-3))
"""Stages of the other small networks, after the first stage of `small-k16`."""

CONTINUATION = Stage(20_000, 1.5e-3, batch=32, patch=64, images="mixture", optimizer="muon")
"""The stage after `--from`. If the last stage of a network is by Muon, that one is repeated."""

NOTES = {
    "templates": "The cost was the error of z = arcsin √p, as for all networks for any K at that "
    "time (decision 50). Only the alignment of moving scenes uses this network: it denoises "
    "templates (decision 51).",
    "small": "It started from the weights of templates. In the last stage but one, 14 % of the "
    "patches were drawings (decision 51). The stages had the seeds 63 and 66.",
    "small-k": "Most training patches were well exposed; for other captures, medium is better. For "
    "K = 16, the fourth stage had the seed 7, and the fifth 23.",
    "medium": "In the first stage, the coarse filters had no parameter sets for K, and typical "
    "exposures of photographs were not drawn more often than others. The last eight stages drew K "
    "from 9 to 100 in half of the steps. The last six stages drew most exposures from 0.08 to 1 "
    "photon per jot and frame, the previous ones from 0.15 to 1. Before the last three stages, the "
    "cost was the error of z (decision 50). Before the last two stages, 3 % of the patches were "
    "drawings; in the last stage but one, 14 % (decision 51). The last two had the seeds 61 and "
    "64. Finally, the parameters were set to 85 % of the way from those before these two stages to "
    "those after them.",
    "large": "It started with the estimates of medium, whose channels and layers were extended. "
    "Before the third stage, it took 5,286 steps by Muon at a learning rate of 0.002, whose "
    "changes count as those of that stage. Before the last three stages, the cost was the error "
    "of z (decision 50). Before the last two stages, 3 % of the patches were drawings; in the last "
    "stage but one, 14 % (decision 51). The last two had the seeds 62 and 67. The parameters are "
    "rounded to float16.",
}
"""Notes on the training of pretrained networks that the stages do not show, by name without K."""

TWO_LAYER = [f"two-layer-k{bits}" for bits in TRAINED_TRIALS]
TWO_LAYER_STEPS, TWO_LAYER_BATCH, TWO_LAYER_PATCH, TWO_LAYER_SEED = 60, 512, 64, 0
SMALL = [f"small-k{bits}" for bits in (16, *(bits for bits in TRAINED_TRIALS if bits != 16))]
SHIPPED = [*TWO_LAYER, *SMALL, "two-layer", "templates", "small", "medium", "large"]
COMPARISONS = ["medium-k16"]
ROUNDED = ["large"]
"""Networks that are stored in float16, which costs them less than 0.002 dB."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="+", choices=[*SHIPPED, *COMPARISONS], default=SHIPPED)
    parser.add_argument("--from", type=Path, dest="start", help="weights of one deep network")
    parser.add_argument("--steps", type=int, help="number of steps after --from")
    parser.add_argument("--learning-rate", type=float, help="largest learning rate after --from")
    parser.add_argument("--seed", type=int, help="seed after --from; default: number of the stage")
    parser.add_argument("--scratch", type=Path, default=Path("target/models"))
    parser.add_argument("--threads", type=int)
    parser.add_argument("--precision", choices=["f32", "bf16"], help="default: the fastest")
    options = parser.parse_args()
    if options.start is not None and (len(options.only) != 1 or options.only[0] in TWO_LAYER):
        parser.error("--from: expected --only with the name of one deep network")
    continuation = options.steps, options.learning_rate, options.seed
    if options.start is None and any(option is not None for option in continuation):
        parser.error(
            "--steps, --learning-rate, and --seed: expected --from, whose run they describe"
        )
    for name in options.only:
        if name in TWO_LAYER:
            network, recipe = train_two_layer(name, options.data, options.threads)
        else:
            options.scratch.mkdir(parents=True, exist_ok=True)
            network, recipe = train_deep(name, options)
        write_network(name, network, recipe, options)


def write_network(name: str, network: jl.Network, recipe: str, options: argparse.Namespace) -> None:
    """Write the file and the card of a network."""
    _, tests = read_image_set(options.data / "bsds300/test")
    if name in ROUNDED:
        layers, known = round_layers(network.layers), network.trials_range
        network = jl.Network(layers, network.sensor, network.history, trials_range=known)
    folder = options.scratch if name in COMPARISONS else FOLDER
    file = folder / f"{name}.safetensors"
    network.save(file)
    validation = partial(training_data.validation_images, options.data)
    scores = model_cards.score(network, tests, validation)
    model_cards.write(file, model_cards.render(name, network, recipe, scores))


def trials(name: str) -> int:
    """Return K of a network: 16 for `small-k16`."""
    return int(name.split("-k")[1])


def train_two_layer(name: str, data: Path, threads: int | None) -> tuple[jl.Network, str]:
    """Return a two-layer network and the text about its training."""
    sensor = jl.Sensor(oversampling=round(trials(name) ** 0.5))
    begun = time.perf_counter()
    network, _ = jl.train(
        jl.Network.initial(sensor),
        bsds300(data),
        steps=TWO_LAYER_STEPS,
        batch=TWO_LAYER_BATCH,
        patch=TWO_LAYER_PATCH,
        rng=TWO_LAYER_SEED,
        threads=threads,
    )
    last_run(network.history)["data"] = model_cards.BSDS300
    return network, two_layer_recipe(time.perf_counter() - begun)


@cache
def bsds300(data: Path) -> list[np.ndarray]:
    """Return the training images of BSDS300, in gray."""
    return read_image_set(data / "bsds300/train")[1]


@cache
def bsds500(data: Path) -> list[np.ndarray]:
    """Return the images of BSDS500 that train, in gray."""
    files = [
        training_data.training_files(data, name) for name in ("bsds300/train", "bsds500_extra")
    ]
    return [jl.read_image(path, gray=True) for path in itertools.chain(*files)]


@cache
def mixture(data: Path) -> jl.training.PatchMixture:
    """Return the mixture of all training images."""
    return training_data.training_source(data)


IMAGES = {"bsds300": bsds300, "bsds500": bsds500, "mixture": mixture}
"""The images of a stage, functions of the folder of the data."""

NAMES = {"bsds300": "BSDS300", "bsds500": "BSDS500", "mixture": "all data sets"}


def two_layer_recipe(seconds: float) -> str:
    return (
        "`jl.train` with Gauss-Newton from the initial parameters with σ = 0.7. It took "
        f"{TWO_LAYER_STEPS} steps of {TWO_LAYER_BATCH} patches of {TWO_LAYER_PATCH} × "
        f"{TWO_LAYER_PATCH} pixels with new bits in each step, seed {TWO_LAYER_SEED}; "
        f"{seconds:.0f} s on two cores."
    )


def deep_start(name: str, scratch: Path) -> jl.Network:
    """Return the network before its first stage."""
    if name == "large":
        return widen(jl.Network.load(FOLDER / "medium.safetensors"), "medium", "large")
    if name == "small":
        return jl.Network.load(FOLDER / "templates.safetensors")
    if name in ("two-layer", "templates", "medium"):
        return jl.Network.conditional(name.replace("templates", "small"), rng=0)
    sensor = jl.Sensor(frames=trials(name))
    start = jl.Network.residual(sensor, name.split("-")[0], rng=0)
    if name in STAGES:
        return start
    # The first two layers depend on K. The others come from the network for K = 16.
    trained = jl.Network.load(scratch / "small-k16.1.safetensors")
    return jl.Network([*start.layers[:2], *trained.layers[2:]], sensor)


def train_deep(name: str, options: argparse.Namespace) -> tuple[jl.Network, str]:
    """Return a deep network after all its stages, and the text about its training.

    Finished stages come from the folder `options.scratch`.
    """
    stages = STAGES.get(name, OTHER_SMALL_STAGES)
    if options.start is None:
        network, text = deep_start(name, options.scratch), describe(name, stages)
        numbered = list(enumerate(stages, 1))
    else:
        network = jl.Network.load(options.start)
        last = stages[-1] if stages[-1].optimizer == "muon" else CONTINUATION
        chosen = {"steps": options.steps, "learning_rate": options.learning_rate}
        chosen = {name: value for name, value in chosen.items() if value is not None}
        last = dataclasses.replace(last, share=1.0, **chosen)
        numbered = [(len(stages) + 1 if options.seed is None else options.seed, last)]
        text = describe(name, (*stages, last))
    for seed, stage in numbered:
        network = train_stage(name, network, stage, seed, options)
    images = {stage.images for stage in (*stages, *(stage for _, stage in numbered))}
    is_mixture = images != {"bsds300"}
    last_run(network.history)["data"] = model_cards.MIXTURE if is_mixture else model_cards.BSDS300
    return network, text


def train_stage(
    name: str, start: jl.Network, stage: Stage, seed: int, options: argparse.Namespace
) -> jl.Network:
    """Return the network after a stage; one with the same steps and start comes from a file."""
    from jotlight.torch import fastest_precision, train

    path = options.scratch / f"{name}.{seed}.safetensors"
    if path.exists():
        finished = jl.Network.load(path)
        run = last_run(finished.history)["run"]
        # Repeat a stage whose number of steps, start, or optimizer has changed.
        is_same = (run["steps"], run["network"]) == (stage.steps, fingerprint_network(start))
        if is_same and run["optimizer"].lower().startswith(stage.optimizer):
            return finished
    settings = {"batch": stage.batch, "patch": stage.patch, "threads": options.threads}
    checkpoint = options.scratch / f"{name}.{seed}.checkpoint.safetensors"
    network, _ = train(
        start,
        IMAGES[stage.images](options.data),
        steps=stage.steps,
        learning_rate=stage.learning_rate,
        optimizer=stage.optimizer,
        precision=options.precision or fastest_precision(start, device="cpu", **settings),
        rng=seed,
        checkpoint=checkpoint,
        resume=checkpoint.exists(),
        callback=partial(report, name, stage.steps),
        device="cpu",
        **settings,
    )
    network = average(start, network, stage.share)
    network.save(path)
    checkpoint.unlink()
    return network


def average(before: jl.Network, after: jl.Network, share: float) -> jl.Network:
    """Return a network whose parameters lie between those of two others."""
    if share == 1:
        return after
    layers = []
    for first, last in zip(before.layers, after.layers, strict=True):
        parts = {"filters": first.filters + np.float32(share) * (last.filters - first.filters)}
        if first.coefficients is not None and last.coefficients is not None:
            change = last.coefficients - first.coefficients
            parts["coefficients"] = first.coefficients + np.float32(share) * change
        layers.append(dataclasses.replace(last, **parts))
    change = f"parameters at {share:.0%} of the way from those before the last run"
    history = with_stage(after.history, change)
    return jl.Network(layers, after.sensor, history, trials_range=after.trials_range)


def report(name: str, steps: int, record: jl.training.Record) -> None:
    if record.step % 500 == 0:
        print(f"{name}: step {record.step} of {steps}, cost {record.loss:.4g}", flush=True)


def describe(name: str, stages: tuple[Stage, ...]) -> str:
    """Return the text about the training of a deep network."""
    texts = []
    for stage in stages:
        text = f"{stage.steps:,} steps at a learning rate of {stage.learning_rate:g}"
        if (stage.batch, stage.patch) != (Stage.batch, Stage.patch):
            text += f" with {stage.batch} patches of {stage.patch} × {stage.patch} pixels"
        text += f" of {NAMES[stage.images]}"
        if stage.optimizer == "muon":
            text += " by Muon"
        if stage.share < 1:
            text += f" (the network keeps {stage.share:.0%} of the changes)"
        texts.append(text)
    text = ", then ".join(texts)
    if name in SMALL[1:]:
        text += ", starting from the first stage of small-k16"
    note = NOTES.get(name.rstrip("0123456789"), "")
    return f"`jotlight.torch.train` for {text}. {note}".strip()


if __name__ == "__main__":
    main()
