"""Accuracy on real counts: from 16 frames, against 48 further frames of the same scene.

    python benchmarks/real_counts.py path/to/data

The folder holds ``real/swissspad2_bird/counts.npz``.
"""

import argparse
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.methods import METHODS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    path = parser.parse_args().data / "real/swissspad2_bird/counts.npz"
    with np.load(path, allow_pickle=False) as counts:
        few, further = counts["k16"], counts["k64"].astype(int) - counts["k16"]
    sensor = jl.Sensor(frames=16, max_intensity=4.0)
    independent = further >= 0

    def decibel(estimate: np.ndarray) -> float:
        error = -np.expm1(-estimate) - further / 48
        return -10 * np.log10(np.mean(error[independent] ** 2))

    print("| method on 16 real frames | exact inverse, dB | algebraic, dB |")
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
