"""Compare estimates of dim scenes, and of sensors whose jots differ.

    python benchmarks/studies/dim_scenes.py [DATA]

The images are parts of six photographs of `photographs/cid22` in DATA, or of two that come with
scikit-image, 192 x 192 pixels, in gray. The tables show the mean PSNR in dB, and in parentheses the
relative error of the mean intensity.

In the first table, *photons* is the number per jot and frame at intensity 1, and *ones* is the
mean number of ones of a pixel. *one by one* is the network "medium" for the trials as they are,
*medium* sees several of them as one, and *default* is the recommended method.

In the second table, jots need several photons, so most bits of dark regions are 0. *coverage* is
the share of the 90 % intervals of the default that contain the true intensity.

In the third table, the jots of a sensor differ. *mean jot* takes all jots for alike, and *alike*
is a sensor whose jots are alike.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

import jotlight as jl
from jotlight.estimators.inverse_response import intensity_from_probability

SIDE = 192
NUMBERS = [
    (frames, photons)
    for frames in (64, 256, 1000, 4000)
    for photons in (1e-4, 5e-4, 0.002, 0.01, 0.05)
    if frames * photons >= 0.1
]
RNG = np.random.default_rng(0)
SHAPE = SIDE, SIDE
MAPS = {
    "dim, dark counts of 0.02 on average": {
        "frames": 16,
        "gain": 16 * 0.05,
        "dark_counts": RNG.gamma(1, 0.02, SHAPE),
    },
    "dimmer": {"frames": 16, "gain": 16 * 0.02, "dark_counts": RNG.gamma(1, 0.02, SHAPE)},
    "2 % hot jots with 5 dark counts": {
        "frames": 32,
        "dark_counts": np.where(RNG.random(SHAPE) < 0.02, 5.0, 0.01),
    },
    "efficiency 0.7, standard deviation 10 %": {
        "frames": 16,
        "gain": 32.0,
        "efficiency": np.clip(RNG.normal(0.7, 0.07, SHAPE), 0.1, 1),
    },
    "efficiency from 0.1 to 1": {
        "frames": 16,
        "gain": 48.0,
        "efficiency": RNG.uniform(0.1, 1, SHAPE),
    },
    "2 x 2 jots with efficiency 0.2 and 1": {
        "frames": 16,
        "oversampling": 2,
        "gain": 192.0,
        "efficiency": np.where(np.indices((2 * SIDE, 2 * SIDE))[1] % 2, 1.0, 0.2),
    },
    "bracket 64 : 8 : 1, efficiency from 0.1 to 1": {
        "frames": 48,
        "gain": np.repeat([8, 1, 1 / 8], 16),
        "max_intensity": 5.0,
        "efficiency": RNG.uniform(0.1, 1, SHAPE),
    },
}
THRESHOLDS = [
    (2, 30, 0.3),
    (3, 30, 0.5),
    (3, 30, 1),
    (5, 30, 2),
    (5, 256, 2),
    (5, 30, 6),
    (8, 30, 5),
]
"""The threshold, the number of frames, and the photons per frame at the intensity 1."""
METHODS = "network-medium", "noniterative-tv", "admm-tv"


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, nargs="?")
    images = photographs(parser.parse_args().data)
    print("| K | photons | ones | one by one | medium | admm-tv | default |")
    print("| ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for frames, photons in NUMBERS:
        sensor = jl.Sensor(frames=frames, gain=frames * photons)
        rows = [estimates_of(sensor.expose(each, rng=i), sensor) for i, each in enumerate(images)]
        ones = np.mean([frames * photons * each.mean() for each in images])
        cells = " | ".join(cell(column, images) for column in zip(*rows, strict=True))
        print(f"| {frames:,} | {photons:g} | {ones:.2f} | {cells} |", flush=True)
    print_thresholds(images)
    print(f"\n| sensor | method | mean jot | map | alike |\n| --- | --- |{' ---: |' * 3}")
    for name, options in MAPS.items():
        for method in METHODS:
            rows = [of_jots(options, each, method, i) for i, each in enumerate(images)]
            cells = " | ".join(cell(column, images) for column in zip(*rows, strict=True))
            print(f"| {name} | {method} | {cells} |", flush=True)


def print_thresholds(images: list[np.ndarray]) -> None:
    """Print the table of high thresholds."""
    print("\n| q | K | photons | ones | one by one | medium | admm-tv | default | coverage |")
    print(f"|{' ---: |' * 9}")
    for threshold, frames, photons in THRESHOLDS:
        sensor = jl.Sensor(frames=frames, gain=frames * photons, threshold=threshold)
        bits = [sensor.expose(each, rng=i) for i, each in enumerate(images)]
        rows = [estimates_of(each, sensor) for each in bits]
        cells = " | ".join(cell(column, images) for column in zip(*rows, strict=True))
        ones = np.mean([each.counts().mean() for each in bits])
        limits = [jl.uncertainty(each, confidence_level=0.9) for each in bits]
        inside = np.mean(
            [(u.low <= x) & (x <= u.high) for u, x in zip(limits, images, strict=True)]
        )
        start = f"{threshold} | {frames} | {photons:g} | {ones:.2f}"
        print(f"| {start} | {cells} | {inside:.1%} |", flush=True)


def photographs(data: Path | None) -> list[np.ndarray]:
    """Return the images."""
    if data is None:
        names = "camera", "coffee"
        found = [jl.datasets.photograph(name, gray=True).astype(float) for name in names]
    else:
        paths = sorted((data / "photographs" / "cid22").iterdir())[:6]
        found = [np.asarray(Image.open(path).convert("L")) / 255 for path in paths]
    return [each[:SIDE, :SIDE] for each in found]


def estimates_of(bits: jl.Bits, sensor: jl.Sensor) -> list[np.ndarray]:
    """Return the estimates of a row of the first two tables."""
    network = jl.pretrained(sensor)
    fraction = (bits.counts() / sensor.frames).astype(np.float32)
    (one_by_one,) = network.engine_network.denoise([fraction], [sensor.frames], False, None)
    methods = "network-medium", "admm-tv", None
    return [
        intensity_from_probability(np.clip(one_by_one, 0, 1), sensor, None),
        *(jl.reconstruct(bits, method=method) for method in methods),
    ]


def of_jots(options: dict, image: np.ndarray, method: str, seed: int) -> list[np.ndarray]:
    """Return the estimates of a row of the third table."""
    sensor = jl.Sensor(**options)
    bits = sensor.expose(image, rng=seed)
    typical = {
        name: float(np.mean(options[name]))
        for name in ("efficiency", "dark_counts")
        if name in options
    }
    alike = sensor.replace(**typical, gain=sensor.gain)
    mean = jl.Bits(bits.packed, bits.width, alike)
    return [
        jl.reconstruct(each, method=method) for each in (mean, bits, alike.expose(image, rng=seed))
    ]


def cell(estimates, images) -> str:
    """Return the mean PSNR, and the mean relative error of the mean intensity."""
    pairs = list(zip(estimates, images, strict=True))
    quality = np.mean([jl.metrics.psnr(*pair, data_range=1.0) for pair in pairs])
    bias = np.mean([estimate.mean() / image.mean() - 1 for estimate, image in pairs])
    return f"{quality:.2f} ({bias:+.0%})"


if __name__ == "__main__":
    main()
