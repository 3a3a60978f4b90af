"""Measure how often the intervals of `jotlight.uncertainty` contain the true intensity.

    python benchmarks/studies/interval_coverage.py IMAGES [--number 20] [--trials 1 4 16 64 256]
        [--photons 0.2 1] [--methods network-medium noniterative-tv] [--level 0.9]
        [--output docs/results]

IMAGES is a folder, whose first images in the order of their names are exposed with an interval of
90 %. The table shows the coverage on all pixels, on flat, edge, and texture pixels of the true
image, and in decades of the true intensity with more than 1 % of the pixels; and the median width
of the intervals, next to that of the exact intervals of maximum likelihood.

The classes are those of ``tools/pixel_classes.py``.
"""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.images.sets import read_image_set

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from pixel_classes import CLASSES, classify

MIN_FRACTION = 0.01
"""Fraction of the pixels from which a decade counts."""

DECADES = {0: "1 to 10", -1: "0.1 to 1", -2: "0.01 to 0.1", -3: "0.001 to 0.01"}


def main() -> None:
    """Measure the coverage, and print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("--number", type=int, default=20)
    parser.add_argument("--trials", nargs="+", type=int, default=[1, 4, 16, 64, 256])
    parser.add_argument("--photons", nargs="+", type=float, default=[0.2, 1.0])
    parser.add_argument("--methods", nargs="+", default=["network-medium", "noniterative-tv"])
    parser.add_argument("--level", type=float, default=0.9)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    images = read_image_set(options.images)[1][: options.number]
    classes = np.concatenate([classify(image).ravel() for image in images])
    rows: list[dict[str, str]] = []
    for trials in options.trials:
        for photons in options.photons:
            sensor = jl.Sensor(frames=trials, gain=photons * trials)
            for method in options.methods:
                values = measure(images, sensor, method, options.level)
                row = {"K": f"{trials}", "photons": f"{photons:g}", "method": method}
                row |= summarize(*values, classes)
                if not rows:
                    print(f"| {' | '.join(row)} |\n| {' | '.join('---' for _ in row)} |")
                rows.append(row)
                print(f"| {' | '.join(row.values())} |", flush=True)
    if options.output is not None:
        with (options.output / "interval_coverage.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)


def measure(
    images: list[npt.NDArray[np.floating]], sensor: jl.Sensor, method: str, level: float
) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.floating], float, float]:
    """Return which pixels are covered, their intensity, and the median width of both intervals."""
    covered, truth, widths, exact = [], [], [], []
    for seed, image in enumerate(images):
        bits = sensor.expose(image, rng=seed)
        known = jl.uncertainty(bits, method=method, confidence_level=level)
        covered.append(((known.low <= image) & (image <= known.high)).ravel())
        truth.append(image.ravel())
        widths.append((known.high - known.low).ravel())
        of_mle = jl.uncertainty(bits, method="mle", confidence_level=level)
        exact.append((of_mle.high - of_mle.low).ravel())
    median, of_exact = (float(np.median(np.concatenate(each))) for each in (widths, exact))
    return np.concatenate(covered), np.concatenate(truth), median, of_exact


def summarize(
    covered: npt.NDArray[np.bool_],
    truth: npt.NDArray[np.floating],
    width: float,
    exact: float,
    classes: npt.NDArray[np.intp],
) -> dict[str, str]:
    """Return the coverage in percent of all pixels and of parts of them, and the widths."""
    row = {"all": percent(covered)}
    row |= {name: percent(covered[classes == index]) for index, name in enumerate(CLASSES)}
    decades = np.floor(np.log10(np.maximum(truth, 1e-9)))
    for decade, name in DECADES.items():
        part = covered[decades == decade]
        row[name] = percent(part) if len(part) > MIN_FRACTION * len(covered) else "–"
    return {**row, "width": f"{width:.3f}", "exact width": f"{exact:.3f}"}


def percent(covered: npt.NDArray[np.bool_]) -> str:
    return f"{100 * covered.mean():.1f}"


if __name__ == "__main__":
    main()
