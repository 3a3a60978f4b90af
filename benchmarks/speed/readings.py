"""Compare the time of images from readings that differ, and of several bits, with that of bits.

    python benchmarks/speed/readings.py [--rounds 3]

The image has 512 x 512 pixels, and 16 frames. The table shows the processor time of one thread for
the network "medium", in the best of several rounds, and its ratio to that for bits of alike jots.
"""

import argparse
import time

import numpy as np

import jotlight as jl

FRAMES, SIDE = 16, 512
SENSORS = {
    "bits": {},
    "efficiency from 0.3 to 1": {
        "efficiency": np.random.default_rng(0).uniform(0.3, 1, (SIDE, SIDE)),
    },
    "checkerboard of the thresholds 1, 3": {
        "threshold": np.where(np.indices((SIDE, SIDE)).sum(0) % 2, 1, 3),
    },
    "bracket 1 : 4": {"gain": np.tile([0.5, 2.0], FRAMES // 2)},
    "bits, read noise 0.3": {"read_noise": 0.3},
    "2 bits": {"bit_depth": 2},
    "4 bits, 4 photons": {"bit_depth": 4, "gain": 4.0 * FRAMES},
    "8 bits, 60 photons": {"bit_depth": 8, "gain": 60.0 * FRAMES},
    "8 bits, 60 photons, read noise 0.3": {
        "bit_depth": 8,
        "gain": 60.0 * FRAMES,
        "read_noise": 0.3,
    },
    "12 bits, 500 photons": {"bit_depth": 12, "gain": 500.0 * FRAMES},
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    image = jl.datasets.photograph("camera")
    of_bits = None
    print("| readings | s | ratio |\n| --- | ---: | ---: |")
    for name, options in SENSORS.items():
        data = jl.Sensor(frames=FRAMES, **options).expose(image, rng=0)
        seconds = min(time_of(data) for _ in range(rounds + 1))
        of_bits = of_bits or seconds
        print(f"| {name} | {seconds:.3f} | {seconds / of_bits:.1f} |", flush=True)


def time_of(data: jl.Bits | jl.Readings) -> float:
    """Return the processor time in seconds of one estimate."""
    start = time.process_time()
    jl.reconstruct(data, quality="medium", threads=1)
    return time.process_time() - start


if __name__ == "__main__":
    main()
