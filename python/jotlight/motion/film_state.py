"""What a film carries from image to image: its motion, and its memory."""

import copy
import dataclasses
from functools import partial

import numpy as np

from jotlight.errors import hide_warnings, record_warnings, warn
from jotlight.formats.capture import CountStack
from jotlight.motion.align import align, as_blocks, as_motion, hot_jots, prepare_burst
from jotlight.motion.block_edges import block_edges
from jotlight.motion.carrying import carry
from jotlight.motion.film_image import KEPT_WINDOWS, FilmImage, FilmSettings, count_nearest
from jotlight.motion.film_merging import FilmMerging
from jotlight.motion.likelihood_gain import likelihood_gain
from jotlight.motion.memory import Memory
from jotlight.motion.merge import as_paths, check_upsample
from jotlight.motion.motion import Motion
from jotlight.motion.track import Paths
from jotlight.sensing.bits import Bits
from jotlight.sensing.sensor import Sensor

_MAX_CARRIED = 33
"""Number of images after which the motion is estimated afresh, unless the film is causal."""

_MIN_OVERLAP = 0.75
"""Minimum fraction of a window that the next one shares, for the motion to be carried."""

_MAX_LOSS = 0.03
"""The motion is estimated afresh if the fraction of accepted bits falls by more than this."""

_MAX_FLAGGED = 0.5
"""A motion is doubtful if more than this fraction of the pixels is flagged."""

_GROWTH = 1.5
"""Factor by which frames must become more, until a causal film estimates its motion from them."""

_MARGIN = 0.1
"""A fresh motion of one window replaces the carried one even if it flags this much more."""


@dataclasses.dataclass(frozen=True)
class _Candidate:
    """An image of a window along one of several motions, and what the film carries with it."""

    image: FilmImage
    motion: Motion
    """The motion, as seen from the middle of the window."""
    paths: Paths
    """The paths of the image."""
    memory: Memory | None
    warnings: list[str]
    """The warnings of aligning and merging."""

    @property
    def flagged(self) -> float:
        """The fraction of the pixels that are flagged."""
        flags = self.image.merged.flags
        return 0.0 if flags is None else float(np.mean(flags))

    @property
    def accepted(self) -> float:
        """The fraction of the bits that were counted."""
        acceptance = self.image.merged.acceptance
        return 1.0 if acceptance is None else float(acceptance.mean())

    def explains_more(self, other: "_Candidate") -> bool:
        """Return whether the bits of the window are more likely along this motion.

        Where merging has rejected a motion, the other one is better.
        """
        if self.image.is_rejected or other.image.is_rejected:
            return not self.image.is_rejected
        return likelihood_gain(self.paths) > likelihood_gain(other.paths)


class FilmState:
    """What is carried from image to image."""

    def __init__(self, sensor: Sensor, settings: FilmSettings) -> None:
        check_upsample(settings.upsample, sensor)
        self.sensor, self._settings, self._threads = sensor, settings, settings.threads
        self._merging = FilmMerging(sensor, settings.step, upsample=settings.upsample)
        self._memory = settings.new_memory()
        self._motion: Motion | None = None
        """The motion of the last window, as seen from its middle."""
        self._start, self._number, self._usual = 0, 0, 0.0
        self._doubt = _Doubt()
        self._frames = 0
        """The number of frames from which the motion was estimated."""

    def next_image(self, data: Bits | CountStack, first: int, start: int) -> FilmImage:
        """Return the image of a window.

        Parameters
        ----------
        data : Bits or CountStack
            Frames, among them those of the window.
        first, start : int
            The numbers of the first frame of the data, and of that of the window.
        """
        settings = self._settings
        part = data[start - first : start - first + settings.window]
        carried = self._carried(part, start)
        fresh = None if carried and not self._is_old(carried) else self._fresh(part, start)
        best = carried or fresh
        assert best is not None, "a carried or a fresh motion"
        if carried and fresh:
            best = fresh if fresh.flagged < carried.flagged + _MARGIN else carried
            self._number, self._usual = 0, best.accepted
        if best is fresh:
            self._frames = len(part)
        around = settings.more_frames(first, first + len(data), start)
        is_due = self._doubt.is_due(best.flagged, is_new=carried is None)
        if len(around) > len(part) and (is_due or self._has_more(around, best.motion)):
            if is_due:
                self._doubt.begin_attempt()
            frames = data[around.start - first : around.stop - first]
            others = [self._of_more_frames(frames, around.start, part, start)]
            if fresh is None:
                others.append(self._fresh(part, start))
            for other in others:
                best = other if other and other.explains_more(best) else best
            self._frames = len(around)
        if not best.image.is_carried:
            self._number, self._usual = 0, best.accepted
            for text in best.warnings:
                # Other images may be aligned, by the motion of more frames.
                warn(f"{text} (in at least one image)")
        self._number += 1
        self._start, self._motion, self._memory = start, best.motion, best.memory
        if best.image.is_rejected:
            # Where merging has rejected the motion, it is not carried.
            self._motion = None
            if self._memory is not None:
                self._memory.forget()
        return best.image

    def _is_old(self, carried: _Candidate) -> bool:
        """Return whether the motion must be compared with a fresh one of the window."""
        is_old = not self._settings.causal and self._number >= _MAX_CARRIED
        return is_old or carried.accepted < self._usual - _MAX_LOSS

    def _has_more(self, around: range, motion: Motion) -> bool:
        """Return whether more frames are known, which may show other outlines of segments.

        The first windows of a causal film have shown the parts of a scene too briefly.
        """
        is_single = motion.model in ("none", "affine")
        if is_single or not self._settings.causal:
            return False
        most = KEPT_WINDOWS * self._settings.window
        return len(around) > self._frames and len(around) >= min(_GROWTH * self._frames, most)

    def _carried(self, part: Bits | CountStack, start: int) -> _Candidate | None:
        """Return the image of a window along the motion of the one before, or None if lost."""
        step, motion = start - self._start, self._motion
        if motion is None or 1 - step / len(part) < _MIN_OVERLAP:
            return None
        paths = carry(motion, part, self.sensor, step, self._threads)
        if paths is None:
            return None
        return self._merge(paths, as_motion(paths, motion.model), start, is_carried=True)

    def _fresh(self, part: Bits | CountStack, start: int) -> _Candidate:
        """Return the image of a window along a motion that is estimated from it alone."""
        with record_warnings() as texts:
            motion = align(part, self.sensor, model=self._settings.model, threads=self._threads)
        burst, sensor = prepare_burst(part, self.sensor)
        blocks = as_blocks(burst, block_edges(len(burst)), sensor, self._threads)
        found = self._merge(as_paths(motion, blocks), motion, start, is_carried=False)
        return dataclasses.replace(found, warnings=[*texts, *found.warnings])

    def _of_more_frames(
        self, frames: Bits | CountStack, first: int, part: Bits | CountStack, start: int
    ) -> _Candidate | None:
        """Return the image of a window along the motion in more frames, from number `first` on.

        Return None if the window contradicts this motion.
        """
        window, offset = len(part), start - first
        sensor = self.sensor.replace(frames=self.sensor.frames * len(frames) // window)
        with hide_warnings():
            motion = align(frames, sensor, model=self._settings.model, threads=self._threads)
        motion = dataclasses.replace(
            motion, times=motion.times - offset, reference=motion.reference - offset
        )
        # The window has shorter blocks, which show the motion at its end better.
        paths = carry(motion, part, self.sensor, 0, self._threads)
        if paths is None:
            return None
        return self._merge(paths, as_motion(paths, motion.model), start, is_carried=False)

    def _merge(self, paths: Paths, motion: Motion, start: int, *, is_carried: bool) -> _Candidate:
        """Return the image of a window along paths, which are those of a motion."""
        shown = motion
        if self._settings.causal:
            shown, paths = _seen_from_end(motion, paths)
        blocks = paths.blocks
        if shown.model == "none" and hot_jots(self.sensor) is not None:
            # The alignment leaves out hot jots, but merging counts them if nothing moves.
            blocks = as_blocks(
                blocks.burst, blocks.edges, self.sensor, self._threads, with_hot_jots=True
            )
            paths = as_paths(shown, blocks)
        # Merging changes the memory, and other candidates need the one before.
        memory = copy.copy(self._memory)
        with record_warnings() as texts:
            merged, still = self._merging.merge(paths, shown, start, memory)
        image = FilmImage(merged, shown, start, is_carried, merged, still=still)
        if self._settings.upsample == 1 and paths.blocks.burst.channels == 1:
            count = partial(count_nearest, paths, self.sensor, is_still=image.is_rejected)
            image = dataclasses.replace(image, count_nearest=count)
        return _Candidate(image, motion, paths, memory, texts)


@dataclasses.dataclass
class _Doubt:
    """Whether the motion in more frames is due, because most pixels of images are flagged.

    Single images may be flagged by chance, so the first attempt is made at the second image in
    succession, unless nothing was carried to the first. The number of images between two attempts
    doubles. So films of scenes that no model explains take little longer.
    """

    attempts: int = 0
    images: int = 0
    """Number of flagged images since the last attempt."""

    def begin_attempt(self) -> None:
        """Count an attempt."""
        self.attempts, self.images = self.attempts + 1, 0

    def is_due(self, flagged: float, *, is_new: bool) -> bool:
        """Return whether an attempt is due for an image with a flagged fraction.

        `is_new` states that no motion was carried to it.
        """
        if flagged <= _MAX_FLAGGED:
            self.attempts, self.images = 0, 0
            return False
        self.images += 1
        if self.attempts == 0:
            return is_new or self.images >= 2
        return self.images >= min(1 << (self.attempts - 1), _MAX_CARRIED)


def _seen_from_end(motion: Motion, paths: Paths) -> tuple[Motion, Paths]:
    """Return a motion as seen from the last frame, and its paths."""
    try:
        motion = motion.seen_from(float(len(paths.blocks.burst) - 1))
    except ValueError:
        # A wrong motion may fold the image, so that its displacements have no bounds. The image
        # then shows the middle of the window.
        return motion, paths
    return motion, as_paths(motion, paths.blocks)
