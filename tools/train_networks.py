"""Train the deep networks that come with jotlight, and write their cards.

    python tools/train_networks.py path/to/data [--only small-k16 medium ...] [--threads 2]

The folder holds ``bsds300/train/*.jpg`` to learn from and ``bsds300/test/*.jpg`` to measure on. The
networks go to ``python/jotlight/networks/weights``. Runs that are stopped go on where they were. It needs the
extra `torch`. `medium-k16`, for K = 16 alone, is to compare with and goes to `--elsewhere`; the
small networks begin at the first stage of `small-k16`, which comes first.
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.networks.graph import flops_per_pixel
from jotlight.networks.pretrained import BITS_PER_PIXEL, FOLDER
from jotlight.torch import train
from jotlight.training.parameters import fingerprint_network

Stages = tuple[tuple[int, float], ...]
"""Steps and rates of runs that begin where the one before ended, with seeds 1, 2 and so on."""

STAGES: dict[str, Stages] = {
    "small-k16": ((40_000, 3e-3), (20_000, 1.5e-3)),
    "medium": (
        *((36_000, 3e-3), (24_000, 2e-3), (70_000, 2.5e-3), (45_000, 2e-3), (7_000, 1e-3)),
        *((75_000, 2e-3), (22_000, 1.2e-3)),
    ),
    "medium-k16": ((25_000, 3e-3),),
    "large-k16": ((24_000, 3e-3), (12_000, 1.5e-3), (5_000, 1e-3), (10_000, 1.2e-3)),
}
FURTHER: Stages = ((8_000, 1.5e-3),)
"""Of the small networks for other K, from the first stage of `small-k16`."""
COMPARED = ("medium-k16",)
SMALL = [f"small-k{bits}" for bits in (16, *(bits for bits in BITS_PER_PIXEL if bits != 16))]
SHIPPED = [*SMALL, "medium", "large-k16"]
NAMES = [*SHIPPED, *COMPARED]
CARD = Path(__file__).with_name("deep_model_card.md")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="+", choices=NAMES, default=SHIPPED)
    parser.add_argument("--elsewhere", type=Path, default=Path("target/models"))
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    options.elsewhere.mkdir(parents=True, exist_ok=True)
    _, scenes = read_image_set(options.data / "bsds300/train")
    _, tests = read_image_set(options.data / "bsds300/test")
    for name in options.only:
        folder = options.elsewhere if name in COMPARED else FOLDER
        network = learned(name, scenes, options)
        network.history["trained on"] = "BSDS300 train, grey"
        network.save(folder / f"{name}.safetensors")
        card = card_of(name, network, tests)
        (folder / f"{name}.md").write_text(card, encoding="utf-8")
        print(card, flush=True)


def sensor_of(name: str) -> jl.Sensor:
    bits = int(name.split("-k")[1]) if "-k" in name else 16
    return jl.Sensor(frames=bits)


def start_of(name: str, elsewhere: Path) -> jl.Network:
    """Where a network begins."""
    sensor, member = sensor_of(name), name.split("-")[0]
    if name == "medium":
        return jl.Network.conditional(member, rng=0)
    start = jl.Network.residual(sensor, member, rng=0)
    if name in STAGES:
        return start
    # The counts and x0 of its own K, and all else of the network for 16.
    other = jl.Network.load(elsewhere / "small-k16.1.safetensors")
    return jl.Network([*start.layers[:2], *other.layers[2:]], sensor)


def learned(name: str, scenes: list[np.ndarray], options: argparse.Namespace) -> jl.Network:
    network = start_of(name, options.elsewhere)
    for seed, (steps, rate) in enumerate(STAGES.get(name, FURTHER), 1):
        done = options.elsewhere / f"{name}.{seed}.safetensors"
        if done.exists():
            earlier = jl.Network.load(done)
            # A stage of other steps, or from another start, is run anew.
            run = earlier.history["run"]
            if (run["steps"], run["network"]) == (steps, fingerprint_network(network)):
                network = earlier
                continue
        checkpoint = options.elsewhere / f"{name}.{seed}.checkpoint.safetensors"
        network, _ = train(
            network,
            scenes,
            steps=steps,
            rate=rate,
            rng=seed,
            checkpoint=checkpoint,
            resume=checkpoint.exists(),
            callback=partial(tell, name, steps),
            device="cpu",
            threads=options.threads,
        )
        network.save(done)
    return network


def tell(name: str, steps: int, record: jl.training.Record) -> None:
    if record.step % 500 == 0:
        print(f"{name}: step {record.step} of {steps}, cost {record.loss:.4g}", flush=True)


def card_of(name: str, network: jl.Network, tests: list[np.ndarray]) -> str:
    stages = STAGES.get(name, FURTHER)
    trainer = ", then ".join(f"{steps:,} steps at rate {rate:g}" for steps, rate in stages)
    if name in SMALL[1:]:
        trainer += ", from the first stage of small-k16"
    if network.trials_range is None:
        bits = sensor_of(name).bits_per_pixel
        scores = scored(network, bits, tests)
        purpose = (
            f"K = {bits} one-bit observations of each pixel, in space, in time, or both, or their "
            "counts;\n  threshold q = 1, gain α = K, box kernel, intensities in [0, 1]."
        )
        measured = f"PSNR {np.mean(scores):.2f} dB, first 20 {np.mean(scores[:20]):.2f} dB"
    else:
        low, high = network.trials_range
        purpose = (
            f"any K from {low} to {high}, which it is told; any exposure with 0.02 to 3 detections "
            "per jot and frame in\n  the mean, dark counts among them; any threshold, through P; "
            "box kernel."
        )
        every = {bits: np.mean(scored(network, bits, tests[:20])) for bits in (1, 4, 16, 64, 256)}
        measured = "α = K, first 20, PSNR " + ", ".join(
            f"{psnr:.2f} dB for K = {bits}" for bits, psnr in every.items()
        )
    return CARD.read_text(encoding="utf-8").format(
        name=name,
        title=f"Layers of {' → '.join(str(layer.channels) for layer in network.layers)} channels",
        parameters=sum(layer.parameter_count for layer in network.layers),
        work=flops_per_pixel(network.layers) / 1000,
        purpose=purpose,
        trainer=trainer,
        measured=measured,
    )


def scored(network: jl.Network, bits: int, tests: list[np.ndarray]) -> list[float]:
    sensor = jl.Sensor(frames=bits)
    return [
        jl.metrics.psnr(network.reconstruct(sensor.expose(image, rng=number), sensor), image)
        for number, image in enumerate(tests)
    ]


if __name__ == "__main__":
    main()
