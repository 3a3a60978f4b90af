"""Counts of dark and flat captures."""

import numpy as np

SHAPE = (160, 160)
"""Size of the sensor in jots."""


def counts(rng, rates, frames, threshold=1):
    """Return counts of jots at the given rates of detections per frame."""
    chance = 1 - np.exp(-rates)
    if threshold == 2:
        chance -= rates * np.exp(-rates)
    return rng.binomial(frames, chance)


def flat_scene(rng, spread, shape=SHAPE, frames=4000):
    """Return dark counts, and the light, the response, and the dark rates of all jots."""
    y, x = np.mgrid[: shape[0], : shape[1]] / shape[0]
    light = 0.7 * (1 + 0.3 * x - 0.3 * (y - 0.5) ** 2)
    relative = np.clip(1 + spread * rng.standard_normal(shape), 0.3, 2)
    dark = rng.gamma(4, 0.002, shape)
    return counts(rng, dark, frames), light, relative, dark
