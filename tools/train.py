"""Train the networks that come with jotlight, and write their model cards.

    python tools/train.py path/to/data [--only two-layer-k16 medium ...] [--threads 2]

The folder holds ``bsds300/train/*.jpg`` for training and ``bsds300/test/*.jpg`` for the scores.
Networks and cards go to ``python/jotlight/networks/weights``.

The eight two-layer networks take about ten minutes on two cores. The deep networks take days and
need the extra `torch`; an interrupted run resumes. The other small networks start from the first
stage of `small-k16`, so train `small-k16` first. `medium-k16`, for K = 16 only, is a comparison
and goes to `--scratch`.
"""

import argparse
import time
from functools import partial
from pathlib import Path

import model_cards
import numpy as np

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.networks.pretrained import FOLDER, TRAINED_TRIALS
from jotlight.training.parameters import fingerprint_network

Stages = tuple[tuple[int, float], ...]
"""Number of steps and learning rate of each stage. A stage starts where the previous one ended. The
seed of a stage is its number, from 1."""

STAGES: dict[str, Stages] = {
    "small-k16": ((40_000, 3e-3), (20_000, 1.5e-3)),
    "medium": (
        *((36_000, 3e-3), (24_000, 2e-3), (70_000, 2.5e-3), (45_000, 2e-3), (7_000, 1e-3)),
        *((75_000, 2e-3), (22_000, 1.2e-3)),
    ),
    "small": ((16_000, 3e-3), (8_000, 1.2e-3), (30_000, 2.5e-3), (12_000, 1e-3)),
    "medium-k16": ((25_000, 3e-3),),
    "large-k16": ((24_000, 3e-3), (12_000, 1.5e-3), (5_000, 1e-3), (10_000, 1.2e-3)),
}
OTHER_SMALL_STAGES: Stages = ((8_000, 1.5e-3),)
"""Stages of the other small networks, after the first stage of `small-k16`."""

NOTES = {
    "small": "The alignment of moving scenes denoises its templates with this network.",
    "small-k": "No training patch was strongly over- or underexposed; for such captures, medium is "
    "better.",
    "medium": "In the first stage, the coarse filters had no parameter sets for K, and typical "
    "exposures of photographs were not drawn more often than others. The last four stages drew K "
    "from 9 to 100 in half of the steps. The last two stages drew most exposures from 0.08 to 1 "
    "photon per jot and frame, the previous ones from 0.15 to 1.",
    "large-k": "Only the last stage used patches that are strongly over- or underexposed.",
}
"""Notes on the training of the shipped networks that the stages do not show, by name without K."""

TWO_LAYER = [f"two-layer-k{bits}" for bits in TRAINED_TRIALS]
TWO_LAYER_STEPS, TWO_LAYER_BATCH, TWO_LAYER_PATCH, TWO_LAYER_SEED = 60, 512, 64, 0
SMALL = [f"small-k{bits}" for bits in (16, *(bits for bits in TRAINED_TRIALS if bits != 16))]
SHIPPED = [*TWO_LAYER, *SMALL, "small", "medium", "large-k16"]
COMPARISONS = ["medium-k16"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="+", choices=[*SHIPPED, *COMPARISONS], default=SHIPPED)
    parser.add_argument("--scratch", type=Path, default=Path("target/models"))
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    _, images = read_image_set(options.data / "bsds300/train")
    _, tests = read_image_set(options.data / "bsds300/test")
    for name in options.only:
        if name in TWO_LAYER:
            network, recipe = train_two_layer(name, images, options.threads)
        else:
            options.scratch.mkdir(parents=True, exist_ok=True)
            network = train_deep(name, images, options.scratch, options.threads)
            recipe = deep_recipe(name)
        network.history["trained on"] = "BSDS300 train, gray"
        folder = options.scratch if name in COMPARISONS else FOLDER
        network.save(folder / f"{name}.safetensors")
        card = model_cards.render(name, network, recipe, model_cards.score(network, tests))
        (folder / f"{name}.md").write_text(card, encoding="utf-8")
        print(card, flush=True)


def trials(name: str) -> int:
    """Return K of a network: 16 for `small-k16`."""
    return int(name.split("-k")[1])


def train_two_layer(
    name: str, images: list[np.ndarray], threads: int | None
) -> tuple[jl.Network, str]:
    """Return a two-layer network and the text about its training."""
    sensor = jl.Sensor(oversampling=round(trials(name) ** 0.5))
    begun = time.perf_counter()
    network, _ = jl.train(
        jl.Network.initial(sensor),
        images,
        steps=TWO_LAYER_STEPS,
        batch=TWO_LAYER_BATCH,
        patch=TWO_LAYER_PATCH,
        rng=TWO_LAYER_SEED,
        threads=threads,
    )
    return network, two_layer_recipe(time.perf_counter() - begun)


def two_layer_recipe(seconds: float) -> str:
    return (
        "`jl.train` with Gauss-Newton from the initial parameters with σ = 0.7. It took "
        f"{TWO_LAYER_STEPS} steps of {TWO_LAYER_BATCH} patches of {TWO_LAYER_PATCH} × "
        f"{TWO_LAYER_PATCH} pixels with new bits in each step, seed {TWO_LAYER_SEED}; "
        f"{seconds:.0f} s on two cores."
    )


def deep_start(name: str, scratch: Path) -> jl.Network:
    """Return the network before its first stage."""
    if name in ("small", "medium"):
        return jl.Network.conditional(name, rng=0)
    sensor = jl.Sensor(frames=trials(name))
    start = jl.Network.residual(sensor, name.split("-")[0], rng=0)
    if name in STAGES:
        return start
    # The first two layers depend on K. The others come from the network for K = 16.
    trained = jl.Network.load(scratch / "small-k16.1.safetensors")
    return jl.Network([*start.layers[:2], *trained.layers[2:]], sensor)


def train_deep(
    name: str, images: list[np.ndarray], scratch: Path, threads: int | None
) -> jl.Network:
    """Return a deep network after all its stages. Finished stages come from `scratch`."""
    from jotlight.torch import train

    network = deep_start(name, scratch)
    for seed, (steps, learning_rate) in enumerate(STAGES.get(name, OTHER_SMALL_STAGES), 1):
        path = scratch / f"{name}.{seed}.safetensors"
        if path.exists():
            finished = jl.Network.load(path)
            run = finished.history["run"]
            # Repeat a stage whose number of steps or start has changed.
            if (run["steps"], run["network"]) == (steps, fingerprint_network(network)):
                network = finished
                continue
        checkpoint = scratch / f"{name}.{seed}.checkpoint.safetensors"
        network, _ = train(
            network,
            images,
            steps=steps,
            learning_rate=learning_rate,
            rng=seed,
            checkpoint=checkpoint,
            resume=checkpoint.exists(),
            callback=partial(report, name, steps),
            device="cpu",
            threads=threads,
        )
        network.save(path)
    return network


def report(name: str, steps: int, record: jl.training.Record) -> None:
    if record.step % 500 == 0:
        print(f"{name}: step {record.step} of {steps}, cost {record.loss:.4g}", flush=True)


def deep_recipe(name: str) -> str:
    stages = ", then ".join(
        f"{steps:,} steps at a learning rate of {learning_rate:g}"
        for steps, learning_rate in STAGES.get(name, OTHER_SMALL_STAGES)
    )
    if name in SMALL[1:]:
        stages += ", starting from the first stage of small-k16"
    note = NOTES.get(name.rstrip("0123456789"), "")
    return f"`jotlight.torch.train` for {stages}. {note}".strip()


if __name__ == "__main__":
    main()
