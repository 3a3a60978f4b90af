"""Measure intervals beside a bright object on a dark sky, and how wrong estimates are flagged.

    python benchmarks/studies/bright_objects.py [--draws 4]

The scene is a disk with a radius of 25 of 128 x 128 pixels and 0.5 photons per frame, on a sky. The
table shows how many percent of the intervals of 90 % contain the true intensity, and how many
percent of the pixels are flagged as unlikely, at distances of 0 to 3, 3 to 7, and 7 to 15 pixels
from the disk, beyond 20, and in the disk itself. The method is "medium".
"""

import argparse

import numpy as np

import jotlight as jl

SIDE, RADIUS = 128, 25
CASES = (64, 5e-3), (256, 2e-3), (1000, 2e-2), (1000, 2e-3), (1000, 5e-4), (10_000, 5e-4)
"""Numbers of frames, and photons of the sky per frame."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=4)
    draws = parser.parse_args().draws
    distance = np.hypot(*(np.indices((SIDE, SIDE)) - SIDE / 2)) - RADIUS
    bounds = (0, 3), (3, 7), (7, 15), (20, np.inf), (-np.inf, 0)
    parts = [(low < distance) & (distance < high) for low, high in bounds]
    names = "0 to 3", "3 to 7", "7 to 15", "beyond 20", "disk"
    header = " | ".join(f"{name}: coverage | unlikely" for name in names)
    print(f"| K | sky, photons per frame | {header} |")
    print(f"| ---: | ---: | {' | '.join(2 * len(names) * ['---:'])} |")
    for frames, sky in CASES:
        truth = np.where(distance < 0, 0.5, 0) + sky
        sensor = jl.Sensor(frames=frames, gain=float(frames), max_intensity=10.0)
        inside, unlikely = np.zeros((2, SIDE, SIDE))
        for rng in range(draws):
            counts = sensor.expose(truth, rng=rng).counts()
            known = jl.uncertainty(counts, sensor, quality="medium", confidence_level=0.9)
            inside += (known.low <= truth) & (truth <= known.high)
            unlikely += known.unlikely
        shares = [values[part].mean() / draws for part in parts for values in (inside, unlikely)]
        print(
            f"| {frames:,} | {sky:g} | {' | '.join(f'{100 * x:.0f}' for x in shares)} |", flush=True
        )


if __name__ == "__main__":
    main()
