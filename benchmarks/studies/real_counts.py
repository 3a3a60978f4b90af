"""Measure the accuracy on real counts of 16, 4, and 1 frames, against 48 further frames.

    python benchmarks/studies/real_counts.py path/to/data

The folder holds ``real/swissspad2_bird/counts.npz``. The strengths of the denoisers are the best
ones by the reference, which is an upper bound of what they can reach. ``jl.train`` trains the
network on scikit-image's photographs, which are made as bright as the counts. The study takes
about five minutes on two cores.

A second table compares the networks with BM3D, after the reference's noise is subtracted. The
standard error of the difference in dB is that of a jackknife over blocks of 32 x 32 pixels, which
keeps the correlation of neighboring errors.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from skimage.restoration import denoise_tv_chambolle

import jotlight as jl
from jotlight.estimators.brightness import training_sensor
from jotlight.evaluation.methods import METHODS


def converged_tv(image: np.ndarray, weight: float) -> np.ndarray:
    """Return the result of `jl.denoise.tv` without scikit-image's early stop."""
    estimate = denoise_tv_chambolle(image, weight=weight, eps=1e-7, max_num_iter=1000)
    return np.asarray(estimate, np.float32)


STRENGTHS: dict[str, tuple[Callable, str, tuple[float, ...]]] = {
    "gaussian": (jl.denoise.gaussian, "sigma", (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)),
    "tv": (jl.denoise.tv, "weight", (0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)),
    "tv to its minimum": (converged_tv, "weight", (0.3, 0.4, 0.5, 0.6, 0.7, 1.0)),
    "nlm": (jl.denoise.nlm, "strength", (0.5, 0.6, 0.7, 0.8, 0.9)),
}


NETWORKS = "network-medium", "network-large"
BLOCK = 32


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    path = parser.parse_args().data / "real/swissspad2_bird/counts.npz"
    with np.load(path, allow_pickle=False) as counts:
        captures = {frames: counts[f"k{frames}"].astype(np.int32) for frames in (16, 4, 1)}
        further = counts["k64"].astype(int) - counts["k16"]
    independent = further >= 0
    reference = further[independent] / 48
    # Unbiased, since Var(k / n) = p (1 - p) / n is (k/n) (1 - k/n) / (n - 1) in the mean.
    noise = np.mean(reference * (1 - reference)) / 47
    print(f"The reference's own noise: {-10 * np.log10(noise):.2f} dB\n")
    print("| frames | method | PSNR, dB | without the reference's noise, dB |")
    print("| ---: | --- | ---: | ---: |")
    differences = []
    for frames, image in captures.items():
        kept = {}
        for tries in estimates(image, frames):
            errors = {
                name: np.mean((-np.expm1(-estimate[independent]) - reference) ** 2)
                for name, estimate in tries.items()
            }
            name = min(errors, key=errors.__getitem__)
            kept[name] = tries[name]
            error, left = errors[name], max(errors[name] - noise, 1e-9)
            print(
                f"| {frames} | {name} | {-10 * np.log10(error):.2f} | {-10 * np.log10(left):.2f} |",
                flush=True,
            )
        if "noniterative-bm3d" in kept:
            squared = {
                name: np.where(independent, (-np.expm1(-kept[name]) - further / 48) ** 2, 0)
                for name in ("noniterative-bm3d", *NETWORKS)
            }
            for name in NETWORKS:
                pair = squared[name], squared["noniterative-bm3d"]
                differences.append((frames, name, *gain_and_error(*pair, independent, noise)))
    print("\n| frames | network | above BM3D, dB | standard error, dB |")
    print("| ---: | --- | ---: | ---: |")
    for frames, name, gain, error in differences:
        print(f"| {frames} | {name} | {gain:+.2f} | {error:.2f} |")


def gain_and_error(squared, other, independent, noise):
    """Return the gain in dB over the other method without the reference's noise, and its error."""
    starts = [np.arange(0, size, BLOCK) for size in squared.shape]

    def block_sums(values):
        rows = np.add.reduceat(np.asarray(values, np.float64), starts[0], axis=0)
        return np.add.reduceat(rows, starts[1], axis=1).ravel()

    sums = np.array([block_sums(values) for values in (squared, other, independent)])

    def gain(total):
        left = total[:2] / total[2] - noise
        return 10 * np.log10(left[1] / left[0])

    total = sums.sum(axis=1)
    without = np.array([gain(total - block) for block in sums.T])
    number = len(without)
    error = np.sqrt((number - 1) / number * np.sum((without - without.mean()) ** 2))
    return gain(total), error


def estimates(image, frames):
    """Yield groups of estimates by name. The best of each group counts."""
    sensor = jl.Sensor(frames=frames, max_intensity=4.0)
    yield {"mle": jl.mle(image, sensor)}
    yield {"admm-tv": jl.admm_tv(image, sensor)}
    for name, (denoise, parameter, values) in STRENGTHS.items():
        yield {
            f"noniterative-{name}, {parameter} {value:g}": jl.noniterative(
                image, sensor, denoiser=partial(denoise, **{parameter: value})
            )
            for value in values
        }
    if METHODS["noniterative-bm3d"].available:
        yield {"noniterative-bm3d": jl.noniterative(image, sensor, denoiser="bm3d")}
    for name in NETWORKS:
        network = jl.pretrained(sensor, name.removeprefix("network-"))
        yield {name: network.reconstruct(image, sensor)}
    start = time.perf_counter()
    fitted, scale = training_sensor(image, sensor)
    photographs = [jl.datasets.photograph(name, gray=True) for name in jl.datasets.PHOTOGRAPHS]
    network, _ = jl.train(
        jl.Network.initial(fitted), [np.float32(scale) * photo for photo in photographs], rng=0
    )
    seconds = time.perf_counter() - start
    yield {f"network for this capture, trained in {seconds:.0f} s": network.reconstruct(image)}


if __name__ == "__main__":
    main()
