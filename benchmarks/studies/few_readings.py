"""Compare images from a few readings that differ, and from maps of thresholds.

    python benchmarks/studies/few_readings.py

The first table is for parts of three photographs that come with scikit-image, 256 x 256 pixels. It
states the mean PSNR of networks that get the counts of `jotlight.merge_readings`, of the default
method, which gets counts near an estimate, and of total variation. *bias* is the mean relative
error of the mean intensity. *single* is the default method for bits with one gain, and with as much
light in as many frames.

The second table is for "camera" at half size, 16 frames, and a checkerboard of thresholds 1 and q,
with q photons per jot and frame at intensity 1. It shows the default method without and with the
average over neighbors.
"""

from unittest.mock import patch

import numpy as np

import jotlight as jl
from jotlight.evaluation import different_readings

SENSORS = {
    "gains 1, 2, 3, 4": jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0]),
    "gains 4, 4, 4, 1": jl.Sensor(frames=4, gain=[4.0, 4.0, 4.0, 1.0]),
    "gains 1/2, 2, 8": jl.Sensor(frames=3, gain=[0.5, 2.0, 8.0]),
    "gains 8, 1, 1/8, 4 frames each": jl.Sensor(frames=12, gain=np.repeat([8, 1, 1 / 8], 4)),
    "gains 8, 1, 1/8, 16 frames each": jl.Sensor(frames=48, gain=np.repeat([8, 1, 1 / 8], 16)),
    "thresholds 1, 2": jl.Sensor(frames=2, gain=4.0, threshold=[1, 2]),
    "thresholds 1, 1, 1, 5": jl.Sensor(frames=4, gain=8.0, threshold=[1, 1, 1, 5]),
    "one reading of 2 bits, 2 photons": jl.Sensor(bit_depth=2, gain=2.0),
    "one reading of 2 bits, 6 photons": jl.Sensor(bit_depth=2, gain=6.0),
    "4 readings of 2 bits, read noise 0.3": jl.Sensor(
        frames=4, gain=4.0, bit_depth=2, read_noise=0.3
    ),
    "16 readings of 3 bits, read noise 0.3": jl.Sensor(
        frames=16, gain=16.0, bit_depth=3, read_noise=0.3
    ),
}
PHOTOGRAPHS = "camera", "astronaut", "coins"


def main() -> None:
    """Print both tables."""
    images = [
        jl.datasets.photograph(name, gray=True)[40:296, 100:356].astype(float)
        for name in PHOTOGRAPHS
    ]
    print("| sensor | merge_readings, dB | bias | default, dB | bias | admm-tv, dB | single, dB |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for name, sensor in SENSORS.items():
        rows = [measure(sensor, image) for image in images]
        dB = np.mean([quality for quality, _ in rows], axis=0)
        bias = np.mean([ratio for _, ratio in rows], axis=0)
        single = f"{dB[3]:.2f}" if len(dB) > 3 else ""
        print(
            f"| {name} | {dB[0]:.2f} | {bias[0]:+.1%} | {dB[1]:.2f} | {bias[1]:+.1%} | "
            f"{dB[2]:.2f} | {single} |",
            flush=True,
        )
    print("\n| q | network-medium, no average, dB | network-medium, dB | admm-tv, dB |")
    print("| --- | --- | --- | --- |")
    camera = jl.datasets.photograph("camera")[::2, ::2].astype(float)
    for q in (2, 4, 8):
        print(f"| {q} | {' | '.join(f'{psnr:.2f}' for psnr in checkerboard(camera, q))} |")


def measure(sensor: jl.Sensor, image: np.ndarray) -> tuple[list[float], list[float]]:
    """Return the PSNR of each column, and the relative errors of the mean intensity."""
    readings = sensor.expose(image, rng=0)
    network = jl.pretrained(sensor, "medium")
    estimates = [
        network.reconstruct(jl.merge_readings(readings)),
        jl.reconstruct(readings),
        jl.reconstruct(readings, method="admm-tv"),
    ]
    if np.ndim(sensor.gain) == 1 and sensor.bit_depth == 1:
        one_gain = sensor.replace(gain=float(np.sum(sensor.gain)))
        estimates.append(jl.reconstruct(one_gain.expose(image, rng=0)))
    ratios = [float(estimate.mean() / image.mean()) - 1 for estimate in estimates]
    return [jl.metrics.psnr(estimate, image) for estimate in estimates], ratios


def checkerboard(image: np.ndarray, q: int) -> list[float]:
    """Return the PSNR without and with the average over neighbors, and of total variation."""
    board = np.where(np.indices(image.shape).sum(axis=0) % 2, 1, q)
    bits = jl.Sensor(frames=16, gain=16.0 * q, threshold=board).expose(image, rng=0)
    with patch.object(different_readings, "_SIGMA", 0.0):
        alone = jl.reconstruct(bits)
    others = jl.reconstruct(bits), jl.reconstruct(bits, method="admm-tv")
    return [jl.metrics.psnr(estimate, image) for estimate in (alone, *others)]


if __name__ == "__main__":
    main()
