"""Measure what `jl.calibrate` concludes from simulated flat captures with known truth.

    python benchmarks/studies/flats.py [--maps 10]

PRNU: its mean, its stated error, and how often twice this error covers the truth. Dead jots: the
share of jots called dead. Light: the structure of photographs and of the falloff of optics and
lamps. Mosaics: how often one that is not stated is reported, by the number of jots.
"""

import argparse
import itertools
import warnings

import numpy as np
from scipy.ndimage import uniform_filter

import jotlight as jl
from jotlight.calibration.evenness import light_structure
from jotlight.calibration.light import WINDOW
from jotlight.datasets.scenes import PHOTOGRAPHS
from jotlight.sensing.parameters.mosaic import Mosaic

SHAPE = (128, 128)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--maps", type=int, default=10)
    options = parser.parse_args()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jl.JotlightWarning)
        prnu(options.maps)
        dead_jots(options.maps)
        structure()
    mosaics(options.maps)


def row(*cells: object) -> None:
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def table(*columns: str) -> None:
    print()
    row(*columns)
    row(*["---:"] * len(columns))


def draw(rng, frames: int, rates: np.ndarray) -> np.ndarray:
    return rng.binomial(frames, -np.expm1(-rates))


def prnu(maps: int) -> None:
    table("flat frames", "ones", "PRNU", "mean found", "mean error", "covered by 2 errors")
    captures = ((200, 0.05), (200, 0.5), (200, 0.95), (200, 0.99), (4000, 0.5), (4000, 0.95))
    for (frames, ones), spread in itertools.product(captures, (0, 0.01, 0.03, 0.1)):
        found = []
        for seed in range(maps):
            rng = np.random.default_rng(seed)
            light = -np.log1p(-ones) * (1 + spread * rng.standard_normal(SHAPE))
            dark = np.full(SHAPE, 0.002)
            counts = draw(rng, 4000, dark), draw(rng, frames, dark + np.maximum(light, 0))
            one = jl.calibrate(*counts, frames=4000, flat_frames=frames)
            found.append((one.prnu, one.prnu_error))
        values, errors = np.array(found).T
        covered = np.mean(abs(values - spread) <= 2 * errors)
        row(
            frames, f"{ones:.0%}", f"{spread:.0%}", f"{values.mean():.2%}",
            f"{errors.mean():.2%}", f"{covered:.0%}",
        )  # fmt: skip


def dead_jots(maps: int) -> None:
    table(
        "dark frames", "dark counts", "light", "dead, response 1", "response 0.2", "response 0",
        "response and dark counts 0",
    )  # fmt: skip
    rng = np.random.default_rng(1)
    captures = itertools.product(((4, 0.1), (50, 0.1), (50, 0.5), (4000, 0.1)), (0.1, 0.7, 3.0))
    for (dark_frames, counts), light in captures:
        kinds = rng.permutation(SHAPE[0] * SHAPE[1]).reshape(SHAPE)
        groups = [kinds >= 2000, kinds < 1600, (kinds >= 1600) & (kinds < 1800)]
        groups.append((kinds >= 1800) & (kinds < 2000))
        response = np.select(groups, (1, 0.2, 0, 0), 0.0)
        dark = np.where(groups[3], 0.0, counts)
        dead = np.zeros(SHAPE)
        for _ in range(maps):
            ones = draw(rng, dark_frames, dark), draw(rng, 1000, dark + light * response)
            dead += jl.calibrate(*ones, frames=dark_frames, flat_frames=1000).dead
        shares = [f"{dead[group].sum() / group.sum() / maps:.2g}" for group in groups]
        row(dark_frames, counts, light, *shares)


def structure() -> None:
    y, x = np.mgrid[-1:1:240j, -1:1:320j]
    lights = {
        "cosine⁴, corners at 50 %": (1 + 0.207 * (x**2 + y**2)) ** -2,
        "cosine⁴, corners at 20 %": (1 + 0.618 * (x**2 + y**2)) ** -2,
        "cosine⁴, off center": (1 + 0.6 * ((x - 0.5) ** 2 + (y - 0.3) ** 2)) ** -2,
        "slope of 10 : 1": 1 + 0.82 * x,
        "lamp beside the sensor": 1 / ((x - 1.5) ** 2 + y**2 + 0.5),
        "Gaussian beam, corners at 2 %": np.exp(-1.95 * (x**2 + y**2)),
        "halves that differ by 10 %": 1 + 0.1 * (x > 0),
        "circle of a lens too small": np.clip((1 - np.hypot(x, y)) / 0.1, 0.02, 1),
    }
    photographs = {name: jl.datasets.photograph(name, gray=True) for name in PHOTOGRAPHS}
    table("light", "structure")
    for name, light in (lights | photographs).items():
        smooth = uniform_filter(np.asarray(light, float), WINDOW, mode="reflect")
        row(name, f"{light_structure(smooth, 0 * smooth):.1%}")


def mosaics(maps: int) -> None:
    """Count reports for filters that pass 0.8, 0.4, and 0.2, and for a gray sensor."""
    table("jots", "frames", "Bayer", "quad Bayer", "gray, columns differ by 5 %")
    for side, frames in itertools.product((8, 12, 16, 24, 32, 64), (16, 400)):
        found = []
        for block in (1, 2, 0):
            reports = 0
            for seed in range(maps):
                rng = np.random.default_rng(seed)
                light = 0.7 * (1 + 0.03 * rng.standard_normal((side, side)))
                if block:
                    places = Mosaic("RGGB").full(side, side).repeat(block, 0).repeat(block, 1)
                    light *= np.array([0.8, 0.4, 0.2])[places[:side, :side]]
                else:
                    light *= 1 + 0.05 * rng.standard_normal(side)
                ones = draw(rng, 1000, np.full(light.shape, 0.01)), draw(rng, frames, light + 0.01)
                with warnings.catch_warnings(record=True) as issued:
                    warnings.simplefilter("always")
                    jl.calibrate(*ones, frames=1000, flat_frames=frames)
                reports += any(one.category is jl.PeriodicRatesWarning for one in issued)
            found.append(f"{reports} of {maps}")
        row(f"{side} × {side}", frames, *found)


if __name__ == "__main__":
    main()
