"""Frames in the middle of a burst that are held out, and how merged counts predict them.

The prediction shows the quality of an image at the time that it shows, so it also notices a wrong
motion along which many bits agree.
"""

import dataclasses
import math
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.array_types import FloatImage
from jotlight.motion.counts.equivalent import (
    clip_probability,
    equivalent_sums,
    expected_probability,
)
from jotlight.motion.counts.frame_times import locate
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.scoring import template_network
from jotlight.motion.displacements.track import Paths
from jotlight.motion.labels import choose
from jotlight.motion.tiles import interpolate
from jotlight.networks.inference.trials_map import denoise_map

_CENTRAL, _ENOUGH_ONES = (8, 32), 100_000
"""Minimum and maximum number of frames in the middle. Every second one is held out in turn.

There are as many as have this number of ones together. But an eighth of all frames is enough.
"""


def central_frames(paths: Paths, total: Sums) -> range:
    """Return the frames in the middle that are held out, for the sums of all frames."""
    frames = len(paths.blocks.burst)
    enough = math.ceil(_ENOUGH_ONES / max(float(total.ones.sum()) / frames, 1e-9))
    return frames_around(paths, min(int(np.clip(enough, *_CENTRAL)), frames // 8))


def frames_around(paths: Paths, length: int) -> range:
    """Return the frames around the reference time, two or more."""
    frames, half = len(paths.blocks.burst), max(1, length // 2)
    middle = int(np.clip(round(paths.reference), half, max(half, frames - half)))
    return range(middle - half, min(middle + half, frames))


def count_in_place(paths: Paths, window: range) -> Sums:
    """Return the sums of frames without motion."""
    still = np.zeros((2, *paths.tracks[0].nodes.shape[2:]), np.float32)
    return paths.blocks.count(window, (still, still), (window.start, window.stop))


def held_out_likelihood(paths: Paths, total: Sums, held: range) -> float:
    """Return the log-likelihood in nats of some frames, predicted without them.

    Parameters
    ----------
    paths : Paths
        The motion.
    total : Sums
        The merged counts of all frames along it.
    held : range
        The frames, such as the :func:`central_frames`. Every second one is held out in turn.
    """
    return sum(Fold.of(paths, total, held[start::2]).likelihood() for start in (0, 1))


@dataclasses.dataclass(frozen=True)
class Fold:
    """Frames that are held out, and how the merged counts predict them."""

    held: Sums
    """The sums of these frames without motion."""
    frames: list[Sums]
    """Each frame."""
    logarithms: list[tuple[FloatImage, FloatImage]]
    """The logarithms of the probabilities of a one and of a zero in each frame."""
    compared: npt.NDArray[np.bool_]
    """The pixels (H, W) whose predictions are compared."""
    threads: int | None
    """Number of threads. None: all."""

    @classmethod
    def of(
        cls, paths: Paths, total: Sums, held: range, compared: npt.NDArray[np.bool_] | None = None
    ) -> Self:
        """Return the fold that holds out some frames. By default, all pixels are compared."""
        blocks = paths.blocks
        moved = [blocks.count(held, track.nodes, blocks.centers) for track in paths.tracks]
        own = Sums.select(moved, paths.labels) if len(moved) > 1 else moved[0]
        # Bits that disagree with the others were not merged.
        trials = np.minimum(own.trials, total.trials)
        ones = np.clip(own.ones, total.ones - (total.trials - trials), total.ones)
        merged = _estimate(total.without(np.minimum(ones, trials), trials), blocks.threads)
        frames = [count_in_place(paths, range(time, time + 1)) for time in held]
        predicted = [
            _logarithms(frame, _moved(merged, paths, time))
            for frame, time in zip(frames, held, strict=True)
        ]
        if compared is None:
            compared = np.ones(blocks.size, bool)
        frames = [frame.masked(compared) for frame in frames]
        return cls(count_in_place(paths, held), frames, predicted, compared, blocks.threads)

    def likelihood(self) -> float:
        """Return the log-likelihood of the frames in nats."""
        pairs = zip(self.frames, self.logarithms, strict=True)
        return sum(_sum_over_bits(frame, *of_bits) for frame, of_bits in pairs)

    def gain(self, window: Sums) -> tuple[float, float]:
        """Return by how many nats a window predicts the frames better, and the error."""
        others = window.without(self.held.ones, self.held.trials)
        estimate = _estimate(others.masked(self.compared), self.threads)
        one, zero = _logarithms(self.held, estimate)
        gain, variance = 0.0, 0.0
        for frame, logarithms in zip(self.frames, self.logarithms, strict=True):
            of_one, of_zero = one - logarithms[0], zero - logarithms[1]
            gain += _sum_over_bits(frame, of_one, of_zero)
            p = np.exp(one)
            variance += float((frame.trials * p * (1 - p) * (of_one - of_zero) ** 2).sum())
        return gain, variance**0.5


def _sum_over_bits(sums: Sums, of_one: FloatImage, of_zero: FloatImage) -> float:
    """Return the sum of a value of each one and of each zero, which are images (H, W)."""
    return float((sums.ones * of_one + (sums.trials - sums.ones) * of_zero).sum())


def _logarithms(sums: Sums, estimate: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Return the logarithms of the probabilities of a one and of a zero, (H, W)."""
    p = expected_probability(sums, estimate).astype(np.float64)
    return np.log(p), np.log(1 - p)


def _moved(image: FloatImage, paths: Paths, time: float) -> FloatImage:
    """Return an image (H, W) of the reference time as it is seen at another time."""
    (index,), (place,) = locate(np.array([float(time)]), paths.blocks.centers)
    nodes = [
        track.nodes[index] + place * (track.nodes[index + 1] - track.nodes[index])
        for track in paths.tracks
    ]
    fields = [interpolate(each, paths.blocks.size) for each in nodes]
    displacement = choose(paths.labels, fields)
    # The displacement of a pixel is nearly that of the scene point that it shows.
    rows, columns = (
        np.clip(np.rint(pixels - moved), 0, length - 1).astype(np.intp)
        for pixels, moved, length in zip(
            np.indices(image.shape), displacement, image.shape, strict=True
        )
    )
    return np.asarray(image[rows, columns])


def _estimate(sums: Sums, threads: int | None) -> FloatImage:
    """Return the probabilities that the network estimates for the median jot, (H, W)."""
    sums = equivalent_sums(sums)
    ones, trials = sums.ones.astype(np.float32), sums.trials.astype(np.float32)
    return clip_probability(denoise_map(template_network(), ones, trials, threads=threads))
