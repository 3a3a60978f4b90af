"""Measure how much better networks are that are trained for one sensor alone.

    python benchmarks/studies/one_sensor.py BSDS300 [--quality medium] [--steps 2000]

BSDS300 is the folder with `train` and `test`. For each sensor, the pretrained K-conditioned network
is trained on with the readings of this sensor alone, and with the error of the intensities as the
cost. So it has had more steps than the pretrained one, which receives equivalent counts and never
saw such a sensor. The table states the mean PSNR of both on the first test images.
"""

import argparse
import math
from pathlib import Path

import numpy as np
import torch

import jotlight as jl
from jotlight.estimators.merge_readings import merge_images
from jotlight.estimators.readings.reference_sensors import reference_sensor
from jotlight.images.sets import read_image_set
from jotlight.metrics import psnr
from jotlight.networks.pretrained import FOLDER, MAX_TRIALS
from jotlight.sensing.data.pixel_counts import gray_images, prepare_data
from jotlight.torch import Network
from jotlight.torch.estimates import intensity_from_probability
from jotlight.training import ImagePatches

SENSORS = {
    "plain bits, 4 frames": jl.Sensor(frames=4),
    **{
        f"{bits} bits, read noise 0.3, {frames} readings": jl.Sensor(
            frames=frames, bit_depth=bits, read_noise=0.3
        )
        for bits in (2, 3, 4)
        for frames in (4, 16, 64)
    },
    "bracket 1 : 8 : 64, 48 frames": jl.Sensor(frames=48, gain=np.tile([0.05, 0.4, 3.2], 16)),
    "thresholds 1 to 4, 16 frames": jl.Sensor(frames=16, gain=40.0, threshold=[1, 2, 3, 4] * 4),
}
"""The sensors. Those of several bits have one photon per reading at intensity 1. Plain bits, for
which the networks were made, show what it costs that they serve all K and exposures."""

PATCHES, SIDE = 4, 64
"""Rows and columns of patches in a batch, and the side of a patch."""


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("images", type=Path)
    parser.add_argument("--quality", default="medium")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--learning-rate", type=float, default=5e-4)
    parser.add_argument("--sensors", help="a part of their names; default: all", default="")
    parser.add_argument("--number", type=int, default=10)
    options = parser.parse_args()
    source = ImagePatches(read_image_set(options.images / "train")[1])
    tests = [each.astype(float) for each in read_image_set(options.images / "test")[1]]
    print("| sensor | pretrained | trained for this sensor alone | difference |")
    print("| --- | --- | --- | --- |")
    for name, sensor in SENSORS.items():
        if options.sensors in name:
            trained = train(sensor, source, options.quality, options.steps, options.learning_rate)
            pretrained, own = measure(sensor, *trained, tests[: options.number], options.quality)
            print(f"| {name} | {pretrained:.2f} | {own:.2f} | {own - pretrained:.2f} |", flush=True)


def read_data(
    sensor: jl.Sensor, image: np.ndarray, seed: int, trials: int | None = None
) -> tuple[jl.Bits | jl.Readings, torch.Tensor, int]:
    """Return readings of an image, and equivalent counts (1, 1, H, W) of a number of trials.

    The number is that of the median pixel, but at most the largest K of the networks, unless it is
    given.
    """
    readings = sensor.expose(image, rng=seed)
    data, _ = prepare_data(readings, sensor, may_differ=True)
    merged = merge_images(gray_images(data), sensor, 1).data[0]
    own = np.broadcast_to(merged.trials, merged.shape)
    trials = trials or min(round(float(np.median(own))), MAX_TRIALS)
    counts = (trials * merged.ones / np.maximum(own, 1e-9)).astype(np.float32)
    return readings, torch.from_numpy(counts)[None, None], trials


def train(
    sensor: jl.Sensor, source: ImagePatches, quality: str, steps: int, rate: float
) -> tuple[Network, int]:
    """Return the pretrained network after more steps on the readings of one sensor alone, and K."""
    module = Network(FOLDER / f"{quality}.safetensors")
    parameters = [each for each in module.parameters() if each.requires_grad]
    optimizer = torch.optim.Adam(parameters, rate)
    plain = reference_sensor(sensor)
    average = [each.detach().clone() for each in parameters]
    trials = None
    for step in range(steps):
        rng = np.random.default_rng((7, step))
        patches = [source.draw(rng, SIDE).values for _ in range(PATCHES**2)]
        rows = [np.concatenate(patches[n::PATCHES], axis=1) for n in range(PATCHES)]
        _, data, trials = read_data(sensor, np.concatenate(rows).astype(float), step, trials)
        place = min(1.0, (step + 1) / (0.05 * steps)) * 0.5 * (1 + math.cos(math.pi * step / steps))
        for group in optimizer.param_groups:
            group["lr"] = rate * place
        optimizer.zero_grad()
        data = _split(data[0, 0])
        truth = _split(torch.from_numpy(np.concatenate(rows)))
        found = intensity_from_probability(module.run_layers(data, trials), plain)
        loss = ((found - truth) ** 2).mean()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(parameters, 1.0)
        optimizer.step()
        with torch.no_grad():
            for kept, each in zip(average, parameters, strict=True):
                kept.lerp_(each, 1 - min(0.995, (step + 1) / (step + 10)))
    with torch.no_grad():
        for kept, each in zip(average, parameters, strict=True):
            each.copy_(kept)
    return module, trials


def _split(image: torch.Tensor) -> torch.Tensor:
    """Return the patches of an image, (N, 1, SIDE, SIDE)."""
    parts = image.reshape(PATCHES, SIDE, PATCHES, SIDE).transpose(1, 2)
    return parts.reshape(-1, 1, SIDE, SIDE)


def measure(
    sensor: jl.Sensor, module: Network, trials: int, images: list[np.ndarray], quality: str
) -> tuple[float, float]:
    """Return the mean PSNR of the pretrained network, and of that for the sensor alone."""
    pretrained, own = [], []
    plain = reference_sensor(sensor)
    for seed, image in enumerate(images):
        readings, data, _ = read_data(sensor, image, seed, trials)
        pretrained.append(psnr(image, jl.reconstruct(readings, quality=quality)))
        with torch.no_grad():
            found = intensity_from_probability(module.run_layers(data, trials), plain)
        own.append(psnr(image, found[0, 0].numpy()))
    return float(np.mean(pretrained)), float(np.mean(own))


if __name__ == "__main__":
    main()
