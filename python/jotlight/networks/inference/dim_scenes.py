"""Dim scenes: a K-conditioned network sees several of their trials as one, in the engine.

In a dim scene, ones are rare. Then c trials are like one trial whose probability of a one is c
times as large: in both cases, the number of ones is nearly a Poisson number. Networks were trained
for brighter scenes, and hardly any probability that they return is below 1e-4.
"""

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.estimators.trial_levels import LocalTrials
from jotlight.networks.inference.engine_backed import sensor_model
from jotlight.sensing.sensor import Sensor


def trials_per_combined(fraction: Image, trials: LocalTrials, smallest: int = 1) -> float:
    """Return c, the number of trials per combined trial, or 1 for scenes that are not dim.

    Parameters
    ----------
    fraction : ndarray of float32, shape (H, W)
        Fractions of ones.
    trials : int or ndarray of float32, shape (H, W)
        The local number of trials.
    smallest : int
        The smallest K of the network.

    Examples
    --------
    >>> dim = np.full((8, 8), 1 / 256, np.float32)
    >>> trials_per_combined(dim, 256), trials_per_combined(32 * dim, 256)
    (64.0, 2.0)
    >>> trials_per_combined(dim, 4)
    1.0
    """
    return engine.trials_per_combined(fraction, trials, smallest)


def may_be_dim(image: Image, sensor: Sensor) -> bool:
    """Return whether an estimate is so dark that trials may be combined.

    Parameters
    ----------
    image : ndarray of float32, shape (H, W)
        The estimate.
    sensor : Sensor
        The sensor.

    Examples
    --------
    >>> image = np.full((4, 4), 0.5, np.float32)
    >>> may_be_dim(image, jl.Sensor(frames=16)), may_be_dim(image, jl.Sensor(frames=64, gain=2.0))
    (False, True)
    """
    return engine.may_be_dim(image, sensor_model(sensor), sensor.trials)
