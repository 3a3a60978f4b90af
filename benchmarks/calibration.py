"""How many ordinary jots are taken for hot ones: clean dark maps, without any hot jot.

    python benchmarks/calibration.py [--maps 30]

The stated rate is 1e-4. Each kind of map has jots with other rates; the last one has a heavier tail
than the bulk is assumed to have.
"""

import argparse

import numpy as np

import jotlight as jl

SHAPE, FRAMES, RATE = (240, 320), 4096, 1e-4


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--maps", type=int, default=30)
    maps = parser.parse_args().maps
    rng = np.random.default_rng(0)
    kinds = {
        ("all alike", 0.5): lambda: np.full(SHAPE, 0.5),
        ("all alike", 8): lambda: np.full(SHAPE, 8.0),
        ("gamma, shape 4", 8): lambda: rng.gamma(4, 2, SHAPE),
        ("gamma, shape 1", 8): lambda: rng.gamma(1, 8, SHAPE),
        ("gamma, shape 4", 400): lambda: rng.gamma(4, 100, SHAPE),
        ("log-normal, σ = ½", 5): lambda: 5 * np.exp(0.5 * rng.standard_normal(SHAPE) - 0.125),
    }
    print("| dark counts of the jots | ones in the mean | false positives |")
    print("| --- | ---: | ---: |")
    for (kind, mean), ones in kinds.items():
        hot = 0
        for _ in range(maps):
            counts = rng.binomial(FRAMES, -np.expm1(-ones() / FRAMES)).astype(np.int32)
            calibration = jl.calibrate(counts, frames=FRAMES, false_positive_rate=RATE)
            hot += int(calibration.hot.sum())
        share = hot / (maps * SHAPE[0] * SHAPE[1])
        print(f"| {kind} | {mean} | {1e4 * share:.2f} · 10⁻⁴ |", flush=True)


if __name__ == "__main__":
    main()
