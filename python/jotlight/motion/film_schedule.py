"""When the motion of a film is estimated again."""

import dataclasses

from jotlight.motion.film_candidates import Candidate
from jotlight.motion.film_settings import KEPT_WINDOWS, FilmSettings
from jotlight.motion.motion import Motion

_MAX_CARRIED = 33
"""Number of images after which the motion is estimated anew, unless the film is causal."""

_MAX_LOSS = 0.03
"""The motion is estimated anew if the fraction of accepted bits falls by more than this."""

_MAX_FLAGGED = 0.5
"""A motion is doubtful if more than this fraction of the pixels is flagged."""

_GROWTH = 1.5
"""Factor by which frames must become more, until a causal film estimates its motion from them."""


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
        """The fraction of accepted bits of the image then."""
        self._frames = 0
        """Number of frames from which the motion was last estimated."""
        self._doubt = _Doubt()

    def is_old(self, carried: Candidate) -> bool:
        """Return whether the carried motion must be compared with a fresh one of the window."""
        is_old = not self._settings.causal and self._images >= _MAX_CARRIED
        return is_old or carried.accepted < self._usual - _MAX_LOSS

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
            self._frames = self._settings.window
        is_due = self._doubt.is_due(best.flagged, is_new=is_lost)
        if len(around) <= self._settings.window:
            return False
        if not (is_due or self._may_show_outlines(around, best.motion)):
            return False
        if is_due:
            self._doubt.begin_attempt()
        self._frames = len(around)
        return True

    def add(self, shown: Candidate, *, is_compared: bool) -> None:
        """Count the image that is shown.

        It `is_compared` if a fresh motion of its window was among those to choose from at first.
        """
        if is_compared or not shown.image.is_carried:
            self._images, self._usual = 0, shown.accepted
        self._images += 1

    def _may_show_outlines(self, around: range, motion: Motion) -> bool:
        """Return whether the frames around a window have grown enough to show other outlines.

        The first windows of a causal film have shown the parts of a scene too briefly.
        """
        is_single = motion.model in ("none", "affine")
        if is_single or not self._settings.causal:
            return False
        largest = KEPT_WINDOWS * self._settings.window
        return len(around) > self._frames and len(around) >= min(_GROWTH * self._frames, largest)


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
