"""Draw the images of the page "Which sensor is mine?": a reading, or the data, and the estimate.

    python benchmarks/studies/sensor_kinds.py docs/guide

Each image shows the data of one kind of sensor on the left and the estimate on the right.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl

Array = npt.NDArray[np.floating]


def scene() -> Array:
    """Return a photograph of 256 x 256 pixels, from 0 to 1."""
    return np.asarray(jl.datasets.photograph("camera")[::2, ::2], np.float64)


def one_bit() -> tuple[Array, Array]:
    """Return a frame and the estimate of a sensor with single bits."""
    bits = jl.Sensor(frames=16).expose(scene(), rng=0)
    return bits[0].astype(float), jl.reconstruct(bits)


def bracket() -> tuple[Array, Array]:
    """Return the frames of three exposures and the estimate of a wide range of light."""
    image = np.maximum(scene(), 0.02) * np.geomspace(0.03, 30, 256)
    sensor = jl.Sensor(frames=48, gain=np.repeat([32.0, 4.0, 0.5], 16), max_intensity=60)
    bits = sensor.expose(image, rng=0)
    third = 256 // 3
    shown = np.concatenate(
        [bits[frame][:, place * third :][:, :third] for place, frame in enumerate((0, 16, 32))], 1
    )
    estimate = np.log(np.maximum(jl.reconstruct(bits), 0.003) / 0.003) / np.log(10000)
    return np.pad(shown.astype(float), ((0, 0), (0, 256 - 3 * third))), estimate


def thresholds() -> tuple[Array, Array]:
    """Return a frame and the estimate of a checkerboard of thresholds."""
    board = np.where(np.indices((256, 256)).sum(axis=0) % 2, 1, 8)
    sensor = jl.Sensor(frames=16, gain=16 * 8, threshold=board)
    bits = sensor.expose(scene(), rng=0)
    return bits[0].astype(float), jl.reconstruct(bits)


def several_bits() -> tuple[Array, Array]:
    """Return a frame and the estimate of a sensor with four bits and read noise."""
    sensor = jl.Sensor(frames=8, gain=8 * 3, bit_depth=4, read_noise=0.3)
    readings = sensor.expose(scene(), rng=0)
    return readings[0] / 8, jl.reconstruct(readings)


def dead_time() -> tuple[Array, Array]:
    """Return the counts and the light of free-running pixels with a dead time."""
    pixel = jl.FreeRunning(dead_time=0.01)
    light = 300 * scene()
    counts = pixel.draw(light, rng=0)
    return counts / 100, np.minimum(pixel.mle(counts) / 300, 1)


def gates() -> tuple[Array, Array]:
    """Return the counts of the first gate and the lifetimes of a gate stack."""
    times, lifetime = np.arange(12) * 0.7, 1 + 2 * (np.indices((256, 256))[1] // 64) / 3
    detections = (0.2 + scene()) * np.exp(-times[:, None, None] / lifetime)
    counts = np.random.default_rng(0).binomial(1000, -np.expm1(-detections))
    return counts[0] / 1000, jl.gates.decay_lifetime(counts, times, trials=1000) / 4


def mosaic() -> tuple[Array, Array]:
    """Return a frame of an RGGB mosaic in its colors, and the estimate."""
    image = np.asarray(jl.datasets.photograph("astronaut")[::2, ::2], np.float64)
    sensor = jl.Sensor(frames=16, mosaic="RGGB")
    bits = sensor.expose(image, rng=0)
    filters = np.eye(3)[sensor.mosaic.full(256, 256)]
    return bits[0][..., None] * filters, jl.reconstruct(bits)


def channels() -> tuple[Array, Array]:
    """Return a frame of three channels, and the estimate."""
    image = np.asarray(jl.datasets.photograph("astronaut")[::2, ::2], np.float64)
    bits = jl.Sensor(frames=16).expose(image, rng=0, channel_axis=-1)
    return bits[0].astype(float), jl.reconstruct(bits)


def moving_mosaic() -> tuple[Array, Array]:
    """Return the sum of the frames of a moving scene behind RGGB, and the estimate."""
    sensor = jl.Sensor(frames=256, mosaic="RGGB")
    photograph = jl.datasets.photograph("coffee")
    scene = jl.datasets.moving(photograph, sensor=sensor, shape=(256, 256), photons=0.2, rng=0)
    bits = jl.Bits(np.asarray(scene.bits.packed), 256, scene.bits.sensor)
    return jl.reconstruct(bits), jl.reconstruct(jl.merge(bits))


def sums() -> tuple[Array, Array]:
    """Return the sum of 15 frames, and the estimate."""
    counts = jl.Sensor(frames=15).expose(scene(), rng=0).counts()
    return counts / 15, jl.reconstruct(counts, jl.Sensor(frames=15))


KINDS: dict[str, Callable[[], tuple[Array, Array]]] = {
    "one_bit": one_bit,
    "bracket": bracket,
    "thresholds": thresholds,
    "several_bits": several_bits,
    "sums": sums,
    "mosaic": mosaic,
    "moving_mosaic": moving_mosaic,
    "channels": channels,
    "dead_time": dead_time,
    "gates": gates,
}


def main() -> None:
    """Write the images to a folder."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    for name, make in KINDS.items():
        data, estimate = make()
        both = np.concatenate([data, np.ones((256, 8, *data.shape[2:])), estimate], axis=1)
        jl.save_image(folder / f"sensor_{name}.jpg", np.clip(both, 0, 1).astype(np.float32))


if __name__ == "__main__":
    main()
