"""The bits from before the window of a film's image.

The bits that leave the window are added up, as the last image shows their scene points. For the
next image, these sums are displaced along the motion, and fade a little. Where they agree with the
window, they are counted with it. So the time and the memory of an image stay the same, and the
counts of a still point tend to those of 3.5 windows.
"""

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.consistency import disagreement
from jotlight.motion.jots import SeenJots
from jotlight.motion.motion import Motion
from jotlight.motion.track import Paths

Image = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

_WINDOWS = 2.5
"""Number of windows after which bits count 1/e as much."""

_MAX_DISAGREEMENT, _MAX_IF_STILL = 1.2, 1.5
"""Largest disagreement at which remembered bits are counted. It is about 1 if they agree.

It may be larger for a scene that stands still, where no motion can be wrong.
"""

_MARGIN = 6
"""Distance in pixels from all pixels that disagree."""


class Memory:
    """The bits of a film from before its window.

    Parameters
    ----------
    window : int
        Number of frames of a window.
    """

    def __init__(self, window: int) -> None:
        self._window = window
        self._sums: list[Sums] = []
        """The sums of each channel, as the last image shows their scene points."""
        self._labels: npt.NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        self._time = 0.0

    def forget(self) -> None:
        """Forget all bits, because the motion is lost."""
        self._sums = []

    def recall(
        self, sums: list[Sums], trusted: Mask, motion: Motion, start: int, *, is_carried: bool
    ) -> list[Sums]:
        """Return the sums of a window with those that are remembered, where both agree.

        Only what agrees is kept.

        Parameters
        ----------
        sums : list of Sums
            The sums of each channel in the window.
        trusted : ndarray of bool, shape (H, W)
            The pixels that may be counted with remembered bits.
        motion : Motion
            The motion in the window.
        start : int
            The first frame of the window.
        is_carried : bool
            Whether the segments of the motion are those of the last image.
        """
        time, several = self._time - start, len(motion.nodes) > 1
        if not self._sums or time < 0 or (several and not is_carried):
            self.forget()
            return sums
        places = np.indices(motion.size, np.float32) + motion.at(time)
        fading = math.exp((time - motion.reference) / (_WINDOWS * self._window))
        recalled = [_displaced(each, places, fading) for each in self._sums]
        test = disagreement(Sums.total(sums), Sums.total(_rounded(each) for each in recalled))
        limit = _MAX_IF_STILL if motion.model == "none" else _MAX_DISAGREEMENT
        agrees = trusted & (test < limit)
        if several:
            agrees &= _nearest(self._labels, places) == motion.labels
        agrees = _without_margin(agrees)
        self._sums = [each.masked(agrees) for each in recalled]
        return [own + _rounded(old) for own, old in zip(sums, self._sums, strict=True)]

    def remember(self, leaving: list[Sums], motion: Motion, start: int) -> None:
        """Add the bits that leave the window with its first frames.

        Parameters
        ----------
        leaving : list of Sums
            The sums of these bits along the motion, for each channel.
        motion : Motion
            The motion in the window.
        start : int
            The first frame of the window.
        """
        if self._sums:
            leaving = [new + old for new, old in zip(leaving, self._sums, strict=True)]
        self._sums, self._labels, self._time = leaving, motion.labels, start + motion.reference


def sum_first(
    paths: Paths, step: int, masks: npt.NDArray[np.uint8], edges: npt.NDArray[np.intp]
) -> Sums:
    """Return the sums of the bits of the first frames that agree with the motion.

    Parameters
    ----------
    paths : Paths
        The paths over blocks of which one begins after these frames.
    step : int
        Number of the first frames.
    masks : ndarray of uint8, shape (n, H, ceil(W / 8))
        The pixels that agree in each of n blocks, packed.
    edges : ndarray of int, shape (n + 1,)
        The first frames of these n blocks, and the number of all frames.
    """
    first, width = paths.blocks.edges, paths.labels.shape[1]
    total = Sums.zeros(paths.blocks.size)
    for block in range(int(np.searchsorted(first, step))):
        of_mask = int(np.searchsorted(edges, first[block], "right")) - 1
        mask = np.unpackbits(masks[of_mask], axis=1, count=width).view(np.bool_)
        total += paths.sums(block).masked(mask)
    return total


def _displaced(sums: Sums, places: Image, fading: float) -> Sums:
    """Return sums at displaced places, times a factor, and 0 outside.

    All are interpolated by the same cubic splines, so that their ratios stay right.
    """
    height, width = sums.trials.shape
    limits = np.reshape([height - 1, width - 1], (2, 1, 1))
    inside = np.float32(fading) * ((places >= 0) & (places <= limits)).all(axis=0)
    trials = inside * np.maximum(_interpolated(sums.trials, places), 0)
    ones = np.clip(inside * _interpolated(sums.ones, places), 0, trials)
    jots = sums.jots
    if jots is not None:
        seen = np.stack([inside * _interpolated(each, places) for each in jots.sums])
        jots = SeenJots(jots.jots, seen)
    return dataclasses.replace(sums, ones=ones, trials=trials, jots=jots)


def _interpolated(values: npt.NDArray[np.generic], places: Image) -> Image:
    from scipy.ndimage import map_coordinates

    real = values.astype(np.float32)
    return np.asarray(map_coordinates(real, places, np.float32, order=3, mode="nearest"))


def _nearest(labels: npt.NDArray[np.uint8], places: Image) -> npt.NDArray[np.uint8]:
    """Return the labels at the pixels that are nearest to places."""
    rows, columns = (
        np.clip(np.rint(each), 0, length - 1).astype(np.intp)
        for each, length in zip(places, labels.shape, strict=True)
    )
    return np.asarray(labels[rows, columns])


def _without_margin(mask: Mask) -> Mask:
    """Return a mask without the pixels that are near others."""
    from scipy.ndimage import distance_transform_cdt

    if mask.all():
        return mask
    return np.asarray(distance_transform_cdt(mask, "taxicab") > _MARGIN)


def _rounded(sums: Sums) -> Sums:
    """Return sums of whole numbers of ones and trials."""
    trials = np.rint(sums.trials).astype(np.int32)
    ones = np.minimum(np.rint(sums.ones).astype(np.int32), trials)
    return dataclasses.replace(sums, ones=ones, trials=trials)
