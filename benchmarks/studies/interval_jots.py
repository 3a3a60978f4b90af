"""Measure how many intervals contain the true intensity if the jots of a sensor differ.

    python benchmarks/studies/interval_jots.py [DATA]

The images are parts of six photographs of `photographs/cid22` in DATA, or of two that come with
scikit-image, 192 x 192 pixels, in gray. The table shows how many percent of the intervals of 90 %
contain the true intensity: of all pixels, of the thirds with the least and the most variance in
3 x 3 pixels, and of the *weak* and the other pixels. Weak ones have an efficiency below 0.4, hot or
dead jots, or the lowest threshold. *width* is the median width.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
from dim_scenes import SHAPE, SIDE, photographs
from scipy.ndimage import uniform_filter

import jotlight as jl

LEVEL = 0.9
TRIALS = 4, 16, 64


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, nargs="?")
    images = photographs(parser.parse_args().data)
    warnings.simplefilter("ignore", jl.JotlightWarning)
    print("| sensor | K | all | flat | active | weak | others | width |")
    print(f"| --- |{' ---: |' * 7}")
    for name, (weak, options) in sensors().items():
        for trials in TRIALS:
            rows = []
            for seed, image in enumerate(images):
                bits = jl.Sensor(**options(trials)).expose(image, rng=seed)
                rows.append(coverage(jl.uncertainty(bits, confidence_level=LEVEL), image, weak))
            *shares, width = np.mean(rows, axis=0)
            cells = " | ".join("" if np.isnan(each) else f"{100 * each:.1f}" for each in shares)
            print(f"| {name} | {trials} | {cells} | {width:.3f} |", flush=True)


def sensors() -> dict:
    """Return the weak pixels of each sensor, and its options for a number of frames."""
    rng = np.random.default_rng(0)
    none = np.zeros(SHAPE, bool)
    efficiency, fine = rng.uniform(0.1, 1, SHAPE), rng.uniform(0.1, 1, (2 * SIDE, 2 * SIDE))
    hot, dead = (rng.random(SHAPE) < share for share in (0.02, 0.05))
    many = {share: np.random.default_rng(1).random(SHAPE) < share / 100 for share in (30, 60, 90)}
    checkerboard = np.where(np.indices(SHAPE).sum(0) % 2, 1, 4)
    thresholds = rng.choice([1, 2, 4], SHAPE)

    def of(**options):
        return lambda frames: {"frames": frames, **options, "gain": options["gain"] * frames}

    return {
        "alike": (none, of(gain=1.0)),
        "efficiency from 0.1 to 1": (efficiency < 0.4, of(gain=1.5, efficiency=efficiency)),
        "2 % hot jots with 3 dark counts": (
            hot,
            of(gain=1.0, dark_counts=np.where(hot, 3.0, 0.01)),
        ),
        "5 % dead jots": (dead, of(gain=1.0, mask=dead)),
        **{f"{share} % dead jots": (mask, of(gain=1.0, mask=mask)) for share, mask in many.items()},
        "2 x 2 jots with efficiency from 0.1 to 1": (
            none,
            of(gain=6.0, oversampling=2, efficiency=fine),
        ),
        "bracket 1 : 4, efficiency from 0.1 to 1": (
            efficiency < 0.4,
            lambda frames: {
                "frames": frames,
                "gain": np.tile([0.5, 2.0], frames // 2),
                "efficiency": efficiency,
            },
        ),
        "checkerboard of the thresholds 1, 4": (
            checkerboard == 1,
            of(gain=3.0, threshold=checkerboard),
        ),
        "random thresholds 1, 2, 4": (thresholds == 1, of(gain=3.0, threshold=thresholds)),
    }


def coverage(found: jl.Uncertainty, image: np.ndarray, weak: np.ndarray) -> list[float]:
    """Return the coverage of the classes of pixels, and the median width."""
    contains = (found.low <= image) & (image <= found.high)
    variance = uniform_filter(image**2, 3) - uniform_filter(image, 3) ** 2
    classes = [
        np.ones_like(weak),
        variance < np.quantile(variance, 1 / 3),
        variance > np.quantile(variance, 2 / 3),
        *((weak, ~weak) if weak.any() else (weak, weak)),
    ]
    shares = [contains[each].mean() if each.any() else np.nan for each in classes]
    return [*shares, np.median(found.high - found.low)]


if __name__ == "__main__":
    main()
