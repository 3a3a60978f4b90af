"""Measure how often real counts lie in the intervals that `jotlight.uncertainty` predicts.

    python benchmarks/studies/held_out_coverage.py path/to/data [--trials 1 4 16 32] [--draws 3]
        [--methods network-medium network-large noniterative-tv] [--level 0.9]

The folder holds ``real/swissspad2_bird/counts.npz``: the ones of 64 frames of a SwissSPAD2. Some of
the 64 bits of each pixel are drawn at random, which leaves two exact, independent parts. The
intervals come from the drawn bits. With the confidence levels from 0.5 to 0.98, they are the
quantiles of the intensity. A held-out count is a binomial draw for one of these intensities, so its
predicted distribution is a mixture of binomial ones. The table shows how many held-out counts lie
in the central interval of this distribution; an atom at its ends counts in part, as usual for
whole numbers. Decades and classes are those of the estimate of "large" from all 64 frames.
"""

import argparse
from pathlib import Path

import numpy as np
from interval_coverage import CLASSES, DECADES, MIN_FRACTION, classify
from scipy.stats import binom

import jotlight as jl

FRAMES = 64
LEVELS = 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98
NODES = 40
"""Number of equally probable intensities that stand for the predicted distribution."""

MAX_INTENSITY = 4.0


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--trials", nargs="+", type=int, default=[1, 4, 16, 32])
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument(
        "--methods", nargs="+", default=["network-medium", "network-large", "noniterative-tv"]
    )
    parser.add_argument("--level", type=float, default=0.9)
    options = parser.parse_args()
    with np.load(options.data / "real/swissspad2_bird/counts.npz", allow_pickle=False) as counts:
        ones = counts["k64"].astype(np.int64)
    scene = jl.pretrained(sensor_of(FRAMES), "large").reconstruct(
        ones.astype(np.int32), sensor_of(FRAMES)
    )
    groups = find_groups(scene)
    print(f"| K | method | {' | '.join(groups)} |\n|{' --- |' * (2 + len(groups))}")
    for trials in options.trials:
        for method in options.methods:
            inside = np.mean(
                [
                    contained(ones, trials, method, options.level, np.random.default_rng(draw))
                    for draw in range(options.draws)
                ],
                axis=0,
            )
            shares = (f"{100 * inside[group].mean():.1f}" for group in groups.values())
            print(f"| {trials} | {method} | {' | '.join(shares)} |", flush=True)


def sensor_of(frames: int) -> jl.Sensor:
    return jl.Sensor(frames=frames, max_intensity=MAX_INTENSITY)


def find_groups(scene: np.ndarray) -> dict[str, np.ndarray]:
    """Return the pixels of each group: all, the classes, and the decades of the intensity."""
    groups = {"all": np.ones(scene.shape, bool)}
    classes = classify(scene / np.percentile(scene, 99.5))
    groups |= {name: classes == number for number, name in enumerate(CLASSES)}
    decades = np.floor(np.log10(np.maximum(scene, 1e-9)))
    groups |= {name: decades == number for number, name in DECADES.items()}
    return {name: group for name, group in groups.items() if group.mean() > MIN_FRACTION}


def contained(
    ones: np.ndarray, trials: int, method: str, level: float, rng: np.random.Generator
) -> np.ndarray:
    """Return whether each held-out count lies in its predicted interval, in [0, 1]."""
    drawn = rng.hypergeometric(ones, FRAMES - ones, trials)
    held_out, number = ones - drawn, FRAMES - trials
    nodes = predicted_intensities(drawn.astype(np.int32), sensor_of(trials), method)
    probability = -np.expm1(-nodes)
    below = binom.cdf(held_out - 1, number, probability).mean(axis=0)
    at = binom.pmf(held_out, number, probability).mean(axis=0)
    place = below + rng.random(ones.shape) * at
    return np.abs(2 * place - 1) < level


def predicted_intensities(counts: np.ndarray, sensor: jl.Sensor, method: str) -> np.ndarray:
    """Return the intensities (NODES, H, W) at equally spaced quantiles of the prediction."""
    ends = [
        jl.uncertainty(counts, sensor, method=method, confidence_level=level) for level in LEVELS
    ]
    quantiles = [*(each.low for each in ends[::-1]), *(each.high for each in ends)]
    places = [(1 - level) / 2 for level in LEVELS[::-1]] + [(1 + level) / 2 for level in LEVELS]
    wanted = (np.arange(NODES) + 0.5) / NODES
    # Outside of the largest level, the last end stands for the tail.
    right = np.clip(np.searchsorted(places, wanted), 1, len(places) - 1)
    gaps = np.diff(places)[right - 1]
    share = np.clip((wanted - np.take(places, right - 1)) / gaps, 0, 1)[:, None, None]
    stack = np.sort(np.asarray(quantiles, np.float64), axis=0)
    return (1 - share) * stack[right - 1] + share * stack[right]


if __name__ == "__main__":
    main()
