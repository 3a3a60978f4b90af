"""Measure the quality of the deep networks on Berkeley test images, for every K and exposure.

    python benchmarks/studies/network_quality.py path/to/data [--output docs/results]
        [--methods extra-large]

The folder holds ``bsds300/test/*.jpg``. The bits of image i have the seed i. Every K is measured on
all images and on the first 20, other exposures on the first 20 only. `--model` adds networks to
those of the package, where they serve the sensor. BM3D with the exact inverse is measured on the
first 20 images for some K, if its package is installed. With `--methods`, only these are measured,
and the rows of all other methods in the output stay. Each cell of the tables is a mean PSNR in
dB, and the mean SSIM.
"""

import argparse
import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from jotlight.files import atomic_write
from jotlight.images.sets import read_image_set
from jotlight.networks.architectures import QUALITIES
from jotlight.networks.pretrained import TRAINED_TRIALS

ALL_TRIALS = 1, 4, *TRAINED_TRIALS, 256
FLUXES = 0.05, 0.2, 1.0, 4.0
"""Photons per jot and frame at intensity 1. The mean of photographs is 0.44 of that."""

EXPOSURE_BITS = 4, 16, 64
"""Trials per pixel at which all fluxes are measured."""

BM3D, BM3D_BITS = "BM3D", (1, 4, 16, 64, 100)
"""Name of BM3D in the tables, and the trials per pixel at which it is measured, as it is slow."""

FIRST = 20
COLUMNS = "bits", "flux", "method", "images", "psnr_db", "ssim"

Reconstruct = Callable[[jl.Bits, jl.Sensor], np.ndarray]
Row = tuple[int, float, str, int, str, str]


def main() -> None:
    """Measure everything, and print and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--images", type=int, default=100)
    parser.add_argument("--model", type=Path, nargs="*", default=[])
    parser.add_argument("--methods", nargs="*")
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    _, images = read_image_set(options.data / "bsds300/test", first=options.images)
    rows: list[Row] = []
    for bits, flux in [*((bits, 1.0) for bits in ALL_TRIALS), *exposures()]:
        sensor = jl.Sensor(frames=bits, gain=flux * bits)
        for name, run in methods(sensor, options.model):
            if options.methods and name not in options.methods:
                continue
            tested = images if flux == 1 and name != BM3D else images[:FIRST]
            values = qualities(run, sensor, tested)
            for number in sorted({min(FIRST, len(tested)), len(tested)}):
                psnr, ssim = np.mean(values[:number], axis=0)
                rows.append((bits, flux, name, number, f"{psnr:.3f}", f"{ssim:.4f}"))
                print(*rows[-1], flush=True)
    for number in sorted({row[3] for row in rows}):
        print_table(
            f"first {number} images, α = K", [r for r in rows if r[1] == 1 and r[3] == number]
        )
    print_table("first 20 images, other exposures", [row for row in rows if row[1] != 1])
    if options.output is not None:
        write(options.output / "deep.csv", rows, keep=bool(options.methods))


def write(path: Path, rows: list[Row], *, keep: bool) -> None:
    """Write rows to a file. If `keep` is true, rows of other methods in the file stay."""
    old: list[list[str]] = []
    if keep and path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            measured = {row[2] for row in rows}
            old = [row for row in csv.reader(file) if row[2] not in (*measured, "method")]
    with (
        atomic_write(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *old, *rows])
    print(f"written: {path}")


def exposures() -> list[tuple[int, float]]:
    """Return the trials and the flux of all exposures other than α = K."""
    return [(bits, flux) for bits in EXPOSURE_BITS for flux in FLUXES if flux != 1]


def methods(sensor: jl.Sensor, models: list[Path]) -> list[tuple[str, Reconstruct]]:
    """Return the trained networks, and classical methods."""
    found: list[tuple[str, Reconstruct]] = [
        ("maximum likelihood", jl.mle),
        ("noniterative-tv", lambda bits, sensor: jl.noniterative(bits, sensor, denoiser="tv")),
    ]
    is_measured = sensor.gain == sensor.frames and sensor.frames in BM3D_BITS
    if is_measured and METHODS["noniterative-bm3d"].available:
        found.append((BM3D, lambda bits, sensor: jl.noniterative(bits, sensor, denoiser="bm3d")))
    found += [(quality, jl.pretrained(sensor, quality).reconstruct) for quality in QUALITIES]
    for path in models:
        network = jl.Network.load(path)
        try:
            network.reconstruct(np.zeros((8, 8), np.int32), sensor)
        except ValueError:
            continue
        found.append((path.stem, network.reconstruct))
    return found


def qualities(
    run: Reconstruct, sensor: jl.Sensor, images: list[np.ndarray]
) -> list[tuple[float, float]]:
    """Return the PSNR and the SSIM of each image."""
    results = []
    for number, image in enumerate(images):
        estimate = run(sensor.expose(image, rng=number), sensor)
        results.append((jl.metrics.psnr(estimate, image), jl.metrics.ssim(estimate, image)))
    return results


def print_table(title: str, rows: list[Row]) -> None:
    """Print a table with a row for each sensor, and a column for each method."""
    names = list(dict.fromkeys(row[2] for row in rows))
    print(f"\n{title}\n\n| K | photons | {' | '.join(names)} |")
    print(f"|{' ---: |' * (len(names) + 2)}")
    for bits, flux in dict.fromkeys(row[:2] for row in rows):
        cells = {
            row[2]: f"{float(row[4]):.2f} ({float(row[5]):.3f})"
            for row in rows
            if row[:2] == (bits, flux)
        }
        print(f"| {bits} | {flux:g} | {' | '.join(cells.get(name, '') for name in names)} |")


if __name__ == "__main__":
    main()
