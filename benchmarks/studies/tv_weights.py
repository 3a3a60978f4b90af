"""Fit the constants of the automatic weight of total variation to training images.

    python benchmarks/studies/tv_weights.py path/to/bsds300/train [--images 12]

The rule is λ = strength · √(I (1 + 0.05 b²)) · (√Ī γ)^-power
(``jotlight.estimators.tv.automatic_weight``). For
each image and exposure, the study makes the estimates of a range of weights once. Interpolation
between them shows what each strength and power loses against the best weight for that image.
"""

import argparse
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.estimators import tv
from jotlight.estimators.iterative.problem_building import build_problem
from jotlight.images.io import read_image

EXPOSURES = ((2, 1.0), (4, 0.1), (4, 0.3), (4, 1.0), (4, 3.0), (8, 1.0))
"""K̂, and photons per jot at intensity 1."""

FACTORS = np.array([0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 1.0, 1.2, 1.5])
"""Weights in units of the √(I (1 + 0.05 b²)) of each pixel."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--images", type=int, default=12)
    options = parser.parse_args()
    paths = sorted(options.folder.glob("*.jpg"))
    if not paths:
        parser.error(f"{options.folder}: expected .jpg files")
    paths = paths[:: max(1, len(paths) // options.images)][: options.images]
    roughness, curves = [], []
    for side, photons in EXPOSURES:
        sensor = jl.Sensor(oversampling=side, gain=photons * side**2)
        rows = [measure(sensor, path, seed) for seed, path in enumerate(paths)]
        roughness.append([row[0] for row in rows])
        curves.append([row[1] for row in rows])
        best = np.mean([row[1].max() for row in rows])
        print(f"K = {side**2}, {photons} photons: best {best:.2f} dB", flush=True)
    print_losses(np.array(roughness), np.array(curves))


def measure(sensor: jl.Sensor, path: Path, seed: int) -> tuple[float, np.ndarray]:
    """Return the scene's roughness in units of the noise, and the PSNR for each factor."""
    image = read_image(path, gray=True)[40:280, 40:280]
    counts = sensor.expose(image, rng=seed).counts()
    problem = build_problem(counts, sensor, None)
    automatic = tv.automatic_weight(problem)[0]
    # The automatic weight in these units reveals the roughness that the rule found.
    light = problem.operator.forward(np.ones(image.shape))
    constant = problem.constant_estimates()[0] * light
    local = tv.local_information(problem, light, constant)
    noise_scale = np.sqrt(tv.tailed_information(*local))[0]
    factor = float((automatic / noise_scale).mean())
    rough = (factor / tv.WEIGHT_STRENGTH) ** (-1 / tv.WEIGHT_POWER)
    psnr = [
        jl.metrics.psnr(jl.admm_tv(counts, sensor, weight=f * noise_scale), image) for f in FACTORS
    ]
    return rough, np.array(psnr)


def print_losses(roughness: np.ndarray, curves: np.ndarray) -> None:
    best = curves.max(axis=-1)
    print("\n| power | strength | loss in each exposure, dB | in the mean, dB |")
    print("| ---: | ---: | --- | ---: |")
    for power in (0, 0.25, 0.3, 1 / 3, 0.4, 0.5):
        losses = []
        for strength in np.arange(0.4, 0.9, 0.02):
            factor = strength * roughness**-power
            reached = np.array(
                [
                    [np.interp(np.log(f), np.log(FACTORS), c) for f, c in zip(*row, strict=True)]
                    for row in zip(factor, curves, strict=True)
                ]
            )
            loss = (best - reached).mean(axis=1)
            losses.append((loss.mean(), strength, loss))
        mean, strength, loss = min(losses, key=lambda row: row[0])
        each = " / ".join(f"{value:.2f}" for value in loss)
        print(f"| {power:.2f} | {strength:.2f} | {each} | {mean:.3f} |")


if __name__ == "__main__":
    main()
