"""Train the deep networks that come with jotlight, and write their cards.

    python tools/train_deep_models.py path/to/data [--only small-k16 medium ...] [--threads 2]

The folder holds ``bsds300/train/*.jpg`` to learn from and ``bsds300/test/*.jpg`` to measure on. The
networks go to ``python/jotlight/models``. Runs that are stopped go on where they were. It needs the
extra `torch`. `medium-k16` and `large-k16`, for K = 16 alone, are to compare with and go to
`--elsewhere`; the small networks begin at `small-k16`, which comes first.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.image_sets import read_image_set
from jotlight.models import BITS_PER_PIXEL, FOLDER
from jotlight.torch import train

RATE, SEED = 3e-3, 1
FIRST, STEPS, FURTHER, FURTHER_RATE = 40_000, 20_000, 8_000, 1.5e-3
COMPARED = "medium-k16", "large-k16"
SMALL = [f"small-k{bits}" for bits in (16, *(bits for bits in BITS_PER_PIXEL if bits != 16))]
NAMES = [*SMALL, "medium", *COMPARED]
CARD = Path(__file__).with_name("deep_model_card.md")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--only", nargs="+", choices=NAMES, default=[*SMALL, "medium"])
    parser.add_argument("--elsewhere", type=Path, default=Path("target/models"))
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    options.elsewhere.mkdir(parents=True, exist_ok=True)
    _, scenes = read_image_set(options.data / "bsds300/train")
    _, tests = read_image_set(options.data / "bsds300/test")
    for name in options.only:
        folder = options.elsewhere if name in COMPARED else FOLDER
        network, seconds = learned(name, scenes, options)
        network.history["trained on"] = "BSDS300 train, grey"
        network.save(folder / f"{name}.safetensors")
        card = card_of(name, network, seconds, tests)
        (folder / f"{name}.md").write_text(card, encoding="utf-8")
        print(card, flush=True)


def sensor_of(name: str) -> jl.Sensor:
    bits = int(name.split("-k")[1]) if "-k" in name else 16
    return jl.Sensor(frames=bits)


def start_of(name: str) -> tuple[jl.Network, int, float]:
    """Where a network begins, its steps, and their rate."""
    sensor, member = sensor_of(name), name.split("-")[0]
    if name == "medium":
        return jl.Network.told(member, rng=0), STEPS, RATE
    start = jl.Network.deep(sensor, member, rng=0)
    if name == "small-k16":
        return start, FIRST, RATE
    if member != "small":
        return start, STEPS, RATE
    # The counts and x0 of its own K, and all else of the network for 16.
    other = jl.Network.load(FOLDER / "small-k16.safetensors")
    return jl.Network([*start.layers[:2], *other.layers[2:]], sensor), FURTHER, FURTHER_RATE


def learned(
    name: str, scenes: list[np.ndarray], options: argparse.Namespace
) -> tuple[jl.Network, float]:
    start, steps, rate = start_of(name)
    checkpoint = options.elsewhere / f"{name}.checkpoint.safetensors"
    begun = time.perf_counter()
    network, _ = train(
        start,
        scenes,
        steps=steps,
        rate=rate,
        rng=SEED,
        checkpoint=checkpoint,
        resume=checkpoint.exists(),
        callback=lambda record: tell(name, record, steps),
        device="cpu",
        threads=options.threads,
    )
    return network, time.perf_counter() - begun


def tell(name: str, record: jl.training.Record, steps: int) -> None:
    if record.step % 500 == 0:
        print(f"{name}: step {record.step} of {steps}, cost {record.loss:.4g}", flush=True)


def card_of(name: str, network: jl.Network, seconds: float, tests: list[np.ndarray]) -> str:
    sensor = sensor_of(name)
    scores = [score(network, sensor, image, number) for number, image in enumerate(tests)]
    return CARD.read_text(encoding="utf-8").format(
        name=name,
        parameters=sum(layer.parameters for layer in network.layers),
        first=np.mean(scores[:20]),
        all=np.mean(scores),
        bits=sensor.bits_per_pixel,
        seconds=seconds,
    )


def score(network: jl.Network, sensor: jl.Sensor, image: np.ndarray, number: int) -> float:
    estimate = network.reconstruct(sensor.expose(image, rng=number), sensor)
    return jl.metrics.psnr(estimate, image)


if __name__ == "__main__":
    main()
