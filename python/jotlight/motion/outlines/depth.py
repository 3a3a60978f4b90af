"""Depth: which segments are in front of others, and which pixels they cover.

The tracks of segments are in their order from back to front. In a block of frames, a position shows
the foremost segment that covers it. So the bits along the track of an object decide whether a pixel
belongs to it: either they show the same point of the object in all blocks, or different points of
what is behind it. Both are known from other blocks.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Image, Mask
from jotlight.blur import blur
from jotlight.motion.counts.equivalent import equivalent_sums
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.scoring import make_template
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.outlines.short_outlines import shortest_outlines

_SWEEPS = 3
"""Number of times that the outlines of all objects are found from those before."""

_MAX_BLOCKS = 32
"""Maximum number of blocks that are compared."""

_LENGTH = 2.0
"""Cost of an outline per pixel of its length, in nats."""

_NOISE = 0.1
"""Loss in nats of a bit that a template with one trial predicts, because the template is noisy."""

_SHARE = 0.05
"""Fraction of the mean gain of an object that a pixel must gain."""

_SPREAD = 3.0
"""Standard deviation of the filter that shows where an object gains clearly, in pixels."""

_NEAR = 0.1
"""Distance from the reference time, as a fraction of all frames, in which an object is there."""

_EVIDENCE = np.float32(1.0)
"""Gain in nats that a pixel must have by another segment than the one that is known."""

_UNKNOWN = np.float32(0.3)
"""Gain in nats of an object at a pixel where no bit has shown what would be behind it."""


def order_by_depth(sizes: npt.ArrayLike) -> npt.NDArray[np.intp]:
    """Return the order of segments from back to front: the more pixels, the farther back.

    Examples
    --------
    >>> order_by_depth([20, 500, 80]).tolist()
    [1, 2, 0]
    """
    return np.argsort(-np.asarray(sizes), kind="stable")


def refine_outlines(paths: Paths, *, are_known: bool = False) -> Paths:
    """Return paths whose pixels follow the segment that explains the bits of all blocks best.

    The first segment is where no other one is. The gain of another one at a pixel is that of the
    log-likelihood of the bits along its track, compared with what would be there without it. The
    templates are those of other blocks. Each pixel of the length of an outline costs 2 nats.

    Parameters
    ----------
    paths : Paths
        The tracks, and a first guess of the labels. Pixels that follow free tracks keep them.
    are_known : bool
        Whether the labels are known from other bits, so that a pixel must gain 1 nat by another
        one.
    """
    before = paths.labels if are_known else None
    opaque = len(paths.tracks) - paths.free
    for _ in range(_SWEEPS if opaque > 1 else 0):
        labels = np.where(paths.labels < opaque, np.uint8(0), paths.labels)
        for segment, gain in enumerate(object_gains(paths), 1):
            expected = None if before is None else before == segment
            pixels = gain.pixels(paths.labels == segment, expected)
            labels[pixels & (paths.labels < opaque)] = segment
        if (labels == paths.labels).all():
            break
        paths = dataclasses.replace(paths, labels=labels)
    return paths


@dataclasses.dataclass(frozen=True)
class Gain:
    """By how much an object explains the bits better than what would be there without it."""

    nats: Image
    """The gain at each pixel in nats, (H, W)."""
    known: Image
    """Fraction of the bits for which it is known what would be there, (H, W)."""
    threads: int | None = None
    """The number of threads. Default: the number of cores."""

    def net(self, pixels: Mask) -> float:
        """Return the gain of pixels in nats, without the cost of their outline."""
        length = (pixels[1:] != pixels[:-1]).sum() + (pixels[:, 1:] != pixels[:, :-1]).sum()
        return float(self._with_unknown()[pixels].sum()) - _LENGTH * float(length)

    def pixels(self, before: Mask | None = None, expected: Mask | None = None) -> Mask:
        """Return the pixels of the object.

        `before` are those that it had in the sweep before. `expected` are those that it has by
        other bits. A pixel only differs from them by clear evidence.

        Where object and background are smooth, the gain is about 0. So a pixel must gain more than
        a fraction of what the clear pixels of the object gain.
        """
        clear = np.maximum(blur(self.nats, _SPREAD, self.threads), 0)
        clear *= clear > clear.max() / 2 if before is None else before
        usual = float((clear**2).sum()) / max(float(clear.sum()), 1e-9)
        needed = np.float32(_SHARE * usual) * self.known
        gain = self._with_unknown() - needed
        if expected is not None:
            gain += np.where(expected, _EVIDENCE, -_EVIDENCE)
        return shortest_outlines(gain, _LENGTH, self.threads)

    def _with_unknown(self) -> Image:
        """Return the gain with that of pixels behind which nothing was seen."""
        return self.nats + _UNKNOWN * (1 - self.known)


def without_absent(paths: Paths) -> Paths:
    """Return paths without the pixels of objects that are not there at the reference time.

    There, the bits along the track of such an object show the background, of which it has hidden
    nothing.
    """
    within = len(paths.blocks.burst) * _NEAR
    for segment in range(1, len(paths.tracks) - paths.free):
        pixels = paths.labels == segment
        rest = dataclasses.replace(paths, labels=np.where(pixels, np.uint8(0), paths.labels))
        if pixels.any():
            gain = ComparedBits.of(rest).gain(segment, within)
            if gain.nats[pixels].sum() <= 0:
                paths = rest
    return paths


def object_gains(paths: Paths) -> list[Gain]:
    """Return the gains of all segments but the first one."""
    bits = ComparedBits.of(paths)
    return [bits.gain(segment) for segment in range(1, len(bits.sums))]


@dataclasses.dataclass(frozen=True)
class ComparedBits:
    """The bits along the tracks of all segments, and what templates predict about them."""

    paths: Paths
    sums: list[list[Sums]]
    """Those of some blocks along each track."""
    templates: list[tuple["_Predicted", "_Predicted"]]
    """For each segment, the templates for blocks with even numbers and for those with odd ones."""

    @classmethod
    def of(cls, paths: Paths) -> "ComparedBits":
        """Return the bits along all tracks of segments."""
        bits = cls(dataclasses.replace(paths, tracks=[]), [], [])
        number = len(paths.tracks) - paths.free
        for segment in range(number):
            seen = [~paths.covered(segment, block) for block in _compared(paths)]
            bits = bits.with_track(paths.tracks[segment], seen)
        return bits

    def with_track(self, track: Track, visible: Sequence[Mask] | None = None) -> "ComparedBits":
        """Return these bits and those along a further track, which may be hidden in some blocks."""
        paths = dataclasses.replace(self.paths, tracks=[*self.paths.tracks, track], free=0)
        sums = [track.sums(block) for block in _compared(paths)]
        seen = sums
        if visible is not None:
            seen = [each.masked(pixels) for each, pixels in zip(sums, visible, strict=True)]
        threads = paths.blocks.threads
        total = functools.partial(Sums.total, threads=threads)
        even, odd = (_Predicted.of(total(seen[1 - half :: 2]), threads) for half in (0, 1))
        return ComparedBits(paths, [*self.sums, sums], [*self.templates, (even, odd)])

    def gain(self, segment: int, within: float = np.inf) -> Gain:
        """Return the gain of a segment, in blocks within some frames of the reference time."""
        total = np.zeros((3, *self.paths.labels.shape), np.float32)
        for index, block in enumerate(_compared(self.paths)):
            if abs(self.paths.blocks.centers[block] - self.paths.reference) > within:
                continue
            templates = [both[index % 2] for both in self.templates]
            _add_gain(self.paths, segment, block, self.sums[segment][index], templates, total)
        nats, known, trials = total
        share = np.where(trials > 0, known / np.maximum(trials, np.float32(1e-6)), 1)
        return Gain(nats, np.asarray(share, np.float32), self.paths.blocks.threads)


def _compared(paths: Paths) -> range:
    """Return the blocks that are compared."""
    number = len(paths.blocks.centers)
    return range(0, number, -(-number // _MAX_BLOCKS))


@dataclasses.dataclass(frozen=True)
class _Predicted:
    """What a template predicts about the bits of a pixel."""

    probability: Image
    """p, (H, W)."""
    values: npt.NDArray[np.float32]
    """log p/(1 - p), log (1 - p), the expected loss of a bit by the noise of the template in nats,
    and how far the template is known, (H, W, 4): 1 if it has at least half as many trials as usual,
    and less where it has fewer."""

    @classmethod
    def of(cls, sums: Sums, threads: int | None) -> "_Predicted":
        """Return the prediction from sums."""
        probability = make_template(sums, threads).probability
        trials = equivalent_sums(sums).trials.astype(np.float32)
        usual = max(float(np.median(trials)), 1.0)
        zero = np.log(1 - probability)
        noise = np.float32(_NOISE) / np.maximum(trials, 1)
        known = np.clip(trials * np.float32(2 / usual), 0, 1)
        values = np.log(probability) - zero, zero, noise, known
        return cls(probability, np.stack(values, axis=-1))


def _add_gain(
    paths: Paths,
    segment: int,
    block: int,
    sums: Sums,
    templates: Sequence[_Predicted],
    total: npt.NDArray[np.float32],
) -> None:
    """Add the gain of a segment in a block, its known trials, and all trials to a total."""
    own = templates[segment]
    sums = equivalent_sums(sums, own.probability)
    others = [
        (other, template.values, paths.relative(segment, other, block))
        for other, template in enumerate(templates)
        if other != segment
    ]
    engine.add_object_gain(
        segment,
        sums.ones,
        sums.trials,
        own.values,
        others,
        paths.labels,
        total,
        paths.blocks.threads,
    )
