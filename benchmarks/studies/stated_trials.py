"""Measure how sensitive medium is to an error of the stated number of trials.

    python benchmarks/studies/stated_trials.py IMAGES [--number 8]

IMAGES is a folder of test images, of which the first ones in the order of their names are used.
The first table shows the PSNR of medium in dB if K is stated too small or too large. The second one
shows the mean of the images at two levels of K around the right one, with the ratio √2, for several
weights of the upper level: *place* is that of the right K between the levels, by logarithm. The
third one is for readings of 2 bits with a read noise of 0.3: how much larger the variance of the
fraction of ones of their equivalent counts is than for independent bits.
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.images.sets import read_image_set
from jotlight.networks.inference.trials_map import denoise_fractions

EXPOSURES = (17, 0.25), (34, 0.25), (64, 1.0), (180, 0.2)
"""Trials, and photons per jot and frame at intensity 1."""

FACTORS = 0.7, 0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2
PLACES = 0.25, 0.5, 0.75
WEIGHTS = 0.0, 0.25, 0.5, 0.75, 1.0
LEVELS = 0.1, 0.25, 0.5, 1.0
"""Intensities of the third table."""

Image = npt.NDArray[np.float32]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("--number", type=int, default=8)
    options = parser.parse_args()
    images = [each.astype(float) for each in read_image_set(options.images)[1][: options.number]]
    seen = [Seen(images, *exposure) for exposure in EXPOSURES]
    print("| K | photons |", *(f"{factor:g} K |" for factor in FACTORS))
    print("|" + " ---: |" * (2 + len(FACTORS)))
    for each in seen:
        row = [each.quality(each.estimate(factor * each.trials)) for factor in FACTORS]
        print(f"| {each.trials} | {each.light:g} |", *(f"{x:.2f} |" for x in row), flush=True)
    print("\n| K | photons | place |", *(f"{weight:g} |" for weight in WEIGHTS))
    print("|" + " ---: |" * (3 + len(WEIGHTS)))
    for each in seen:
        for place in PLACES:
            low, high = (each.estimate(each.trials * 2 ** (x / 2)) for x in (-place, 1 - place))
            mixed = [(1 - weight) * low + weight * high for weight in WEIGHTS]
            cells = " ".join(f"{each.quality(mean):.2f} |" for mean in mixed)
            print(f"| {each.trials} | {each.light:g} | {place} | {cells}", flush=True)
    print("\n| readings |", *(f"{level:g} |" for level in LEVELS))
    print("|" + " ---: |" * (1 + len(LEVELS)))
    for readings in (4, 16, 64):
        print(f"| {readings} |", *(f"{excess(readings, level):.2f} |" for level in LEVELS))


class Seen:
    """Images at one exposure."""

    def __init__(self, images: list[Image], trials: int, light: float) -> None:
        self.images, self.trials, self.light = images, trials, light
        sensor = jl.Sensor(frames=trials, gain=light * trials)
        self.network = jl.pretrained(sensor)
        counts = [sensor.expose(image, rng=seed).counts() for seed, image in enumerate(images)]
        self.fractions = [(each / trials).astype(np.float32) for each in counts]

    def estimate(self, trials: float) -> npt.NDArray[np.object_]:
        """Return P(b = 1) of all images for a stated number of trials."""
        level = int(np.clip(round(trials), *self.network.trials_range))
        found = np.empty(len(self.fractions), object)
        for index, each in enumerate(self.fractions):
            found[index] = denoise_fractions(self.network, each[None], [level])[0]
        return found

    def quality(self, estimates: npt.NDArray[np.object_]) -> float:
        """Return the mean PSNR in dB."""
        values = []
        for probability, image in zip(estimates, self.images, strict=True):
            intensity = -np.log1p(-np.minimum(probability, 1 - 1e-6)) / self.light
            values.append(jl.metrics.psnr(np.clip(intensity, 0, 1), image, data_range=1.0))
        return float(np.mean(values))


def excess(readings: int, level: float) -> float:
    """Return the variance of the fractions of ones, relative to that of independent bits."""
    sensor = jl.Sensor(frames=readings, bit_depth=2, read_noise=0.3)
    merged = jl.merge_readings(sensor.expose(np.full((400, 400), level), rng=0))
    rate = merged.sensor.light_per_intensity * level + float(np.mean(merged.dark_counts))
    one = -np.expm1(-rate)
    return float(
        (merged.ones / merged.trials).var() / (one * (1 - one) * (1 / merged.trials).mean())
    )


if __name__ == "__main__":
    main()
