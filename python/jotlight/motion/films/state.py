"""What a film carries from image to image: its motion, and its memory."""

from collections.abc import Callable, Sequence
from functools import partial

from jotlight.errors import warn
from jotlight.motion.counts.dark_frames import report_dark
from jotlight.motion.films.candidates import Candidate, Candidates
from jotlight.motion.films.frames import FilmFrames
from jotlight.motion.films.image import FilmImage
from jotlight.motion.films.merging import FilmMerging
from jotlight.motion.films.schedule import FilmSchedule
from jotlight.motion.films.settings import FilmSettings
from jotlight.motion.merge import check_upsample
from jotlight.motion.motion import Motion
from jotlight.sensing.sensor import Sensor

_MIN_OVERLAP = 0.75
"""Minimum fraction of a window that the next one shares, for the motion to be carried."""

_MARGIN = 0.1
"""A fresh motion of one window replaces the carried one even if it flags this much more."""


class FilmState:
    """What is carried from image to image.

    Parameters
    ----------
    sensor : Sensor
        The sensor of a window.
    settings : FilmSettings
        How the images are made.
    may_stand_still : bool
        Whether a short window without motion may replace what its motion does not explain.

    Raises
    ------
    ValueError
        When the sensor has no finer grid, but the settings ask for it.
    """

    def __init__(
        self, sensor: Sensor, settings: FilmSettings, *, may_stand_still: bool = True
    ) -> None:
        check_upsample(settings.upsample, sensor)
        self._settings = settings
        self._merging = FilmMerging(
            sensor, settings.step, upsample=settings.upsample, may_stand_still=may_stand_still
        )
        self._schedule = FilmSchedule(settings)
        self._start = 0
        """The number of the first frame of the last window."""
        self._motion: Motion | None = None
        """The motion of the last window, as seen from its middle, unless merging rejected it."""
        self._memory = settings.new_memory()
        self._reported = 0
        """The number of the first frame from which on a span of dark frames is a new one."""

    def next_image(self, known: FilmFrames, start: int) -> FilmImage:
        """Return the image of the window that begins at frame `start`.

        Parameters
        ----------
        known : FilmFrames
            The frames that are known, among them those of the window.
        start : int
            The number of the first frame of the window.
        """
        settings, schedule = self._settings, self._schedule
        window = known.part(settings.window_at(start))
        candidates = Candidates(window, start, self._memory, self._merging, settings)
        carried, fresh = self._carried(candidates), None
        if carried is None or schedule.is_old(carried):
            fresh = candidates.fresh()
        best = _less_flagged(carried, fresh)
        around = settings.more_frames(known.numbers, start)
        if schedule.needs_more_frames(best, around, is_lost=carried is None):
            more = partial(candidates.of_more_frames, known.part(around), around.start)
            attempts: list[Callable[[], Candidate | None]] = [more]
            if fresh is None:
                attempts.append(candidates.fresh)
            best = _first_better(attempts, best, candidates)
        schedule.add(best, is_compared=fresh is not None)
        self._carry_on(best)
        self._report_dark(best)
        return best.image

    def _carried(self, candidates: Candidates) -> Candidate | None:
        """Return the image along the motion of the last window, or None if this is lost."""
        step = candidates.start - self._start
        if self._motion is None or 1 - step / self._settings.window < _MIN_OVERLAP:
            return None
        return candidates.carried(self._motion, step)

    def _carry_on(self, shown: Candidate) -> None:
        """Keep what the next image needs of the one that is shown."""
        image = shown.image
        if not image.is_carried:
            for text in shown.warnings:
                # Other images may be aligned, by the motion of more frames.
                warn(f"{text} (in at least one image)")
        self._start, self._motion, self._memory = image.start, shown.motion, shown.memory
        if image.is_rejected:
            self._motion = None
            if self._memory is not None:
                self._memory.forget()

    def _report_dark(self, shown: Candidate) -> None:
        """Warn about dark frames, unless they continue a span that was reported."""
        burst, first = shown.paths.blocks.burst, shown.image.start
        dark = [range(first + span.start, first + span.stop) for span in burst.dark_spans]
        new = [span for span in dark if span.start >= self._reported]
        report_dark(new, end=first + len(burst))
        if dark:
            self._reported = max(self._reported, dark[-1].stop + 1)


def _first_better(
    attempts: Sequence[Callable[[], Candidate | None]], best: Candidate, candidates: Candidates
) -> Candidate:
    """Return the first of several images that explains the window better than the best one so far.

    The motion of more frames comes before that of the window alone. It has better outlines, which
    matter for the next images, too.
    """
    for attempt in attempts:
        other = attempt()
        if other is not None and candidates.explains_more(other, best):
            return other
    return best


def _less_flagged(carried: Candidate | None, fresh: Candidate | None) -> Candidate:
    """Return one of two images, at least one of which is known.

    The fresh one may flag a few more pixels.
    """
    if carried is None or fresh is None:
        only = carried or fresh
        assert only is not None, "a carried or a fresh motion"
        return only
    return fresh if fresh.flagged < carried.flagged + _MARGIN else carried
