"""Measure what each kind of training patches adds, by short runs of the small network.

    python tools/ingredients.py path/to/data [--steps 2000] [--seeds 1] [--output docs/results]

The folder holds the images of the module `training_data`. Each run continues from the weights of
the package, so that differences between the ingredients exceed the noise of short runs. The scores
are the PSNR in dB, averaged over validation photographs and over drawings, of the start and after
training with the ingredients up to a row. It needs the extra `torch`.
"""

import argparse
import csv
from pathlib import Path

import numpy as np

import jotlight as jl
import training_data
from jotlight.files import atomic_write
from jotlight.networks.pretrained import FOLDER
from jotlight.torch import train
from jotlight.training import PatchMixture, PatchSource, PhotographPatches, SyntheticPatches

CONDITIONS = (4, 1.0), (16, 1.0), (64, 1.0), (256, 1.0), (16, 0.05), (16, 4.0)
"""Trials, and photons per jot and frame at intensity 1."""

LEARNING_RATE = 1e-3
PLANES, DRAWINGS_WEIGHT = 0.25, 0.7
"""Fraction of color planes and of linear light, and weight of drawings among the photographs."""

MIN_CONTRAST = 0.05
"""Smallest standard deviation of a drawing that is measured."""

COLUMNS = "ingredients", "seed", "bits", "flux", "kind", "psnr_db"
PLAIN = {"color": 0.0, "linear": 0.0, "scaled": 0.0}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--threads", type=int)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    photographs = training_data.validation_images(options.data)
    drawings = [SyntheticPatches().draw(rng, 160).values for rng in generators(32)]
    # The PSNR of a flat image is so high that it would outweigh all others in the mean.
    drawings = [drawing for drawing in drawings if drawing.std() > MIN_CONTRAST]
    start = jl.Network.load(FOLDER / "templates.safetensors")
    rows: list[tuple[object, ...]] = []

    def measure(name: str, seed: int, network: jl.Network) -> None:
        for kind, images in (("photographs", photographs), ("drawings", drawings)):
            for bits, flux in CONDITIONS:
                score = psnr(network, images, bits, flux, options.threads)
                rows.append((name, seed, bits, flux, kind, f"{score:.3f}"))
        print(name, seed, *(row[-1] for row in rows[-2 * len(CONDITIONS) :]), flush=True)

    measure("start", 0, start)
    settings = {"steps": options.steps, "learning_rate": LEARNING_RATE, "threads": options.threads}
    sources = ingredients(options.data)
    for seed in range(options.seeds):
        for name, source in sources.items():
            measure(name, seed, train(start, source, rng=seed, device="cpu", **settings)[0])
    if options.output is not None:
        with (
            atomic_write(options.output / "ingredients.csv") as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


def generators(number: int) -> list[np.random.Generator]:
    return [np.random.default_rng([7, index]) for index in range(number)]


def ingredients(data: Path) -> dict[str, PatchSource]:
    """Return the sources of patches by name. Each has one more ingredient than the previous one."""

    def mixture(**settings: float) -> PatchMixture:
        return PatchMixture(training_data.photograph_sources(data, **settings))

    bsds300 = training_data.photographs(data, "bsds300/train")
    scaled = mixture(color=0.0, linear=0.0)
    planes = training_data.photograph_sources(data, color=PLANES, linear=PLANES)
    drawings = SyntheticPatches(), DRAWINGS_WEIGHT
    return {
        "BSDS300": PhotographPatches(bsds300, **PLAIN),
        "+ other photographs": mixture(**PLAIN),
        "+ area averages": scaled,
        "+ color planes, linear light": PatchMixture(planes),
        "+ drawings": PatchMixture([*planes, drawings]),
    }


def psnr(
    network: jl.Network, images: list[np.ndarray], bits: int, flux: float, threads: int | None
) -> float:
    sensor = jl.Sensor(frames=bits, gain=flux * bits)
    values = []
    for number, image in enumerate(images):
        bits_of_image = sensor.expose(image, rng=number, threads=threads)
        estimate = network.reconstruct(bits_of_image, threads=threads)
        values.append(jl.metrics.psnr(estimate, image))
    return float(np.mean(values))


if __name__ == "__main__":
    main()
