"""Accuracy on known scenes and on real counts.

    python benchmarks/accuracy.py path/to/data [--images 20]

The folder holds ``bsds300/test/*.jpg`` and ``real/swissspad2_bird/counts.npz``. What is missing is
named and left out.
"""

import argparse
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.comparison import chosen
from jotlight.methods import METHODS
from jotlight.pictures import read_picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--images", type=int, default=20)
    options = parser.parse_args()
    synthetic()
    for part in (photographs, real_counts):
        try:
            part(options.data, options.images)
        except FileNotFoundError as missing:
            print(f"\nleft out: {missing}")


def synthetic() -> None:
    """Maximum likelihood on intensities uniform in [0, 1]."""
    print("| K | MLE, dB |\n| ---: | ---: |")
    for side in range(3, 11):
        sensor = jl.Sensor(oversampling=side)
        scene = jl.datasets.uniform_scene((2048, 2048), rng=side)
        estimate = jl.mle(sensor.expose(scene, rng=side), sensor)
        print(f"| {side**2} | {jl.metrics.psnr(estimate, scene):.3f} |", flush=True)


def photographs(data: Path, number: int) -> None:
    """Every method on BSDS test images at K = 16."""
    paths = sorted((data / "bsds300/test").glob("*.jpg"))[:number]
    if not paths:
        raise FileNotFoundError(data / "bsds300/test/*.jpg")
    sensor = jl.Sensor(oversampling=4)
    runs = {name: METHODS[name].run for name in chosen(sensor)}
    runs |= {
        f"network, initial, sigma = {sigma}": lambda bits, sensor, sigma=sigma: jl.Network.initial(
            sensor, sigma=sigma
        ).reconstruct(bits)
        for sigma in (0.5, 1.0)
    }
    if METHODS["noniterative-bm3d"].available:
        runs["noniterative-bm3d, algebraic inverse"] = lambda bits, sensor: jl.noniterative(
            bits, sensor, denoiser="bm3d", inverse="algebraic"
        )
    scores: dict[str, list[tuple[float, ...]]] = {name: [] for name in runs}
    for seed, path in enumerate(paths):
        image = read_picture(path, gray=True)
        bits = sensor.expose(image, rng=seed)
        for name, run in runs.items():
            estimate = run(bits, sensor)
            measures = (jl.metrics.psnr, jl.metrics.snr, jl.metrics.ssim)
            scores[name].append(tuple(measure(estimate, image) for measure in measures))
    print(f"\n| method, mean of {len(paths)} images | PSNR, dB | SNR, dB | SSIM |")
    print("| --- | ---: | ---: | ---: |")
    for name, rows in scores.items():
        psnr, snr, ssim = np.mean(rows, axis=0)
        print(f"| {name} | {psnr:.2f} | {snr:.2f} | {ssim:.3f} |")


def real_counts(data: Path, _: int) -> None:
    """From 16 real frames, against the independent 48 further frames of the same scene."""
    path = data / "real/swissspad2_bird/counts.npz"
    if not path.is_file():
        raise FileNotFoundError(path)
    with np.load(path, allow_pickle=False) as counts:
        few, further = counts["k16"], counts["k64"].astype(int) - counts["k16"]
    sensor = jl.Sensor(frames=16, max_intensity=4.0)
    independent = further >= 0

    def decibel(estimate: np.ndarray) -> float:
        error = -np.expm1(-estimate) - further / 48
        return -10 * np.log10(np.mean(error[independent] ** 2))

    print("\n| method on 16 real frames | exact inverse, dB | algebraic, dB |")
    print("| --- | ---: | ---: |")
    print(f"| mle | {decibel(jl.mle(few, sensor)):.2f} | |")
    print(f"| admm-tv | {decibel(jl.admm_tv(few, sensor)):.2f} | |")
    for name in ("gaussian", "tv", "nlm", "bm3d"):
        if METHODS[f"noniterative-{name}"].available:
            exact, algebraic = (
                decibel(jl.noniterative(few, sensor, denoiser=name, inverse=inverse))
                for inverse in ("exact", "algebraic")
            )
            print(f"| noniterative-{name} | {exact:.2f} | {algebraic:.2f} |")


if __name__ == "__main__":
    main()
