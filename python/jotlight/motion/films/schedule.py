"""When the motion of a film is estimated again."""

import dataclasses

from jotlight.motion.films.candidates import Candidate
from jotlight.motion.films.settings import FilmSettings
from jotlight.motion.motion import Motion

_MAX_CARRIED = 33
"""Number of images after which the motion is estimated anew, unless the film is causal."""

_MAX_LOSS = 0.03
"""The motion is estimated anew if the fraction of agreeing bits falls by more than this."""

_MAX_FLAGGED = 0.5
"""A motion is doubtful if more than this fraction of the pixels is flagged."""

_NEW_FRAMES = 0.25
"""The motion of parts is estimated again after this fraction of the frames from which it was last
estimated. The fraction doubles each time the carried motion is still the better one."""


class FilmSchedule:
    """The decisions when the motion of a film is estimated again, and from how many frames.

    For each image, :meth:`is_old`, :meth:`needs_more_frames`, and :meth:`add` are called in this
    order, the first one only if a motion was carried to the image.
    """

    def __init__(self, settings: FilmSettings) -> None:
        self._settings = settings
        self._images = 0
        """Number of images since the motion was last estimated from its window."""
        self._usual = 0.0
        """The fraction of agreeing bits of the image then."""
        self._frames = range(0)
        """The numbers of the frames from which the motion was last estimated."""
        self._needed = _NEW_FRAMES
        """The fraction of them by which frames must become more, until it is estimated again."""
        self._is_tried = False
        """Whether the next image may be along the motion in more frames."""
        self._doubt = _Doubt()

    def is_old(self, carried: Candidate) -> bool:
        """Return whether the carried motion must be compared with a fresh one of the window."""
        is_old = not self._settings.causal and self._images >= _MAX_CARRIED
        return is_old or carried.agreeing < self._usual - _MAX_LOSS

    def needs_more_frames(self, best: Candidate, around: range, *, is_lost: bool) -> bool:
        """Return whether the motion is also to be estimated from more frames than the window.

        Parameters
        ----------
        best : Candidate
            The better one of the images along the carried and the fresh motion.
        around : range
            The numbers of these frames.
        is_lost : bool
            Whether no motion was carried to the image.
        """
        if not best.image.is_carried:
            self._frames = self._settings.window_at(best.image.start)
            self._needed = _NEW_FRAMES
        is_due = self._doubt.is_due(best.flagged, is_new=is_lost)
        if len(around) <= self._settings.window:
            return False
        if not (is_due or self._shows_parts_better(around, best.motion)):
            return False
        if is_due:
            self._doubt.begin_attempt()
        self._frames, self._is_tried = around, True
        return True

    def add(self, shown: Candidate, *, is_compared: bool) -> None:
        """Count the image that is shown.

        It `is_compared` if a fresh motion of its window was among those to choose from at first.
        """
        if is_compared or not shown.image.is_carried:
            self._images, self._usual = 0, shown.agreeing
        self._images += 1
        if self._is_tried:
            self._needed = 2 * self._needed if shown.image.is_carried else _NEW_FRAMES
            self._is_tried = False

    def _shows_parts_better(self, around: range, motion: Motion) -> bool:
        """Return whether enough new frames are known to show the parts of a scene better.

        The first windows of a film show its parts too briefly. Later, outlines that are carried
        from image to image become worse.
        """
        if motion.model in ("none", "affine"):
            return False
        return around.stop - self._frames.stop >= self._needed * len(self._frames)


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
