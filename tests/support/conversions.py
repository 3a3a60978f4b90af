"""Helpers of the tests that convert captures."""

import numpy as np

from jotlight.formats.registry import WRITERS

BITS = [name for name, target in WRITERS.items() if target.bits]
COUNTS = [name for name, target in WRITERS.items() if target.counts]
NEEDS = {"hdf5": "h5py", "zarr": "zarr"}


def path_for(folder, name, stem="out"):
    """Return the path of an output in a format."""
    extensions = WRITERS[name].extensions
    return folder / (stem + (extensions[0] if extensions else ""))


def random_frames(frames, height, width):
    """Return frames of bool, three tenths of them True."""
    return np.random.default_rng(0).random((frames, height, width)) < 0.3


def files(folder):
    """Return the relative paths of everything below a folder."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
