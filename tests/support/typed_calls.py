"""Calls of the README and of the guide. mypy checks their types, and no test runs them."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

import jotlight as jl
import jotlight.dask
from jotlight.formats import open_capture
from jotlight.sensing.parameters.mosaic import Mosaic

Image = npt.NDArray[np.float32]


def sensors(jots: npt.NDArray[np.float64]) -> list[jl.Sensor]:
    """Return sensors whose parameters have all types that the reference names."""
    return [
        jl.Sensor(oversampling=4),
        jl.Sensor(frames=np.int64(3), gain=[1.0, 2.0, 3.0]),
        jl.Sensor(frames=48, gain=np.repeat([2, 2 / 8, 2 / 64], 16), max_intensity=60),
        jl.Sensor(frames=3, threshold=(1, 2, 3)),
        jl.Sensor(threshold=jots.astype(int)),
        jl.Sensor(dark_counts=jots, efficiency=jots, mask=jots > 0, kernel="cubic"),
        jl.Sensor(dark_counts=np.float32(0.1), gain=np.float32(2), read_noise=np.float32(0.2)),
        jl.Sensor(bit_depth=4, exposure_time=1e-3),
        jl.Sensor(mosaic="RGGB").replace(frames=3),
        jl.Sensor(mosaic=[["R", "G"], ["G", "B"]]),
        jl.Sensor(mosaic=Mosaic([[0, 1], [3, 2]], "RGBG", white_balance=[2.0, 1.0, 1.5])),
    ]


def simulate(image: Image, photons: npt.NDArray[np.float64]) -> Image:
    sensor = jl.Sensor(oversampling=4)
    bits = sensor.expose(image, rng=0)
    jl.save(bits, "camera.npy")
    jl.save_image("camera.png", jl.reconstruct(bits))
    jl.save_image(Path("camera.png"), jl.mle(sensor.expose(photons, rng=np.random.default_rng(0))))
    first, count, all_bits = bits[0], len(bits), np.asarray(bits)
    print(first.mean(), count, all_bits.shape, bits[:8].counts(), bits.shape)
    return sensor.probability(image)


def compare(image: Image, sensor: jl.Sensor) -> None:
    def own(bits: jl.Bits) -> npt.NDArray[np.float64]:
        return bits.counts() / sensor.trials

    print(jl.compare({"own": own, "ADMM": "admm-tv", "network": "network-medium"}, image, sensor))
    print(jl.compare(["mle", "admm-tv"], image, sensor))


def reconstruct_captures() -> None:
    bits = jl.open("capture.bin", format="swissspad2", frames=slice(1, 3), rotate=90)
    sensor = jl.Sensor(frames=len(bits))
    estimate, info = jl.reconstruct(bits, sensor, method="admm-tv", weight=0.1, return_info=True)
    print(estimate.shape, info)
    for each in jl.open("captures/*.npy"):
        jl.save(each, "copy.npy")
    counts: npt.NDArray[np.int32] = jl.open("counts.tif", counts=True).astype(np.int32)
    print(jl.mle(counts, sensor, trials=np.full(counts.shape, 16)))
    jl.mle_iterative(bits, sensor)
    jl.noniterative(counts, sensor, denoiser=lambda image: image)
    smooth, history = jl.admm_tv(bits, sensor, return_history=True)
    jl.admm_tv(bits, sensor, weight=1.5 * history.weight, start=smooth)
    print(jl.uncertainty(bits, sensor, confidence_level=0.9), jl.plan(sensor, light=(0.05, 2.0)))


def use_the_sensor_of_bits(bits: jl.Bits, readings: jl.Readings) -> None:
    sensor = bits.sensor
    assert sensor is not None
    jl.reconstruct(bits, sensor)
    jl.pretrained(sensor.replace(frames=16), "large").reconstruct(bits)
    jl.reconstruct(readings, readings.sensor)
    merged = jl.merge_readings(bits)
    print(jl.reconstruct(merged), merged.sensor, jl.Merged([[1, 2]], 4, sensor).shape)


def follow_motion() -> None:
    bits = jl.open("shaken.npy")
    motion = jl.align(bits, model="auto")
    jl.reconstruct(jl.merge(bits, motion=motion, at=200, upsample=2))
    jl.merge(open_capture("sums.npy"), jl.Sensor(frames=64))
    jl.save_film("film.gif", (jl.reconstruct(part.data) for part in jl.film(bits, window=64)))
    jl.save_film("counts.tif", [part.counts() for part in bits.windows(16)], fps=50)
    image = next(jl.estimate_film(jl.film(bits, window=64, step=16, causal=True)))
    print(image.data)


def calibrate(capture: jl.Bits) -> jl.Calibration:
    calibration = jl.calibrate(jl.open("dark.npy"), jl.open("flat.npy"), mosaic="RGGB")
    print(calibration.sensor(16), jl.calibrate(capture, capture).sensor(frames=16))
    return calibration


def train(images: Image) -> None:
    mine = jl.Sensor(frames=30, gain=15.0, dark_counts=0.01)
    network, history = jl.train(jl.Network.initial(mine), images, steps=8, batch=16, rng=0)
    print(history.loss[0], jl.metrics.psnr(images[0], network(np.zeros((8, 8), np.uint16))))
    network.save("mine.safetensors")


def run_on_many_captures(bits: jl.Bits) -> None:
    jotlight.dask.reconstruct(bits, window=64, method="mle")
    jotlight.dask.count(bits, window=64, step=32)
