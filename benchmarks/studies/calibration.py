"""Measure the error rates and the limits of the calibration on maps with known truth.

    python benchmarks/studies/calibration.py [path/to/data] [--maps 30]

False positives: the share of clean jots that count as hot, at a stated rate of 1e-4. Cooled
sensors: the share of the hot jots that are found where nearly all counts are 0. Outliers: the error
of the response of ordinary jots and of outliers, by the limit beyond which a response stays as
measured. Hot jots: PSNR by the dark counts above which a hot jot is masked; with the data, also
for a real dark map. Clusters: the error of inpainted pixels, by the method of inpainting.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label
from scipy.special import gammainc
from skimage.restoration import inpaint_biharmonic

import jotlight as jl
from jotlight.calibration.flat import shrink_response
from jotlight.calibration.jot_counts import JotCounts
from jotlight.calibration.outliers import find_outliers
from jotlight.datasets.scenes import PHOTOGRAPHS
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.evaluation.methods import METHODS

SHAPE, RATE = (240, 320), 1e-4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--maps", type=int, default=30)
    options = parser.parse_args()
    # The warnings concern hot jots that cannot be found, and inpainted pixels.
    warnings.simplefilter("ignore", jl.JotlightWarning)
    false_positives(options.maps)
    cooled(options.maps)
    outliers()
    maps = {"simulated": simulated(np.random.default_rng(2))}
    if options.data is not None:
        file = options.data / "real" / "spcimager" / "counts.npz"
        maps["real"] = JotCounts(jl.open(file, key="bframee"), 4096, 1).detections()
    for name, dark in maps.items():
        hot_jots(name, dark)
    clusters()


def table(*columns: str) -> None:
    print("\n| " + " | ".join(columns) + " |")
    print("| --- " + "| ---: " * (len(columns) - 1) + "|")


def row(*cells: object) -> None:
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def photographs() -> list[np.ndarray]:
    return [jl.datasets.photograph(name, gray=True)[-240:, :320] for name in PHOTOGRAPHS]


def false_positives(maps: int) -> None:
    rng = np.random.default_rng(0)
    long_captures = {
        ("uniform", 0.5): lambda: np.full(SHAPE, 0.5),
        ("uniform", 8): lambda: np.full(SHAPE, 8.0),
        ("gamma, shape 4", 8): lambda: rng.gamma(4, 2, SHAPE),
        ("gamma, shape 1", 8): lambda: rng.gamma(1, 8, SHAPE),
        ("gamma, shape 4", 400): lambda: rng.gamma(4, 100, SHAPE),
        ("log-normal, σ = ½", 5): lambda: 5 * np.exp(0.5 * rng.standard_normal(SHAPE) - 0.125),
    }
    kinds = [
        (kind, 4096, mean, lambda ones=ones: -np.expm1(-ones() / 4096))
        for (kind, mean), ones in long_captures.items()
    ]
    kinds += [
        ("uniform", frames, f"{frames * chance:g}", lambda chance=chance: chance)
        for chance, frames in ((0.01, 1), (0.05, 2), (0.2, 4), (0.5, 8), (0.5, 16), (0.9, 16))
    ]
    table(
        "dark counts of the jots", "frames T", "mean number of ones", "T of T ones, predicted",
        "false positives, predicted", "false positives",
    )  # fmt: skip
    for kind, frames, mean, chance in kinds:
        results = []
        for _ in range(maps):
            ones = rng.binomial(frames, chance(), SHAPE).astype(np.int32)
            results.append(jl.calibrate(ones, frames=frames, false_positive_rate=RATE))
        row(
            kind, frames, mean,
            f"{np.mean([one.bulk.tail_probability(frames) for one in results]):.2g}",
            f"{1e4 * np.mean([one.hot_probability for one in results]):.2f} · 10⁻⁴",
            f"{1e4 * np.mean([one.hot.mean() for one in results]):.2f} · 10⁻⁴",
        )  # fmt: skip


def cooled(maps: int) -> None:
    """Measure how many hot jots above 0.1 dark counts are found where other jots have few."""
    rng = np.random.default_rng(3)
    table("threshold", "dark counts of ordinary jots", "frames T", "hot jots", "found", "not hot")
    for threshold, rate, frames, share in (
        (1, 1e-6, 200, 0.02), (1, 1e-5, 100, 0.1), (1, 1e-5, 100, 0.25), (3, 0.008, 2000, 0.01),
    ):  # fmt: skip
        found, called = [], []
        for _ in range(maps):
            hot = rng.random(SHAPE) < share
            dark = np.where(hot, 10 ** rng.uniform(-2, 0, SHAPE), rate)
            ones = rng.binomial(frames, gammainc(threshold, dark))
            result = jl.calibrate(ones, frames=frames, threshold=threshold).hot
            found.append(result[hot & (dark > 0.1)].mean())
            called.append(result[~hot].mean())
        row(
            threshold, f"{rate:g}", frames, f"{share:.0%}", f"{np.mean(found):.1%}",
            f"{1e4 * np.mean(called):.2f} · 10⁻⁴",
        )  # fmt: skip


def outliers() -> None:
    """Measure outliers at a PRNU of 5 % and an intensity of 0.4."""
    rng = np.random.default_rng(1)
    jots, light, outliers = 200_000, 0.4, 50
    limits = (3.0, 4.0, 5.0, 6.0, np.inf)
    table("flat frames", "response", *(f"limit {limit:g} σ" for limit in limits[:-1]), "none")
    for frames in (128, 512, 4096):
        any_counts = JotCounts(np.zeros(jots, np.int32), frames, 1)
        noise = np.full(jots, any_counts.variance(np.array([light]))[0] / light**2)
        for outlier in (1, 0.3, 0.5, 0.7, 1.5, 2, 3.5):
            truth = 1 + 0.05 * rng.standard_normal(jots)
            compared = slice(None)
            if outlier != 1:
                compared = slice(outliers)
                truth[compared] = outlier
            ones = rng.binomial(frames, -np.expm1(-light * truth)).astype(np.int32)
            counted = JotCounts(ones, frames, 1)
            measured = counted.detections() / light
            dark, lights = np.zeros(jots), np.full(jots, light)
            shrunk = []
            for limit in limits:
                found = find_outliers(counted, dark, lights, measured, noise, 0.05, limit)
                shrunk.append(shrink_response(measured, noise, 0.05**2, found))
            errors = [np.sqrt(np.mean((each - truth)[compared] ** 2)) for each in shrunk]
            name = "1 ± 0.05" if outlier == 1 else outlier
            row(frames, name, *(f"{error:.3f}" for error in errors))


def simulated(rng: np.random.Generator) -> np.ndarray:
    """Return gamma-distributed dark counts, with much larger ones in a fifth of the jots."""
    dark = rng.gamma(4, 0.0005, SHAPE)
    hot = rng.random(SHAPE) < 0.2
    dark[hot] = 10 ** rng.uniform(-2.5, 1, hot.sum())
    return dark


def hot_jots(name: str, dark: np.ndarray) -> None:
    rng = np.random.default_rng(3)
    masking_limits = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
    ones = rng.binomial(4096, -np.expm1(-dark)).astype(np.int32)
    calibrations = [jl.calibrate(ones, frames=4096, max_dark=limit) for limit in masking_limits]
    print(f"\n{name} dark map; masked: ", end="")
    print(", ".join(f"{one.mask.mean():.1%}" for one in calibrations))
    columns = [f"limit {limit:g}" for limit in masking_limits]
    table("method", "photons at intensity 1", "frames", *columns)
    for frames, photons in ((16, 1.0), (16, 0.1), (256, 0.1)):
        camera = jl.Sensor(frames=frames, gain=frames * photons, dark_counts=dark)
        scenes = [(scene, camera.expose(scene, seed)) for seed, scene in enumerate(photographs())]
        for method in (
            "mle",
            "noniterative-gaussian",
            "noniterative-tv",
            "admm-tv",
            "network-two-layer",
        ):
            run = METHODS[method]
            if run.unsupported_reason(calibrations[0].sensor(frames, gain=camera.gain)) is not None:
                continue
            scores = []
            for one in calibrations:
                sensor = one.sensor(frames, gain=camera.gain)
                pairs = [(run.run(bits, sensor), scene) for scene, bits in scenes]
                scores.append(np.mean([jl.metrics.psnr(*pair) for pair in pairs]))
            row(method, photons, frames, *(f"{score:.2f}" for score in scores))


def clusters() -> None:
    rng = np.random.default_rng(4)
    methods = {
        "nearest": nearest,
        "mean of the border": lambda image, dead: border_value(image, dead, np.mean),
        "median of the border": lambda image, dead: border_value(image, dead, np.median),
        "membrane": inpaint_dead_pixels,
        "biharmonic": inpaint_biharmonic,
    }
    table("holes", "noise", *methods)
    for side in (1, 2, 3, 5, 7):
        for noise in (0, 0.05, 0.2):
            squares = dict.fromkeys(methods, 0.0)
            for scene in photographs():
                dead = holes(side, rng)
                image = scene + np.float32(noise) * rng.standard_normal(SHAPE, np.float32)
                image[dead] = 0
                for name, fill in methods.items():
                    squares[name] += np.mean((fill(image, dead) - scene)[dead] ** 2)
            errors = [np.sqrt(square / len(PHOTOGRAPHS)) for square in squares.values()]
            row(f"{side} × {side}", noise, *(f"{error:.4f}" for error in errors))


def holes(side: int, rng: np.random.Generator) -> np.ndarray:
    """Return squares that do not touch, one in each cell of 16 x 16 pixels."""
    dead = np.zeros(SHAPE, bool)
    for y in range(0, SHAPE[0], 16):
        for x in range(0, SHAPE[1], 16):
            top, left = y + rng.integers(1, 15 - side), x + rng.integers(1, 15 - side)
            dead[top : top + side, left : left + side] = True
    return dead


def nearest(image: np.ndarray, dead: np.ndarray) -> np.ndarray:
    indices = distance_transform_edt(dead, return_distances=False, return_indices=True)
    return image[tuple(indices)]


def border_value(image: np.ndarray, dead: np.ndarray, value) -> np.ndarray:
    """Fill each hole with one value of its border."""
    out = image.copy()
    numbers, count = label(dead)
    for number in range(1, count + 1):
        hole = numbers == number
        y, x = (slice(max(index.min() - 1, 0), index.max() + 2) for index in np.nonzero(hole))
        border = binary_dilation(hole[y, x], np.ones((3, 3))) & ~dead[y, x]
        out[hole] = value(image[y, x][border])
    return out


if __name__ == "__main__":
    main()
