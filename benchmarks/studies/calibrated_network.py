"""A network learned for a capture with a calibration, beside what else one could do.

    python benchmarks/studies/calibrated_network.py

A simulated camera of 512 x 512 jots with dark counts (gamma, 1.6 % of the jots hot) and a response
that varies by 5 % takes a dark and a flat capture of 2000 frames, and 16 frames of a dim
photograph. The networks are learned as `jotlight train --sensor` does, in 30 steps each, and the
photograph is not among those that they learn from. All takes a minute or two on two cores.
"""

import warnings

import numpy as np

import jotlight as jl
from jotlight.estimators.brightness import training_sensor
from jotlight.evaluation.methods import METHODS

LEVEL = 0.3
"""Of the photograph's white, in photons per jot and frame."""

PHOTO = "camera"


def main() -> None:
    warnings.simplefilter("ignore")  # it says that masked pixels are filled
    scene = np.float32(LEVEL) * jl.datasets.photograph(PHOTO)
    rng = np.random.default_rng(0)
    dark = rng.gamma(2, 0.01, scene.shape)
    dark[rng.random(scene.shape) < 0.016] = 0.4
    response = np.clip((1 + 0.05 * rng.standard_normal(scene.shape)) / 1.3, 1e-3, 1)
    camera = jl.Sensor(frames=2000, gain=2600, dark_counts=dark, efficiency=response)
    calibration = jl.calibrate(
        camera.expose(np.zeros(scene.shape), rng=1), camera.expose(np.full(scene.shape, 0.7), rng=2)
    )
    seen = camera.replace(frames=16).expose(scene, rng=3)
    seen = jl.Bits(seen.packed, seen.width)
    known, unknown = calibration.sensor(16), jl.Sensor(frames=16)
    with_it, without = learned(seen, known), learned(seen, unknown)
    rows = {
        "network for this capture, learned with the calibration": by(with_it, seen, known),
        "network for this capture, learned without": by(without, seen, known),
        "network that comes with jotlight": by(jl.pretrained(known, "two-layer"), seen, known),
        **{
            METHODS[name].title: METHODS[name].run(seen, known)
            for name in ("noniterative-gaussian", "noniterative-tv", "admm-tv", "mle")
        },
        "network for this capture, calibration never used": by(without, seen, unknown),
        "network that comes with jotlight, likewise": by(
            jl.pretrained(unknown, "two-layer"), seen, unknown
        ),
    }
    print("| method | PSNR, dB |")
    print("| --- | ---: |")
    for name, picture in rows.items():
        print(f"| {name} | {jl.metrics.psnr(picture, scene, peak=LEVEL):.2f} |")


def learned(seen: jl.Bits, sensor: jl.Sensor) -> jl.Network:
    fitted, scale = training_sensor(seen, sensor)
    names = [name for name in jl.datasets.PHOTOGRAPHS if name != PHOTO]
    photographs = [np.float32(scale) * jl.datasets.photograph(name, gray=True) for name in names]
    return jl.train(jl.Network.initial(fitted), photographs, rng=0)[0]


def by(network: jl.Network, seen: jl.Bits, sensor: jl.Sensor) -> np.ndarray:
    own = sensor.replace(max_intensity=network.sensor.max_intensity)
    return network.reconstruct(seen, own)


if __name__ == "__main__":
    main()
