"""Compare images from a few readings that differ, and from maps of thresholds.

    python benchmarks/studies/few_readings.py

The first table is for parts of three photographs that come with scikit-image, 256 x 256 pixels. It
states the mean PSNR of networks that get the counts of `jotlight.merge_readings`, and of the
default method, which gets counts near an estimate; then the same for `noniterative-tv`; and that of
`admm-tv`. *bias* is the mean relative error of the mean intensity. *single* is the default method
for bits with one gain, and with as much light in as many frames.

The second table is for the same sensors with a Bayer mosaic and two color photographs: planes by
the network "medium" with color differences, the default method, which is the color network, and
*single*.

The last table is for "camera" at half size, 16 frames, and a checkerboard of thresholds 1 and q,
with q photons per jot and frame at intensity 1. It shows the default method without and with the
average over neighbors.
"""

from unittest.mock import patch

import numpy as np

import jotlight as jl
from jotlight.estimators.readings import merge_near

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
COLORS = "astronaut", "coffee"
PART = slice(40, 296), slice(100, 356)


def main() -> None:
    """Print the three tables."""
    images = [jl.datasets.photograph(name, gray=True)[PART].astype(float) for name in PHOTOGRAPHS]
    methods = "merge_readings", "default", "merge_readings, noniterative-tv", "noniterative-tv"
    print(f"| sensor | {' | its bias | '.join(methods)} | its bias | admm-tv | single |")
    print(f"| --- |{' ---: |' * 10}")
    for name, sensor in SENSORS.items():
        rows = [measure(sensor, image) for image in images]
        print(f"| {name} | {cells(rows, biases=4)} |", flush=True)
    print("\n| sensor, RGGB | differences | bias | default | bias | single |")
    print(f"| --- |{' ---: |' * 5}")
    images = [jl.datasets.photograph(name)[PART].astype(float) for name in COLORS]
    for name, sensor in SENSORS.items():
        rows = [measure_colors(sensor.replace(mosaic="RGGB"), image) for image in images]
        print(f"| {name} | {cells(rows, biases=2)} |", flush=True)
    print("\n| q | network-medium, no average | network-medium | noniterative-tv | admm-tv |")
    print("| --- | ---: | ---: | ---: | ---: |")
    camera = jl.datasets.photograph("camera")[::2, ::2].astype(float)
    for q in (2, 4, 8):
        print(f"| {q} | {' | '.join(f'{psnr:.2f}' for psnr in checkerboard(camera, q))} |")


Row = list[tuple[float, float]]
"""PSNR and relative error of the mean intensity of each estimate."""


def measure(sensor: jl.Sensor, image: np.ndarray) -> Row:
    """Return the row of a gray image."""
    readings = sensor.expose(image, rng=0)
    network = jl.pretrained(sensor, "medium")
    merged = jl.merge_readings(readings)
    estimates = [
        network.reconstruct(merged),
        jl.reconstruct(readings),
        jl.reconstruct(merged, method="noniterative-tv"),
        jl.reconstruct(readings, method="noniterative-tv"),
        jl.reconstruct(readings, method="admm-tv"),
        *single(sensor, image),
    ]
    return [errors(estimate, image) for estimate in estimates]


def measure_colors(sensor: jl.Sensor, image: np.ndarray) -> Row:
    """Return the row of a color image."""
    readings = sensor.expose(image, rng=0, channel_axis=-1)
    planes = jl.reconstruct(readings, method="network-medium", demosaicing="differences")
    estimates = [planes, jl.reconstruct(readings), *single(sensor, image)]
    return [errors(estimate, image) for estimate in estimates]


def single(sensor: jl.Sensor, image: np.ndarray) -> list[np.ndarray]:
    """Return the default estimate from bits with one gain and as much light, if gains differ."""
    if np.ndim(sensor.gain) == 0 or sensor.bit_depth > 1:
        return []
    one_gain = sensor.replace(gain=float(np.sum(sensor.gain)))
    channel_axis = -1 if image.ndim == 3 else None
    return [jl.reconstruct(one_gain.expose(image, rng=0, channel_axis=channel_axis))]


def errors(estimate: np.ndarray, image: np.ndarray) -> tuple[float, float]:
    """Return the PSNR, and the relative error of the mean intensity."""
    return jl.metrics.psnr(estimate, image), float(estimate.mean() / image.mean()) - 1


def cells(rows: list[Row], biases: int) -> str:
    """Return the mean PSNR of each estimate, and the mean bias of some of the first ones."""
    means = np.mean(rows, axis=0)
    texts = []
    for number, (psnr, bias) in enumerate(means):
        texts += [f"{psnr:.2f}", f"{bias:+.1%}"] if number < biases else [f"{psnr:.2f}"]
    return " | ".join(texts)


def checkerboard(image: np.ndarray, q: int) -> list[float]:
    """Return the PSNR of networks without and with the average, and of total variation."""
    board = np.where(np.indices(image.shape).sum(axis=0) % 2, 1, q)
    bits = jl.Sensor(frames=16, gain=16.0 * q, threshold=board).expose(image, rng=0)
    with patch.object(merge_near, "_MAP_SIGMA", 0.0):
        alone = jl.reconstruct(bits)
    others = [jl.reconstruct(bits, method=name) for name in (None, "noniterative-tv", "admm-tv")]
    return [jl.metrics.psnr(estimate, image) for estimate in (alone, *others)]


if __name__ == "__main__":
    main()
