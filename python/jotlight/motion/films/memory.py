"""The bits from before the window of a film's image.

Bits that leave the window are added up at the pixels where the last image shows their scene points.
For each image, these sums move along the motion and fade. Where they agree with the window, they
are counted. So each image takes the same time, and a still point has up to 3.5 times the trials of
a window.
"""

import dataclasses
import functools
import math
import operator
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image, Mask
from jotlight.estimators.merge_readings import round_ones
from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.counts.jots import SeenJots
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import disagreement
from jotlight.motion.displacements.track import Paths
from jotlight.motion.merge import as_paths, each_channel
from jotlight.motion.motion import Motion

_WINDOWS = 2.5
"""Number of windows after which bits count 1/e as much."""

_MAX_DISAGREEMENT, _MAX_IF_STILL = 1.2, 1.5
"""Largest disagreement at which remembered bits are counted. It is about 1 if they agree.

It may be larger for a scene that stands still, where no motion can be wrong.
"""

_MARGIN = 6
"""Distance from all pixels that disagree, in steps from pixel to pixel along rows and columns."""

_LITTLE = np.float32(0.1)
"""Number of trials up to which a pixel has none."""

_RENUMBERED = 2
"""Segments are renumbered if other numbers agree at more than this many times as many pixels."""

_MAX_CHANGE = 0.03
"""Largest relative change of the mean number of ones. If a scene becomes brighter or darker, the
remembered bits would be wrong everywhere."""


def remembers(memory: bool | None, window: int, step: int, *, causal: bool, upsample: int) -> bool:
    """Return whether a film counts bits from before its windows.

    The parameters are those of :func:`jotlight.film`. A motion states nothing about the
    time before its window, so the last image must show a time within the next window.

    Raises
    ------
    ValueError
        When the film must remember, but has a finer grid, or a step that is too large.
    """
    if memory and upsample > 1:
        raise ValueError(f"memory: expected False with upsample={upsample}, got True")
    largest = window - 1 if causal else window // 2
    if memory and step > largest:
        smaller = f"pass step={largest} (--step {largest}) or less, or " if largest else ""
        raise ValueError(
            f"memory: expected a step of at most {largest} for windows of {window}, got {step}; "
            f"{smaller}leave out memory=True (--memory)"
        )
    wanted = causal and upsample == 1 if memory is None else memory
    return wanted and step <= largest


class Memory:
    """The bits of a film from before its window.

    Parameters
    ----------
    window : int
        Number of frames of a window.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """

    def __init__(self, window: int, threads: int | None = None) -> None:
        self._window, self._threads = window, threads
        self._sums: list[Sums] = []
        """The sums of each channel, as the last image shows their scene points."""
        self._labels: npt.NDArray[np.uint8] = np.zeros((0, 0), np.uint8)
        self._fields, self._start, self._time = 0, 0, 0.0

    def forget(self) -> None:
        """Forget all bits, because the motion is lost."""
        self._sums = []

    def recall(self, sums: list[Sums], trusted: Mask, motion: Motion, start: int) -> list[Sums]:
        """Return the sums of a window, plus the remembered ones where they agree.

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
        """
        time, several = self._time - start, len(motion.nodes) > 1
        if not self._sums or time < 0 or (several and len(motion.nodes) != self._fields):
            self.forget()
            return sums
        places = np.indices(motion.size, np.float32) + motion.at(time)
        fading = math.exp((self._start - start) / (_WINDOWS * self._window))
        recalled = [_displaced(each, places, fading) for each in self._sums]
        own = functools.reduce(operator.add, [each.real() for each in sums])
        old = functools.reduce(operator.add, recalled)
        limit = _MAX_IF_STILL if motion.model == "none" else _MAX_DISAGREEMENT
        agrees = disagreement(own, old, self._threads) < limit
        if several:
            agrees &= _same_segments(_nearest(self._labels, places), motion.labels)
        # Flagged regions have margins of their own.
        agrees = _without_margin(agrees) & trusted
        if not _as_bright(own, old, agrees):
            self.forget()
            return sums
        self._sums = [each.masked(agrees) for each in recalled]
        return [_whole(new.real() + kept) for new, kept in zip(sums, self._sums, strict=True)]

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
            leaving = [new.real() + kept for new, kept in zip(leaving, self._sums, strict=True)]
        self._sums, self._labels, self._fields = leaving, motion.labels, len(motion.nodes)
        self._start, self._time = start, start + motion.reference


def sum_leaving(paths: Paths, consistent: Consistent, motion: Motion, step: int) -> list[Sums]:
    """Return the sums of the bits of the first frames that agree with a motion, for each channel.

    Parameters
    ----------
    paths : Paths
        The paths of the pixels in the window.
    consistent : Consistent
        The bits that agree with them.
    motion : Motion
        The same motion.
    step : int
        Number of the first frames.
    """
    edges = paths.blocks.edges
    cut = dataclasses.replace(paths.blocks, edges=np.union1d(edges, step))
    channels = each_channel(as_paths(motion, cut))
    return [_sum_first(each, step, consistent, edges) for each in channels]


def _sum_first(
    paths: Paths, step: int, consistent: Consistent, edges: npt.NDArray[np.intp]
) -> Sums:
    """Return the sums of the bits of the first frames that agree with the motion.

    A block of `paths` ends after these frames. The blocks of `consistent` have the given edges, and
    may be longer.
    """
    first = paths.blocks.edges
    total = Sums.zeros(paths.blocks.size)
    for block in range(int(np.searchsorted(first, step))):
        tested = int(np.searchsorted(edges, first[block], "right")) - 1
        total += paths.sums(block).masked(consistent.mask(tested))
    return total


def _displaced(sums: Sums, places: Image, fading: float) -> Sums:
    """Return sums at displaced places, times a factor, and 0 outside.

    All are interpolated by the same cubic splines, so that their ratios stay right.
    """
    from scipy.ndimage import maximum_filter

    height, width = sums.trials.shape
    limits = np.reshape([height - 1, width - 1], (2, 1, 1))
    inside = np.float32(fading) * ((places >= 0) & (places <= limits)).all(axis=0)
    trials = np.maximum(_interpolated(sums.trials, places), 0)
    # Cubic splines swing beyond the edges of regions without bits.
    most = _nearest(maximum_filter(sums.trials, 3), places)
    inside *= (trials > _LITTLE) * np.minimum(1, most / np.maximum(trials, _LITTLE))
    trials *= inside
    ones = np.clip(inside * _interpolated(sums.ones, places), 0, trials)
    jots = sums.jots
    if jots is not None:
        seen = np.stack([inside * _interpolated(each, places) for each in jots.sums])
        # The means stay within the range of the maps.
        maps = jots.jots.maps[:2, jots.jots.maps[2] > 0]
        least, largest = (each[:, None, None] * trials for each in (maps.min(1), maps.max(1)))
        jots = SeenJots(jots.jots, np.clip(seen, least, largest))
    return dataclasses.replace(sums, ones=ones, trials=trials, jots=jots)


def _interpolated(values: npt.NDArray[np.generic], places: Image) -> Image:
    from scipy.ndimage import map_coordinates

    real = values.astype(np.float32)
    return np.asarray(map_coordinates(real, places, np.float32, order=3, mode="nearest"))


def _nearest(values: npt.NDArray[Any], places: Image) -> npt.NDArray[Any]:
    """Return the values at the pixels that are nearest to places."""
    rows, columns = (
        np.clip(np.rint(each), 0, length - 1).astype(np.intp)
        for each, length in zip(places, values.shape, strict=True)
    )
    return np.asarray(values[rows, columns])


def _same_segments(before: npt.NDArray[np.uint8], now: npt.NDArray[np.uint8]) -> Mask:
    """Return whether pixels follow the same segments as before, (H, W).

    A carried motion numbers them as before, but a fresh one may not. Then another numbering agrees
    at many more pixels.
    """
    from scipy.optimize import linear_sum_assignment

    number = 1 + int(max(before.max(), now.max()))
    pairs = np.ravel(before).astype(np.intp) * number + np.ravel(now)
    shared = np.bincount(pairs, minlength=number**2).reshape(number, number)
    old, new = linear_sum_assignment(shared, maximize=True)
    is_renumbered = shared[old, new].sum() > _RENUMBERED * np.trace(shared)
    numbers = new if is_renumbered else old
    return np.asarray(numbers[before] == now)


def _as_bright(own: Sums, old: Sums, pixels: Mask) -> bool:
    """Return whether the mean numbers of ones in some pixels are almost equal."""
    expected = old.trials * (own.ones / np.maximum(own.trials, 1))
    total = float(expected[pixels].sum())
    return abs(float(old.ones[pixels].sum()) - total) <= _MAX_CHANGE * total


def _without_margin(mask: Mask) -> Mask:
    """Return a mask without the pixels that are near others."""
    from scipy.ndimage import distance_transform_cdt

    if mask.all():
        return mask
    return np.asarray(distance_transform_cdt(mask, "taxicab") > _MARGIN)


def _whole(sums: Sums) -> Sums:
    """Return sums of whole numbers of ones, with the same fractions of ones."""
    ones, trials = round_ones(sums.ones.astype(np.float64), sums.trials.astype(np.float64))
    jots = sums.jots
    if jots is not None:
        jots = jots * (trials / np.maximum(sums.trials, _LITTLE))
    return dataclasses.replace(sums, ones=ones, trials=trials, jots=jots)
