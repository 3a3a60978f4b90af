"""What calibration promises and what was chosen in it, measured on maps whose truth is known.

    python benchmarks/studies/calibration.py [path/to/data] [--maps 30]

False positives: how many jots of clean dark maps are taken for hot ones, at a stated rate of 1e-4.
Outliers: the error of the response of ordinary jots and of outliers, by the limit beyond which a
response is left as it was counted. Hot jots: PSNR by the dark counts above which a hot jot is
masked. Clusters: the error of filled pixels, by how they are filled. With the data, hot jots are
those of a real dark map too.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt, label
from skimage.restoration import inpaint_biharmonic

import jotlight as jl
from jotlight.calibration.flat import shrink_response
from jotlight.calibration.rates import detections, variance
from jotlight.datasets.scenes import PHOTOGRAPHS
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.evaluation.methods import METHODS

SHAPE, RATE = (240, 320), 1e-4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--maps", type=int, default=30)
    options = parser.parse_args()
    # That hot jots cannot be told, and that pixels are filled.
    warnings.simplefilter("ignore", jl.JotlightWarning)
    false_positives(options.maps)
    outliers()
    maps = {"simulated": simulated(np.random.default_rng(2))}
    if options.data is not None:
        file = options.data / "real" / "spcimager" / "counts.npz"
        maps["real"] = detections(jl.open(file, key="bframee"), 4096, 1)
    for name, dark in maps.items():
        limits(name, dark)
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
    long = {
        ("all alike", 0.5): lambda: np.full(SHAPE, 0.5),
        ("all alike", 8): lambda: np.full(SHAPE, 8.0),
        ("gamma, shape 4", 8): lambda: rng.gamma(4, 2, SHAPE),
        ("gamma, shape 1", 8): lambda: rng.gamma(1, 8, SHAPE),
        ("gamma, shape 4", 400): lambda: rng.gamma(4, 100, SHAPE),
        ("log-normal, σ = ½", 5): lambda: 5 * np.exp(0.5 * rng.standard_normal(SHAPE) - 0.125),
    }
    kinds = [
        (kind, 4096, mean, lambda ones=ones: -np.expm1(-ones() / 4096))
        for (kind, mean), ones in long.items()
    ]
    kinds += [
        ("all alike", frames, f"{frames * chance:g}", lambda chance=chance: chance)
        for chance, frames in ((0.01, 1), (0.05, 2), (0.2, 4), (0.5, 8), (0.5, 16), (0.9, 16))
    ]
    table(
        "dark counts of the jots", "frames N", "ones in the mean", "N of N ones, told",
        "false positives, told", "false positives",
    )  # fmt: skip
    for kind, frames, mean, chance in kinds:
        found = []
        for _ in range(maps):
            ones = rng.binomial(frames, chance(), SHAPE).astype(np.int32)
            found.append(jl.calibrate(ones, frames=frames, false_positive_rate=RATE))
        row(
            kind, frames, mean, f"{np.mean([one.bulk.tail_probability(frames) for one in found]):.2g}",
            f"{1e4 * np.mean([one.hot_probability for one in found]):.2f} · 10⁻⁴",
            f"{1e4 * np.mean([one.hot.mean() for one in found]):.2f} · 10⁻⁴",
        )  # fmt: skip


def outliers() -> None:
    """At a PRNU of 5 % and a light of 0.4."""
    rng = np.random.default_rng(1)
    jots, light, few = 200_000, 0.4, 50
    beyond = (3.0, 4.0, 5.0, 6.0, np.inf)
    table("flat frames", "response", *(f"limit {limit:g} σ" for limit in beyond[:-1]), "none")
    for frames in (128, 512, 4096):
        noise = np.full(jots, variance(np.array([light]), frames, 1)[0] / light**2)
        for outlier in (1, 0.3, 0.5, 0.7, 1.5, 2, 3.5):
            truth = 1 + 0.05 * rng.standard_normal(jots)
            looked_at = slice(None)
            if outlier != 1:
                looked_at = slice(few)
                truth[looked_at] = outlier
            ones = rng.binomial(frames, -np.expm1(-light * truth)).astype(np.int32)
            seen = detections(ones, frames, 1) / light
            errors = [
                np.sqrt(np.mean((shrink_response(seen, noise, limit)[0] - truth)[looked_at] ** 2))
                for limit in beyond
            ]
            name = "1 ± 0.05" if outlier == 1 else outlier
            row(frames, name, *(f"{error:.3f}" for error in errors))


def simulated(rng: np.random.Generator) -> np.ndarray:
    """A gamma distribution, and for a fifth of the jots much more, by its logarithm uniform."""
    dark = rng.gamma(4, 0.0005, SHAPE)
    hot = rng.random(SHAPE) < 0.2
    dark[hot] = 10 ** rng.uniform(-2.5, 1, hot.sum())
    return dark


def limits(name: str, dark: np.ndarray) -> None:
    rng = np.random.default_rng(3)
    beyond = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
    ones = rng.binomial(4096, -np.expm1(-dark)).astype(np.int32)
    known = [jl.calibrate(ones, frames=4096, max_dark=limit) for limit in beyond]
    print(f"\n{name} dark map; masked: ", end="")
    print(", ".join(f"{one.mask.mean():.1%}" for one in known))
    table(
        "method", "photons at intensity 1", "frames", *(f"limit {limit:g}" for limit in beyond)
    )  # fmt: skip
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
            if run.unsupported_reason(known[0].sensor(frames, gain=camera.gain)) is not None:
                continue
            scores = []
            for one in known:
                sensor = one.sensor(frames, gain=camera.gain)
                pictures = [(run.run(seen, sensor), scene) for scene, seen in scenes]
                scores.append(np.mean([jl.metrics.psnr(*pair) for pair in pictures]))
            row(method, photons, frames, *(f"{score:.2f}" for score in scores))


def clusters() -> None:
    rng = np.random.default_rng(4)
    ways = {
        "nearest": nearest,
        "mean of the rim": lambda image, blind: of_rim(image, blind, np.mean),
        "median of the rim": lambda image, blind: of_rim(image, blind, np.median),
        "membrane": inpaint_dead_pixels,
        "biharmonic": inpaint_biharmonic,
    }
    table("holes", "noise", *ways)
    for side in (1, 2, 3, 5, 7):
        for noise in (0, 0.05, 0.2):
            squares = dict.fromkeys(ways, 0.0)
            for scene in photographs():
                blind = holes(side, rng)
                seen = scene + np.float32(noise) * rng.standard_normal(SHAPE, np.float32)
                seen[blind] = 0
                for name, way in ways.items():
                    squares[name] += np.mean((way(seen, blind) - scene)[blind] ** 2)
            errors = [np.sqrt(square / len(PHOTOGRAPHS)) for square in squares.values()]
            row(f"{side} × {side}", noise, *(f"{error:.4f}" for error in errors))


def holes(side: int, rng: np.random.Generator) -> np.ndarray:
    """Squares that do not touch, one in each cell of 16 x 16 pixels."""
    blind = np.zeros(SHAPE, bool)
    for y in range(0, SHAPE[0], 16):
        for x in range(0, SHAPE[1], 16):
            top, left = y + rng.integers(1, 15 - side), x + rng.integers(1, 15 - side)
            blind[top : top + side, left : left + side] = True
    return blind


def nearest(image: np.ndarray, blind: np.ndarray) -> np.ndarray:
    places = distance_transform_edt(blind, return_distances=False, return_indices=True)
    return image[tuple(places)]


def of_rim(image: np.ndarray, blind: np.ndarray, value) -> np.ndarray:
    """One value for all of a hole."""
    out = image.copy()
    numbers, count = label(blind)
    for number in range(1, count + 1):
        hole = numbers == number
        y, x = (slice(max(place.min() - 1, 0), place.max() + 2) for place in np.nonzero(hole))
        rim = binary_dilation(hole[y, x], np.ones((3, 3))) & ~blind[y, x]
        out[hole] = value(image[y, x][rim])
    return out


if __name__ == "__main__":
    main()
