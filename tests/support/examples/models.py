"""Examples of networks, calibrations, motions, and checkpoints, all `.safetensors`."""

import contextlib
import functools

import numpy as np

import jotlight as jl
from examples.encodings import around_header
from examples.reader import Reader
from jotlight.calibration.figure import facts
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import History, Record

RUN = {"seed": 1}
"""Settings of the run that a checkpoint belongs to."""


def _network(path):
    network = jl.Network.initial(jl.Sensor(oversampling=4))
    jl.Network(network.layers, network.sensor, {"steps": 7}).save(path)


@functools.cache
def _calibrate():
    rng = np.random.default_rng(0)
    dark = rng.binomial(4000, 0.008, (32, 32))
    rates = rng.uniform(0.4, 0.6, (32, 32))
    return jl.calibrate(dark, jl.Bits.from_array(rng.random((400, 32, 32)) < rates), frames=4000)


def save_calibration(path):
    """Write a calibration."""
    _calibrate().save(path)


def _checkpoint(path):
    history = History([Record(0, 2.0, 0.5, 20.0), Record(1, 1.0, 0.25, None)])
    Checkpoint(RUN, np.arange(5.0), {"memory": np.ones((2, 5))}, history).save(path)


def _motion(path):
    rng = np.random.default_rng(0)
    nodes = rng.normal(size=(2, 3, 2, 2, 3)).astype(np.float32)
    information = np.ones((2, 3, 3, 2, 3), np.float32)
    labels = rng.integers(0, 2, (20, 40), np.uint8)
    jl.Motion(nodes, labels, np.array([0.5, 2, 4]), 2.0, "segments", information).save(path)


def _use_motion(path):
    """Load a motion and use it."""
    motion = jl.Motion.load(path)
    motion.at(3)
    motion.seen_from(3).at(0)
    return repr(motion)


def _use_network(path):
    """Load a network and use it, which may raise only ValueError or TypeError."""
    network = jl.Network.load(path)
    with contextlib.suppress(ValueError, TypeError):
        network.reconstruct(jl.Bits.from_array(np.eye(8, dtype=bool)), network.sensor)
    return network


def _use_calibration(path):
    calibration = jl.Calibration.load(path)
    with contextlib.suppress(ValueError):
        calibration.sensor(16)
    return facts(calibration)


MODELS = {
    "network": Reader("a.safetensors", _use_network, (_network,)),
    "network-header": Reader("a.safetensors", _use_network, (_network,), **around_header(_network)),
    "calibration": Reader("a.safetensors", _use_calibration, (save_calibration,)),
    "calibration-header": Reader(
        "a.safetensors", _use_calibration, (save_calibration,), **around_header(save_calibration)
    ),
    "motion": Reader("a.safetensors", _use_motion, (_motion,)),
    "motion-header": Reader("a.safetensors", _use_motion, (_motion,), **around_header(_motion)),
    "checkpoint": Reader(
        "a.safetensors",
        functools.partial(Checkpoint.load, run=RUN),
        (_checkpoint,),
        **around_header(_checkpoint),
    ),
}
"""Readers of `.safetensors` files, by what they hold."""
