"""The images that a window of a film may become, along motions that are found in several ways."""

import copy
import dataclasses
from functools import partial

from jotlight.errors import hide_warnings, record_warnings
from jotlight.formats.capture import CountStack
from jotlight.motion.agreement.consistency import CLEARLY_MORE
from jotlight.motion.align import as_motion, find_motion, prepare_burst, seen_from
from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.counts.sensor_blocks import as_blocks, hot_jots
from jotlight.motion.displacements.track import Paths
from jotlight.motion.films.carrying import carry
from jotlight.motion.films.image import FilmImage, count_nearest
from jotlight.motion.films.memory import Memory
from jotlight.motion.films.merging import FilmMerging
from jotlight.motion.films.settings import FilmSettings
from jotlight.motion.merge import as_paths
from jotlight.motion.motion import Motion
from jotlight.motion.outlines.likelihood_gain import likelihood_gain
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.sensor import Sensor


@dataclasses.dataclass(frozen=True)
class Candidate:
    """An image of a window along one of several motions, and what the film carries with it."""

    image: FilmImage
    motion: Motion
    """The motion, as seen from the middle of the window."""
    paths: Paths
    """The paths of the image."""
    memory: Memory | None
    """The memory after this image."""
    warnings: list[str]
    """The warnings of aligning and merging."""
    flagged: float
    """The fraction of the pixels that the bits flag, as in ``MergedAlong``."""
    agreeing: float
    """The fraction of the bits that agree with the motion, as in ``MergedAlong``."""


@dataclasses.dataclass(frozen=True)
class Candidates:
    """The images that one window may become.

    Each method finds a motion, and returns the image along it. None of them changes the film.
    """

    window: Bits | CountStack
    """The frames of the window."""
    start: int
    """The number of its first frame."""
    memory: Memory | None
    """The bits from before the window. Each image counts those that agree with its motion."""
    merging: FilmMerging
    settings: FilmSettings

    def carried(self, motion: Motion, step: int) -> Candidate | None:
        """Return the image along the motion of the window that began `step` frames before.

        Return None if this motion is lost, or folds the image at the time that is shown.
        """
        paths = self._carry(motion, step)
        if paths is None:
            return None
        motion = as_motion(paths, motion.model)
        with record_warnings() as texts:
            shown = self._shown(motion)
        return None if texts else self._merged(paths, motion, shown, is_carried=True)

    def fresh(self) -> Candidate:
        """Return the image along a motion that is estimated from the window alone."""
        sensor = self.merging.sensor
        with record_warnings() as texts:
            motion = self._aligned(self.window, sensor)
            shown = self._shown(motion)
        if shown.model != motion.model:
            motion = shown  # a wrong motion is not carried on
        found = self._merged(self._along(motion), motion, shown, is_carried=False)
        return dataclasses.replace(found, warnings=[*texts, *found.warnings])

    def of_more_frames(self, frames: Bits | CountStack, first: int) -> Candidate | None:
        """Return the image along the motion in more frames, from number `first` on.

        Return None if the window contradicts this motion, or if it folds the image.
        """
        offset = self.start - first
        sensor = self.merging.sensor
        sensor = sensor.replace(frames=sensor.frames * len(frames) // len(self.window))
        with hide_warnings():
            motion = self._aligned(frames, sensor)
        motion = dataclasses.replace(
            motion, times=motion.times - offset, reference=motion.reference - offset
        )
        # The window has shorter blocks, which show the motion at its end better.
        paths = self._carry(motion, 0)
        if paths is None:
            return None
        motion = as_motion(paths, motion.model)
        with record_warnings() as texts:
            shown = self._shown(motion)
        return None if texts else self._merged(self._along(motion), motion, shown, is_carried=False)

    def explains_more(self, one: Candidate, other: Candidate) -> bool:
        """Return whether the motion of one image explains the window better than that of another.

        A motion that merging has rejected is worse. In a causal film, the motion with which more
        bits agree is better; if the models differ, clearly more must agree. Likelihoods are those
        of all frames, so they do not show where the outlines are in the last one. In other films,
        this is so only if exactly one of the motions has outlines. In all other cases, likelihoods
        decide.
        """
        if one.image.is_rejected or other.image.is_rejected:
            return not one.image.is_rejected
        models = {one.motion.model, other.motion.model}
        needed = CLEARLY_MORE if len(models) > 1 else 0.0
        may_decide = self.settings.causal or (len(models) > 1 and "segments" in models)
        if may_decide and abs(one.agreeing - other.agreeing) > needed:
            return one.agreeing > other.agreeing
        return likelihood_gain(one.paths) > likelihood_gain(other.paths)

    def _carry(self, motion: Motion, step: int) -> Paths | None:
        """Return the paths of a motion that is continued to the end of the window, or None."""
        return carry(motion, self.window, self.merging.sensor, step, self.settings.threads)

    def _aligned(self, frames: Bits | CountStack, sensor: Sensor) -> Motion:
        """Return the motion of some frames, as seen from their middle.

        The film itself reports dark frames, by their numbers in the film.
        """
        model, threads, middle = self.settings.model, self.settings.threads, len(frames) // 2
        return find_motion(frames, sensor, middle, model, threads, lambda _: None).motion

    def _along(self, motion: Motion) -> Paths:
        """Return the paths of a new motion.

        All new motions have the same blocks, so that they can be compared: in longer blocks, more
        bits of a wrong motion agree.
        """
        burst, sensor = prepare_burst(self.window, self.merging.sensor)
        blocks = as_blocks(burst, block_edges(len(burst)), sensor, self.settings.threads)
        return as_paths(motion, blocks)

    def _shown(self, motion: Motion) -> Motion:
        """Return a motion as seen from the time of the image."""
        return seen_from(motion, float(len(self.window) - 1)) if self.settings.causal else motion

    def _merged(
        self, paths: Paths, motion: Motion, shown: Motion, *, is_carried: bool
    ) -> Candidate:
        """Return the image along paths, which are those of a motion.

        It is also `shown` as seen from the time of the image.
        """
        if shown is not motion:
            paths = as_paths(shown, paths.blocks)
        paths = self._with_hot_jots(paths, shown)
        # Merging changes the memory, and other candidates need the one before.
        memory = copy.copy(self.memory)
        with record_warnings() as texts:
            found = self.merging.merge(paths, shown, self.start, memory)
        merged = found.merged
        image = FilmImage(merged, shown, self.start, is_carried, merged, still=found.window)
        if self.settings.upsample == 1 and paths.blocks.burst.channels == 1:
            count = partial(count_nearest, paths, self.merging.sensor, is_still=image.is_rejected)
            image = dataclasses.replace(image, count_nearest=count)
        return Candidate(image, motion, paths, memory, texts, found.flagged, found.agreeing)

    def _with_hot_jots(self, paths: Paths, motion: Motion) -> Paths:
        """Return paths along which hot jots are counted if nothing moves.

        Alignment leaves them out.
        """
        sensor = self.merging.sensor
        if motion.model != "none" or hot_jots(sensor) is None:
            return paths
        threads, blocks = self.settings.threads, paths.blocks
        return as_paths(
            motion, as_blocks(blocks.burst, blocks.edges, sensor, threads, with_hot_jots=True)
        )
