"""Measure what a network gains by training on the capture itself, without ground truth.

    python benchmarks/studies/fine_tuning.py path/to/data network.safetensors

The network is K-conditioned. Simulated captures of the photograph "camera" are compared with the
photograph. The real capture of ``real/swissspad2_bird/counts.npz`` is compared with 48 further
frames, as in ``real_counts.py``. The training never uses the truth.
"""

import argparse
import time
from pathlib import Path

import numpy as np

import jotlight as jl
from jotlight.torch import fine_tune

CAPTURES = (1, 1.0), (4, 1.0), (16, 1.0), (16, 0.1)
"""Trials per pixel, and photons per bit at intensity 1."""

SIDE = 384


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("network", type=Path)
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--threads", type=int)
    options = parser.parse_args()
    network = jl.Network.load(options.network)
    photograph = jl.datasets.photograph("camera")[:SIDE, :SIDE]
    row, column = np.mgrid[:SIDE, :SIDE]
    lattice = 0.5 + 0.45 * np.sin(2 * np.pi * column / 6) * np.sin(2 * np.pi * row / 9)

    def tuned(data, sensor):
        start = time.perf_counter()
        found, history = fine_tune(
            network, data, sensor, steps=options.steps, rng=0, threads=options.threads
        )
        return found, history, time.perf_counter() - start

    print("| scene | trials | photons per trial | before, dB | after, dB | held out, nats | s |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    cases = [("photograph", photograph, *each) for each in CAPTURES]
    for name, scene, bits, light in [*cases, ("lattice", lattice, *CAPTURES[0])]:
        sensor = jl.Sensor(frames=bits, gain=bits * light)
        capture = sensor.expose(scene, rng=5)
        found, history, seconds = tuned(capture, sensor)
        before, after = (
            jl.metrics.psnr(each.reconstruct(capture), scene) for each in (network, found)
        )
        print(
            f"| {name} | {bits} | {light:g} | {before:.2f} | {after:.2f} | {change(history)} "
            f"| {seconds:.0f} |",
            flush=True,
        )

    with np.load(options.data / "real/swissspad2_bird/counts.npz", allow_pickle=False) as counts:
        captures = {frames: counts[f"k{frames}"].astype(np.int32) for frames in (16, 4, 1)}
        further = counts["k64"].astype(int) - counts["k16"]
    independent = further >= 0
    reference = further[independent] / 48
    noise = np.mean(reference * (1 - reference)) / 47

    def scores(estimate):
        error = np.mean((-np.expm1(-estimate[independent]) - reference) ** 2)
        return " | ".join(f"{-10 * np.log10(x):.2f}" for x in (error, max(error - noise, 1e-9)))

    print(
        "\n| frames | network | PSNR, dB | without the reference's noise, dB | held-out loss | s |"
    )
    print("| ---: | --- | ---: | ---: | ---: | ---: |")
    for frames, image in captures.items():
        sensor = jl.Sensor(frames=frames, max_intensity=4.0)
        print(
            f"| {frames} | without fine-tuning | {scores(network.reconstruct(image, sensor))} | | |"
        )
        found, history, seconds = tuned(image, sensor)
        print(
            f"| {frames} | fine-tuned | {scores(found.reconstruct(image, sensor))} "
            f"| {change(history)} | {seconds:.0f} |",
            flush=True,
        )


def change(history):
    return f"{history.held_out[0]:.5f} to {history.held_out[-1]:.5f}"


if __name__ == "__main__":
    main()
