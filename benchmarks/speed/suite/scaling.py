"""How time and memory grow with pixels, trials per pixel, frames, and filter size."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

import jotlight as jl
from suite.tasks.scene import untied
from suite.timing import Effort, Run, race

SIZES = [2**power for power in range(5, 15)]
QUICK_SIZES = SIZES[:6]
OPERATIONS = "reconstruct", "expose", "reconstruct-out"
SIDE = 256
OVERSAMPLING = range(3, 11)
FRAMES = [1, 2, 4, 8, 16, 32, 64]
TAPS = [1, 3, 5, 7, 9, 11, 13, 15, 19, 23, 27, 31]


def measure(effort: Effort, *, quick: bool) -> dict[str, Any]:
    sizes = QUICK_SIZES if quick else SIZES
    return {
        "side": SIDE,
        "sizes": [one_size(operation, side) for operation in OPERATIONS for side in sizes],
        "oversampling": by_sensor(
            {side: jl.Sensor(oversampling=side) for side in OVERSAMPLING}, effort
        ),
        "frames": by_sensor({frames: jl.Sensor(frames=frames) for frames in FRAMES}, effort),
        "taps": by_taps(effort),
    }


def one_size(operation: str, side: int) -> dict[str, Any]:
    """Return the time and memory of one size, measured in a process of its own."""
    command = [sys.executable, str(Path(__file__).with_name("one_size.py")), operation, str(side)]
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(found.stdout)


def by_sensor(sensors: dict[int, jl.Sensor], effort: Effort) -> dict[str, Any]:
    """Return the seconds of a reconstruction, tied and untied, by the dictionary's key."""
    runs: dict[str, Run] = {}
    for key, sensor in sensors.items():
        tied = jl.Network.initial(sensor)
        for name, network in (("tied", tied), ("untied", untied(tied))):
            runs[f"{name} {key}"] = reconstruction(network)
    return race(runs, [1], effort)["1"]


def by_taps(effort: Effort) -> dict[str, Any]:
    sensor = jl.Sensor(oversampling=4)
    networks = {taps: jl.Network.initial(sensor, taps=taps) for taps in TAPS}
    runs = {f"tied {taps}": reconstruction(network) for taps, network in networks.items()}
    return race(runs, [1], effort)["1"]


def reconstruction(network: jl.Network) -> Run:
    image = np.random.default_rng(0).random((SIDE, SIDE), np.float32)
    bits = network.sensor.expose(image, rng=0)
    return lambda threads: network.reconstruct(bits, threads=threads)
