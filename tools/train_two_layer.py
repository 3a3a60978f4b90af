"""Train the networks that come with jotlight, and write their cards.

    python tools/train_two_layer.py path/to/data [--bits 16]

The folder holds ``bsds300/train/*.jpg`` to learn from and ``bsds300/test/*.jpg`` to measure on. The
networks go to ``python/jotlight/networks/weights``. All eight take some ten minutes on two cores.
"""

import argparse
import time
from pathlib import Path

import jotlight as jl
from jotlight.evaluation.evaluate import Evaluation
from jotlight.images.sets import read_image_set
from jotlight.networks.pretrained import BITS_PER_PIXEL, FOLDER

STEPS, BATCH, PATCH, SEED = 60, 512, 64, 0

CARD = Path(__file__).with_name("model_card.md")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--bits", type=int, choices=BITS_PER_PIXEL, action="append")
    options = parser.parse_args()
    _, scenes = read_image_set(options.data / "bsds300/train")
    names, tests = read_image_set(options.data / "bsds300/test")
    for bits in options.bits or BITS_PER_PIXEL:
        train_one(bits, scenes, names, tests)


def train_one(bits: int, scenes: list, names: list[str], tests: list) -> None:
    sensor = jl.Sensor(oversampling=round(bits**0.5))
    start = jl.Network.initial(sensor)
    begun = time.perf_counter()
    learned, _ = jl.train(start, scenes, steps=STEPS, batch=BATCH, patch=PATCH, rng=SEED)
    seconds = time.perf_counter() - begun
    learned.history["trained on"] = "BSDS300 train, grey"
    learned.save(FOLDER / f"two-layer-k{bits}.safetensors")
    scores = jl.evaluate(learned, tests, sensor, names=names)
    other = jl.evaluate(jl.mle, tests, sensor, names=names)
    card = CARD.read_text(encoding="utf-8").format(
        bits=bits,
        parameters=sum(x.filters.size + x.coefficients.size for x in learned.layers),
        steps=STEPS,
        batch=BATCH,
        patch=PATCH,
        seed=SEED,
        seconds=seconds,
        psnr=scores.mean("psnr"),
        first=Evaluation(scores.scores[:20]).mean("psnr"),
        worst=scores.mean_of_worst("psnr", 0.05),
        snr=scores.mean("snr"),
        ssim=scores.mean("ssim"),
        mle_psnr=other.mean("psnr"),
        mle_ssim=other.mean("ssim"),
    )
    (FOLDER / f"two-layer-k{bits}.md").write_text(card, encoding="utf-8")
    print(
        f"K = {bits}: {scores.mean('psnr'):.2f} dB, SSIM {scores.mean('ssim'):.3f}, "
        f"{seconds:.0f} s",
        flush=True,
    )


if __name__ == "__main__":
    main()
