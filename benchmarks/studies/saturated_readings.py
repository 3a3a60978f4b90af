"""Measure the mean intensity of images of mostly saturated readings.

    python benchmarks/studies/saturated_readings.py

The scenes are flat images of intensity 0.5 and 0.8, 128 x 128 pixels, and parts of two photographs
that come with scikit-image, 256 x 256 pixels. The table states the relative error of the mean
intensity and the PSNR in dB: by the default method, and by `noniterative-tv`, or behind a mosaic by
planes of the network "medium" with color differences. *limit* is the smallest relative standard
deviation at intensity 0.8 that an unbiased estimate from 113 pixels of the flat image can have (the
Cramer-Rao bound): as many as an average with a standard deviation of 3 pixels has. Behind a mosaic,
it is that of gray light.
"""

import numpy as np

import jotlight as jl
from jotlight.networks.color.mosaic_planes import plane_sensors
from jotlight.sensing.likelihood.reference import reading_information
from jotlight.sensing.parameters.mosaic import Mosaic

PART = slice(40, 296), slice(100, 356)
PHOTOGRAPHS = "astronaut", "coffee"
FLAT = 0.5, 0.8
PIXELS = 113
SHARES = 0.0807, 0.0807, 0.0807, 0.7579
"""Shares of the filters of SwissSPAD2: red, green, blue, and clear."""

SENSORS = {
    "one reading of 2 bits, 6 photons": jl.Sensor(bit_depth=2, gain=6.0),
    "one reading of 2 bits, 12 photons": jl.Sensor(bit_depth=2, gain=12.0),
    "8 readings of 2 bits, 12 photons": jl.Sensor(frames=8, bit_depth=2, gain=96.0),
    "8 readings of 2 bits, 18 photons": jl.Sensor(frames=8, bit_depth=2, gain=144.0),
    "4 frames, 8 photons": jl.Sensor(frames=4, gain=32.0),
    "16 frames, 8 photons": jl.Sensor(frames=16, gain=128.0),
    "gains 1, 2, 3, 4": jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0]),
}
CASES = [
    *((name, None) for name in list(SENSORS)[:4]),
    ("one reading of 2 bits, 6 photons", "RGBW"),
    ("one reading of 2 bits, 6 photons", "random RGBW"),
    ("4 frames, 8 photons", "RGBW"),
    ("16 frames, 8 photons", "RGBW"),
    ("16 frames, 8 photons", "random RGBW"),
    ("gains 1, 2, 3, 4", "random RGBW"),
]


def main() -> None:
    """Print the table."""
    errors = "flat 0.5 | flat 0.8 | astronaut, error | astronaut, dB | coffee, error | coffee, dB"
    print(f"| sensor | limit | method | {errors} |")
    print("| --- |" + " ---: |" * 8)
    for name, mosaic in CASES:
        second = {"method": "noniterative-tv"}
        if mosaic:
            second = {"method": "network-medium", "demosaicing": "differences"}
        for title, options in (("default", {}), (second["method"], second)):
            cells: list[str] = []
            for image in scenes(mosaic):
                cells += measure(name, mosaic, image, options)
            first = f"{name}{', ' + mosaic if mosaic else ''} | {limit(name, mosaic):.0%}"
            print(f"| {first} | {title} | {' | '.join(cells)} |", flush=True)


def scenes(mosaic: str | None) -> list[np.ndarray]:
    """Return the images, gray ones without a mosaic."""
    shape = (128, 128, 3) if mosaic else (128, 128)
    flat = [np.full(shape, value) for value in FLAT]
    images = [jl.datasets.photograph(name, gray=mosaic is None) for name in PHOTOGRAPHS]
    return flat + [image[PART].astype(float) for image in images]


def sensor_of(name: str, mosaic: str | None, shape: tuple[int, ...]) -> jl.Sensor:
    """Return the sensor of a row for an image."""
    if mosaic is None:
        return SENSORS[name]
    pattern: object = mosaic
    if mosaic.startswith("random"):
        places = np.random.default_rng(5).choice(4, shape[:2], p=SHARES)
        pattern = Mosaic(places.astype(np.uint8), "RGBW")
    return SENSORS[name].replace(mosaic=pattern)


def measure(name: str, mosaic: str | None, image: np.ndarray, options: dict[str, str]) -> list[str]:
    """Return the relative error of the mean, and for photographs the PSNR, as texts."""
    sensor = sensor_of(name, mosaic, image.shape)
    readings = sensor.expose(image, rng=0, channel_axis=-1 if mosaic else None)
    estimate = jl.reconstruct(readings, **options)
    bias = f"{estimate.mean() / image.mean() - 1:+.1%}"
    return [bias] if np.ptp(image) == 0 else [bias, f"{jl.metrics.psnr(estimate, image):.2f}"]


def limit(name: str, mosaic: str | None) -> float:
    """Return the relative standard deviation of the best estimate from 113 pixels of gray light."""
    sensor = sensor_of(name, mosaic, (128, 128))
    shares = [1.0]
    if mosaic:
        shares = np.bincount(sensor.mosaic.full(128, 128).ravel()) / 128**2
    information = 0.0
    for share, plane in zip(shares, plane_sensors(sensor), strict=True):
        for group in plane.groups():
            scale = group.sensor.light_per_intensity
            each = reading_information(group.sensor, [scale * FLAT[1]])[0]
            information += share * group.sensor.trials * scale**2 * each
    return 1 / np.sqrt(PIXELS * information) / FLAT[1]


if __name__ == "__main__":
    main()
