"""Compare a two-layer network trained for a capture with its calibration to other methods.

    python benchmarks/studies/calibrated_network.py

A simulated camera of 512 x 512 jots has dark counts (gamma, 1.6 % of the jots hot) and a response
that varies by 5 %. It takes a dark and a flat capture of 2000 frames, and 16 frames of a dim
photograph. The networks are trained as `jotlight train --sensor` does, in 30 steps each, on other
photographs. The study takes one to two minutes on two cores.
"""

import argparse
import warnings

import numpy as np

import jotlight as jl
from jotlight.estimators.brightness import training_sensor
from jotlight.evaluation.methods import METHODS

WHITE_LEVEL = 0.3
"""Photons per jot and frame where the photograph is white."""

PHOTO = "camera"


def main() -> None:
    argparse.ArgumentParser(description=__doc__.split("\n")[0]).parse_args()
    warnings.simplefilter("ignore")  # A warning says that masked pixels are inpainted.
    scene = np.float32(WHITE_LEVEL) * jl.datasets.photograph(PHOTO)
    rng = np.random.default_rng(0)
    dark = rng.gamma(2, 0.01, scene.shape)
    dark[rng.random(scene.shape) < 0.016] = 0.4
    response = np.clip((1 + 0.05 * rng.standard_normal(scene.shape)) / 1.3, 1e-3, 1)
    camera = jl.Sensor(frames=2000, gain=2600, dark_counts=dark, efficiency=response)
    calibration = jl.calibrate(
        camera.expose(np.zeros(scene.shape), rng=1), camera.expose(np.full(scene.shape, 0.7), rng=2)
    )
    capture = camera.replace(frames=16).expose(scene, rng=3)
    # Without its sensor, the capture does not know the camera's defects.
    capture = jl.Bits(capture.packed, capture.width)
    known, unknown = calibration.sensor(16), jl.Sensor(frames=16)
    with_it, without = trained(capture, known), trained(capture, unknown)
    rows = {
        "network for this capture, trained with the calibration": estimate(with_it, capture, known),
        "network for this capture, trained without it": estimate(without, capture, known),
        **{
            f"jotlight's network, {size}": estimate(jl.pretrained(known, size), capture, known)
            for size in ("two-layer", "small", "medium", "large")
        },
        **{
            METHODS[name].title: METHODS[name].run(capture, known)
            for name in ("noniterative-gaussian", "noniterative-tv", "admm-tv", "mle")
        },
        "network for this capture, calibration not used at all": estimate(
            without, capture, unknown
        ),
        "jotlight's network, medium, calibration not used at all": estimate(
            jl.pretrained(unknown), capture, unknown
        ),
    }
    print("| method | PSNR, dB |")
    print("| --- | ---: |")
    for name, image in rows.items():
        print(f"| {name} | {jl.metrics.psnr(image, scene, data_range=WHITE_LEVEL):.2f} |")


def trained(capture: jl.Bits, sensor: jl.Sensor) -> jl.Network:
    """Return a network trained on photographs as bright as the capture."""
    fitted, scale = training_sensor(capture, sensor)
    names = [name for name in jl.datasets.PHOTOGRAPHS if name != PHOTO]
    photographs = [np.float32(scale) * jl.datasets.photograph(name, gray=True) for name in names]
    return jl.train(jl.Network.initial(fitted), photographs, rng=0)[0]


def estimate(network: jl.Network, capture: jl.Bits, sensor: jl.Sensor) -> np.ndarray:
    """Return the network's estimate for a sensor with the network's intensity range."""
    own = sensor.replace(max_intensity=network.sensor.max_intensity)
    return network.reconstruct(capture, own)


if __name__ == "__main__":
    main()
