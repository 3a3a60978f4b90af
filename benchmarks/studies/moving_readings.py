"""Compare images of moving scenes from readings of several bits, with and without their motion.

    python benchmarks/studies/moving_readings.py [--frames 64]

The scenes are two photographs that come with scikit-image, at 192 x 192 pixels. The table shows the
mean PSNR in dB, without a border of 8 pixels, by the network "medium": of all frames without
alignment, along the motion that `jotlight.align` finds, and of the same photographs standing still.
*bias* is the relative error of the mean intensity of the merged images. *photons* is the mean
number of photons per jot and frame, and *largest* the share of the readings that are the largest
ones.
"""

import argparse

import numpy as np
from borders import psnr_inside

import jotlight as jl

PHOTOGRAPHS = "camera", "coffee"
SIZE = 192, 192
KINDS = [
    # bits, photons per jot and frame at intensity 1, read noise
    (2, 1.0, 0.0),
    (2, 4.0, 0.0),
    (4, 0.5, 0.3),
    (4, 4.0, 0.3),
    (8, 10.0, 0.2),
    (12, 100.0, 0.3),
]


def main() -> None:
    """Print a row for each kind of readings and motion."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=64)
    frames = parser.parse_args().frames
    columns = "largest | scene | all frames | merged | bias | still"
    print(f"| bit depth | read noise | photons | {columns} |")
    print("| ---: | ---: | ---: | ---: | --- | ---: | ---: | ---: | ---: |")
    for bits, photons, noise in KINDS:
        sensor = jl.Sensor(frames=frames, gain=photons * frames, bit_depth=bits, read_noise=noise)
        for motion in ("shake", "layers"):
            rows = np.mean([measure(sensor, motion, name) for name in PHOTOGRAPHS], axis=0)
            light, largest, whole, merged, bias, still = rows
            print(
                f"| {bits} | {noise:g} | {light:.2f} | {largest:.1%} | {motion} | {whole:.2f} | "
                f"{merged:.2f} | {bias:+.1%} | {still:.2f} |",
                flush=True,
            )


def measure(sensor: jl.Sensor, motion: str, name: str) -> list[float]:
    """Return the numbers of a row for one photograph."""
    image = jl.datasets.photograph(name, gray=True).astype(float)
    scene, still = (
        jl.datasets.moving(image, kind, sensor=sensor, shape=SIZE, rng=0)
        for kind in (motion, "static")
    )
    truth = scene.image()
    readings = jl.Readings(scene.bits.to_array(), sensor)
    estimate = jl.reconstruct(jl.merge(readings), method="network-medium")
    return [
        float(truth.mean()) * sensor.light_per_intensity,
        float((readings.to_array() == sensor.max_reading).mean()),
        psnr_inside(jl.reconstruct(readings, method="network-medium"), truth),
        psnr_inside(estimate, truth),
        float(estimate.mean() / truth.mean()) - 1,
        psnr_inside(jl.reconstruct(still.bits, method="network-medium"), still.image()),
    ]


if __name__ == "__main__":
    main()
