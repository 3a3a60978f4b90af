"""Random frames and bits."""

import numpy as np

import jotlight as jl


def random_frames(shape, seed=0, share=0.4):
    """Return booleans of which this share is True."""
    return np.random.default_rng(seed).random(shape) < share


def random_bits(shape, sensor=None, seed=0):
    """Return bits of which half are 1."""
    return jl.Bits.from_array(random_frames(shape, seed, share=0.5), sensor)
