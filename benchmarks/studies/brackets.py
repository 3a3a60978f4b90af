"""Measure the range of light of a bracket of exposures, its intervals, and its images.

    python benchmarks/studies/brackets.py IMAGES [--number 10] [--frames 48]

The bracket has exposures of 1 : 8 : 64 in equal numbers of frames. The first table compares it with
the same number of frames of the longest exposure: the range in which the SNR is 9 dB or more, by
the Cramér-Rao bound and by the exact error of maximum likelihood, which is a sum over all outcomes.
The range is that between the first and the last such intensity, *without a dip* is the widest range
in which the SNR stays at 9 dB or more, and *dip* is the lowest SNR between the first and the last.
*coverage* is the lowest exact coverage of the interval of 95 % in that range.

The second table is for IMAGES, a folder, whose first images in the order of their names get
intensities that rise by a factor of 1,000 from left to right. It compares estimates from the
bracket and from equal exposures with the same total light, by the root mean square of the error of
log intensity in each quarter of the width, and states the coverage of intervals of 95 %.
"""

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import stats

import jotlight as jl
from jotlight.estimators.planning.bracketing import intensity_range
from jotlight.estimators.readings.joint_mle import maximize
from jotlight.images.sets import read_image_set
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.likelihood.reference import saturation_intensity

Array = npt.NDArray[np.float64]

SNR = 9.0
RATIO = 1000.0
FLOOR = 0.02
"""Smallest intensity of a photograph, as a fraction of white."""


def main() -> None:
    """Measure, and print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("--number", type=int, default=10)
    parser.add_argument("--frames", type=int, default=48)
    options = parser.parse_args()
    each = options.frames // 3
    bracket = jl.Sensor(frames=3 * each, gain=np.repeat([1.0, 1 / 8, 1 / 64], each))
    print("| frames | bound, dB | estimate, dB | without a dip, dB | dip, dB | coverage |")
    print("| --- | --- | --- | --- | --- | --- |")
    print_range("longest only", jl.Sensor(frames=3 * each), [(1.0, 3 * each)])
    print_range("1 : 8 : 64", bracket, [(1.0, each), (1 / 8, each), (1 / 64, each)])
    images = read_image_set(options.images)[1][: options.number]
    gain = bracket.gain * 64 / RATIO**0.5
    print_images(images, bracket.replace(gain=gain, max_intensity=2 * RATIO**0.5))


def print_range(name: str, sensor: jl.Sensor, exposures: list[tuple[float, int]]) -> None:
    """Print the range of light of a sensor, whose exposures have numbers of frames."""
    sensor = sensor.replace(max_intensity=saturation_intensity(sensor))
    low, high = intensity_range(sensor, SNR)
    estimates, intervals, outcomes = all_outcomes(sensor, [number for _, number in exposures])
    levels = np.geomspace(low / 10, 10 * high, 600)
    snr, coverage = [], []
    for level in levels:
        weights = np.ones(len(estimates))
        for counts, (exposure, number) in zip(outcomes, exposures, strict=True):
            weights *= stats.binom.pmf(counts, number, -np.expm1(-exposure * level))
        snr.append(10 * np.log10(level**2 / (weights @ (estimates - level) ** 2)))
        coverage.append(weights @ ((intervals[0] <= level) & (level <= intervals[1])))
    is_good = np.array(snr) >= SNR
    first, last = np.flatnonzero(is_good)[[0, -1]]
    inside = slice(first, last + 1)
    runs = np.split(levels, np.flatnonzero(np.diff(is_good)) + 1)[not is_good[0] :: 2]
    row = (
        20 * np.log10(high / low),
        20 * np.log10(levels[inside][-1] / levels[inside][0]),
        20 * np.log10(max(run[-1] / run[0] for run in runs)),
        min(snr[inside]),
    )
    print(f"| {name} | {' | '.join(f'{x:.1f}' for x in row)} | {min(coverage[inside]):.1%} |")


def all_outcomes(sensor: jl.Sensor, numbers: list[int]) -> tuple[Array, list[Array], Array]:
    """Return the estimates and the intervals of all combinations of counts, and these."""
    outcomes = np.indices([number + 1 for number in numbers]).reshape(len(numbers), -1)
    pairs = zip(numbers, outcomes, strict=True)
    ones = np.concatenate([np.arange(number)[:, None] < counts for number, counts in pairs])
    bits = jl.Bits.from_array(ones[:, None], sensor).replace(tested_for_periods=True)
    # The interval contains intensities up to S only.
    interval = jl.uncertainty(bits, sensor.replace(max_intensity=1e6), method="mle")
    estimates = maximize(joint_likelihood(bits, sensor, None))[0]
    return estimates, [interval.low[0], interval.high[0]], outcomes


def print_images(images: list[Array], bracket: jl.Sensor) -> None:
    """Print the errors of the estimates of photographs whose light rises from left to right."""
    equal = bracket.replace(gain=float(np.sum(bracket.gain)))
    errors: dict[str, list[Array]] = {}
    covered: dict[str, list[float]] = {}
    for index, image in enumerate(images):
        rise = np.geomspace(RATIO**-0.5, RATIO**0.5, image.shape[1])
        truth = np.maximum(image.astype(np.float64), FLOOR) * rise
        for name, sensor in (("1 : 8 : 64", bracket), ("equal", equal)):
            bits = sensor.expose(truth, rng=index)
            for method in ("mle", "network-medium"):
                estimate = np.maximum(jl.reconstruct(bits, method=method), FLOOR * rise[0])
                squared = np.log(estimate / truth) ** 2
                quarters = [part.mean() for part in np.array_split(squared, 4, axis=1)]
                errors.setdefault(f"{name}, {method}", []).append(np.array(quarters))
                known = jl.uncertainty(bits, method=method)
                inside = (known.low <= truth) & (truth <= known.high)
                covered.setdefault(f"{name}, {method}", []).append(float(inside.mean()))
    print(
        "\n| frames, method | dark | | | bright | coverage |\n| --- | --- | --- | --- | --- | --- |"
    )
    for name, values in errors.items():
        row = " | ".join(f"{value:.2f}" for value in np.sqrt(np.mean(values, axis=0)))
        print(f"| {name} | {row} | {np.mean(covered[name]):.1%} |")


if __name__ == "__main__":
    main()
