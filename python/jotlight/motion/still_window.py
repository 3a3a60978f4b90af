"""A short window without motion, which is better than merged counts where the motion is wrong."""

import dataclasses
import math
from typing import Self

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.estimators.planned_motion import MIN_FRAMES
from jotlight.motion.equivalent import clip_probability, equivalent_sums, expected_probability
from jotlight.motion.frame_times import locate
from jotlight.motion.scoring import template_network
from jotlight.motion.sums import Sums
from jotlight.motion.tiles import interpolate
from jotlight.motion.track import Paths
from jotlight.networks.trials_map import denoise_map

Probability = npt.NDArray[np.floating]

_FRACTIONS = (1, 2, 4, 8, 16, 32)
"""The windows have all frames, a half, a quarter, and so on."""

_CENTRAL, _ENOUGH_ONES = (8, 32), 100_000
"""Minimum and maximum number of frames in the middle. Every second one is held out in turn.

There are as many as have this number of ones together. But an eighth of all frames is enough.
"""

_MIN_LEAD, _ONES = 3.5, 25_000
"""By 3.5 standard deviations, merged counts must predict 25,000 ones better than each window.

If there are fewer ones, the standard deviation is larger in relation to what a motion gains.

In simulations, merged counts that were 0.16 dB worse led by 2.7, and better ones by 4.4 or more.
"""

_SMOOTHING = 0.25, 0.5, 0.25
"""Weights of the gains of windows of neighboring lengths."""


def find_window(paths: Paths, total: Sums) -> range | None:
    """Return the frames whose sum without motion is better than the merged counts, or None.

    Of some frames in the middle, every second one is held out, and then the others. A window
    predicts that these frames are alike. The merged counts without them predict each one, moved
    along the motion. So a wrong motion is noticed although single frames have few bits. If the
    merged counts are not clearly better, the window is chosen that predicts the bits best.

    If nothing moves, the merged counts are those of all frames in place, without bits that
    disagree. The windows are shorter then, and there is none if there are few frames or few bits.

    Parameters
    ----------
    paths : Paths
        The motion.
    total : Sums
        The merged counts of all frames.
    """
    frames = len(paths.blocks.burst)
    moves = any(track.nodes.any() for track in paths.tracks)
    ones_per_frame = max(float(total.ones.sum()) / frames, 1e-9)
    enough = math.ceil(_ENOUGH_ONES / ones_per_frame)
    central = _window(paths, min(int(np.clip(enough, *_CENTRAL)), frames // 8))
    if not moves and (frames < MIN_FRAMES or len(central) * ones_per_frame < _ONES):
        return None
    folds = [_Fold.of(paths, total, central[start::2]) for start in (0, 1)]
    fractions = _FRACTIONS if moves else _FRACTIONS[1:]
    lengths = sorted({max(len(central), frames // fraction) for fraction in fractions})
    windows = [_window(paths, length) for length in lengths]
    gains, errors = np.transpose([_gain_of(count_window(paths, each), folds) for each in windows])
    lead = -(_smooth(gains) / np.maximum(errors, 1e-9)).max()
    ones = sum(int(fold.held.ones.sum()) for fold in folds)
    needed = _MIN_LEAD * min(1.0, math.sqrt(ones / _ONES))
    return windows[int(np.argmax(gains))] if lead < needed else None


def report_window(window: range, model: str) -> None:
    """Warn that a window replaces the counts that were merged along a motion of a model."""
    reason = "the motion does not explain the scene clearly better than no motion"
    if model == "none":
        reason = "the frames differ although the motion is none"
    warn(f"{reason}; only {len(window)} frames are used, and all pixels are flagged")


def _smooth(gains: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return gains that are averaged with those of the next shorter and the next longer window.

    The quality has one maximum, so the average has less noise than the gain of one window.

    Examples
    --------
    >>> _smooth(np.array([4.0, 8.0, 4.0])).round(2).tolist()
    [5.33, 6.0, 5.33]
    """
    weights = np.convolve(np.ones_like(gains), _SMOOTHING)[1:-1]
    return np.asarray(np.convolve(gains, _SMOOTHING)[1:-1] / weights)


@dataclasses.dataclass(frozen=True)
class _Fold:
    """Frames that are held out, and how the merged counts predict them."""

    held: Sums
    """The sums of these frames without motion."""
    frames: list[Sums]
    """Each frame."""
    logarithms: list[tuple[Probability, Probability]]
    """The logarithms of the probabilities of a one and of a zero in each frame."""

    @classmethod
    def of(cls, paths: Paths, total: Sums, held: range) -> Self:
        """Return the fold that holds out some frames."""
        blocks = paths.blocks
        moved = [blocks.count(held, track.nodes, blocks.centers) for track in paths.tracks]
        own = Sums.select(moved, paths.labels) if len(moved) > 1 else moved[0]
        # Bits that disagree with the others were not merged.
        trials = np.minimum(own.trials, total.trials)
        ones = np.clip(own.ones, total.ones - (total.trials - trials), total.ones)
        merged = _estimate(total.without(np.minimum(ones, trials), trials))
        frames = [count_window(paths, range(time, time + 1)) for time in held]
        predicted = [
            _logarithms(frame, _moved(merged, paths, time))
            for frame, time in zip(frames, held, strict=True)
        ]
        return cls(count_window(paths, held), frames, predicted)

    def gain(self, window: Sums) -> tuple[float, float]:
        """Return by how many nats a window predicts the frames better, and the error."""
        estimate = _estimate(window.without(self.held.ones, self.held.trials))
        one, zero = _logarithms(self.held, estimate)
        gain, variance = 0.0, 0.0
        for frame, logarithms in zip(self.frames, self.logarithms, strict=True):
            of_one, of_zero = one - logarithms[0], zero - logarithms[1]
            gain += float((frame.ones * of_one + (frame.trials - frame.ones) * of_zero).sum())
            p = np.exp(one)
            variance += float((frame.trials * p * (1 - p) * (of_one - of_zero) ** 2).sum())
        return gain, variance**0.5


def _gain_of(window: Sums, folds: list[_Fold]) -> tuple[float, float]:
    """Return by how many nats a window is better than the merged counts, and the error."""
    gains = [fold.gain(window) for fold in folds]
    return sum(gain for gain, _ in gains), math.hypot(*(error for _, error in gains))


def _logarithms(sums: Sums, estimate: Probability) -> tuple[Probability, Probability]:
    """Return the logarithms of the probabilities of a one and of a zero, (H, W)."""
    p = expected_probability(sums, estimate).astype(np.float64)
    return np.log(p), np.log(1 - p)


def _moved(image: Probability, paths: Paths, time: float) -> Probability:
    """Return an image (H, W) of the reference time as it is seen at another time."""
    (index,), (place,) = locate(np.array([float(time)]), paths.blocks.centers)
    nodes = [
        track.nodes[index] + place * (track.nodes[index + 1] - track.nodes[index])
        for track in paths.tracks
    ]
    fields = [interpolate(each, paths.blocks.size) for each in nodes]
    displacement = np.choose(paths.labels, fields) if len(fields) > 1 else fields[0]
    # The displacement of a pixel is nearly that of the scene point that it shows.
    rows, columns = (
        np.clip(np.rint(pixels - moved), 0, length - 1).astype(np.intp)
        for pixels, moved, length in zip(
            np.indices(image.shape), displacement, image.shape, strict=True
        )
    )
    return np.asarray(image[rows, columns])


def _window(paths: Paths, length: int) -> range:
    """Return the frames around the reference time, two or more."""
    frames, half = len(paths.blocks.burst), max(1, length // 2)
    middle = int(np.clip(round(paths.reference), half, max(half, frames - half)))
    return range(middle - half, min(middle + half, frames))


def count_window(paths: Paths, window: range) -> Sums:
    """Return the sums of frames without motion."""
    still = np.zeros((2, *paths.tracks[0].nodes.shape[2:]), np.float32)
    return paths.blocks.count(window, (still, still), (window.start, window.stop))


def _estimate(sums: Sums) -> Probability:
    """Return the probabilities that the network estimates for the reference jot, (H, W)."""
    sums = equivalent_sums(sums)
    ones, trials = sums.ones.astype(np.float32), sums.trials.astype(np.float32)
    return clip_probability(denoise_map(template_network(), ones, trials))
