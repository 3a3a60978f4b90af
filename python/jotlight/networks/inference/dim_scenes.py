"""Dim scenes: a K-conditioned network sees several of their trials as one.

In a dim scene, ones are rare. Then c trials are like one trial whose probability of a one is c
times as large: in both cases, the number of ones is nearly a Poisson number. Networks were trained
for brighter scenes, and hardly any probability that they return is below 1e-4.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jotlight.array_types import Image
from jotlight.estimators.trial_levels import LocalTrials
from jotlight.networks.inference.dark_regions import match_dark_regions
from jotlight.networks.inference.engine_backed import EngineBacked
from jotlight.networks.inference.trials_map import denoise_fractions
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.parameters.response import detection_probability
from jotlight.sensing.sensor import Sensor

_MIN_TRIALS = 4
"""Smallest number of trials that remains."""

_ROOM = 4.0
"""Smallest ratio of combined trials to ones, which nearly all pixels keep."""

_NEARLY_ALL = 0.999
"""Fraction of the pixels for which there is this room."""

_MIN_FACTOR = 1.5
"""Smallest number of trials per combined trial."""

_USED, _FULL = 0.25, 0.5
"""Probability of a one of combined trials up to which only they are used, and from which they are
not used. In between, both estimates have weights."""

_NOISE = 1.0
"""The brightest fractions are assumed to exceed the estimate by this number of standard
deviations."""

_DIM = 1 / (_ROOM * _MIN_FACTOR)
"""Fraction of ones of the brightest pixels below which trials may be combined."""


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
    bright = float(np.quantile(fraction, _NEARLY_ALL))
    typical = float(np.median(trials))
    factor = min(typical / max(_MIN_TRIALS, smallest), 1 / max(_ROOM * bright, 1 / typical))
    return factor if factor >= _MIN_FACTOR else 1.0


def may_be_dim(image: Image, sensor: Sensor, trials: float) -> bool:
    """Return whether an estimate is so dark that trials may be combined.

    Parameters
    ----------
    image : ndarray of float32, shape (H, W)
        The estimate.
    sensor : Sensor
        The sensor.
    trials : float
        The number of trials of a pixel, or infinity if pixels have different ones.

    Examples
    --------
    >>> image = np.full((4, 4), 0.5, np.float32)
    >>> may_be_dim(image, jl.Sensor(), 16), may_be_dim(image, jl.Sensor(frames=64, gain=2.0), 64)
    (False, True)
    """
    if trials < _MIN_FACTOR * _MIN_TRIALS:
        return False
    efficiency, dark_counts = reference_jot(sensor)

    def is_dim(intensity: float) -> bool:
        rate = efficiency * sensor.light_per_intensity * intensity + dark_counts
        p = float(detection_probability(sensor.threshold, rate))
        # The fractions of nearly all pixels are below a limit that is above p by this noise.
        return p + _NOISE * math.sqrt(p * (1 - p) / trials) < _DIM

    # The mean takes less time, and most scenes are too bright.
    return is_dim(float(image.mean())) and is_dim(float(np.quantile(image, _NEARLY_ALL)))


class Combined(NamedTuple):
    """The trials of a dim scene, several of which are one."""

    fraction: Image
    """Fractions of ones, (H, W)."""
    trials: LocalTrials
    """Their number, for the whole image or for each pixel."""
    factor: np.float32
    """c: the number of trials per combined trial."""


def combine(fraction: Image, trials: LocalTrials, smallest: int = 1) -> Combined | None:
    """Return the combined trials of an image, or None for a scene that is not dim.

    The parameters are those of :func:`trials_per_combined`.
    """
    if (factor := trials_per_combined(fraction, trials, smallest)) == 1:
        return None
    number: LocalTrials
    if isinstance(trials, int):
        number = max(round(trials / factor), _MIN_TRIALS, smallest)
        factor = trials / number
    else:
        number = np.maximum(trials / np.float32(factor), 1)
    scaled = np.minimum(fraction * np.float32(factor), 1)
    return Combined(scaled, number, np.float32(factor))


def weight_of_combined(probability: Image, fraction: Image) -> Image:
    """Return the weight of combined trials in each pixel, from 0 to 1, (H, W).

    The other estimate is that of all trials. In bright pixels, such as stars, combined trials are
    nearly all ones and say nothing. Around them, they are better: a network for all trials may
    return a sky that is far too bright.

    Parameters
    ----------
    probability : ndarray of float32, shape (H, W)
        The estimated probability of a one of combined trials.
    fraction : ndarray of float32, shape (H, W)
        Their fractions of ones, which networks may blur.

    Examples
    --------
    >>> probability = np.array([[0.01, 0.375, 0.9, 0.01]], np.float32)
    >>> weight_of_combined(probability, np.array([[0, 0.5, 1, 1]], np.float32)).tolist()
    [[1.0, 0.5, 0.0, 0.0]]
    """
    bright = np.maximum(probability, fraction / 2)
    return np.asarray(np.clip((_FULL - bright) / (_FULL - _USED), 0, 1), np.float32)


def denoise_dim(
    network: EngineBacked,
    fractions: Image,
    trials: Sequence[LocalTrials],
    threshold: int,
    smallest: int = 1,
    *,
    threads: int | None = None,
) -> list[tuple[Image, Image] | None]:
    """Return the probabilities of a one in dim scenes, and their weights, (H, W) each.

    It is None for other scenes.

    Parameters
    ----------
    network : Network
        A K-conditioned network.
    fractions : ndarray of float32, shape (N, H, W)
        Fractions of ones.
    trials : sequence of int or ndarray of float32, shape (H, W)
        The local number of trials of each image.
    threshold : int
        The threshold q.
    smallest : int
        The smallest K of the network.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    each = [combine(*image, smallest) for image in zip(fractions, trials, strict=True)]
    dim = [part for part in each if part is not None]
    if not dim:
        return [None] * len(each)
    scaled = np.stack([part.fraction for part in dim])
    found = denoise_fractions(network, scaled, [part.trials for part in dim], threads=threads)
    better = iter(
        (
            match_dark_regions(image, part.fraction, part.trials, threshold, threads) / part.factor,
            weight_of_combined(image, part.fraction),
        )
        for image, part in zip(found, dim, strict=True)
    )
    return [None if part is None else next(better) for part in each]
