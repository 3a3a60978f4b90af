"""The images of a film from jots of several kinds, along the motion of sums over squares."""

import dataclasses
from typing import Any

import numpy as np

from jotlight.formats.capture import CountStack, jot_shape
from jotlight.motion.align import prepare_burst
from jotlight.motion.counts.block_edges import window_edges
from jotlight.motion.counts.sensor_blocks import excluded_jots
from jotlight.motion.films.frames import FilmFrames
from jotlight.motion.films.image import FilmImage
from jotlight.motion.films.merging import FilmMerging
from jotlight.motion.films.settings import FilmSettings
from jotlight.motion.films.state import FilmState
from jotlight.motion.merge import check_upsample, paths_along
from jotlight.motion.merging.jot_kinds import frames_of_kinds, join_kinds, sensors_of_kinds
from jotlight.motion.merging.jot_squares import (
    JotSquares,
    UnsignedCounts,
    enlarge_motion,
    trials_of_frame,
)
from jotlight.motion.merging.mosaic_colors import check_mergeable
from jotlight.motion.motion import Motion
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor


class FilmKinds:
    """The windows of a film as sums over squares, and the merged counts of all kinds of jots.

    Parameters
    ----------
    sensor : Sensor
        The sensor of a window, with a mosaic or a map of thresholds.
    size : (int, int)
        H and W in jots.
    settings : FilmSettings
        How the images are made.
    trials : int
        The number of binary readings behind a count of a jot in one frame, 1 for bits.

    Raises
    ------
    ValueError
        When the kinds of jots cannot be merged.
    """

    def __init__(
        self,
        sensor: Sensor,
        size: tuple[int, int],
        settings: FilmSettings,
        trials: int = 1,
    ) -> None:
        self._sensor, self._size, self._settings = sensor, size, settings
        self._squares = JotSquares(sensor, size, excluded_jots(without_mosaic(sensor)), trials)
        self._sums: UnsignedCounts = np.zeros((0, *self._squares.size), np.uint8)
        self._first = 0
        self._of_kinds = [
            (FilmMerging(own, settings.step, may_stand_still=False), settings.new_memory())
            for own in sensors_of_kinds(sensor, size)
        ]

    def squares(self, known: FilmFrames, wanted: range) -> CountStack:
        """Return the sums of some frames. Those of frames that were summed before are kept.

        Parameters
        ----------
        known : FilmFrames
            The frames that are known, among them the wanted ones.
        wanted : range
            The numbers of the frames.
        """
        has_some = self._first <= wanted.start < self._first + len(self._sums)
        kept = self._sums[wanted.start - self._first :] if has_some else self._sums[:0]
        start, stop = wanted.start + len(kept) - known.first, wanted.stop - known.first
        new = self._squares.count(known.data, start, stop)
        self._sums, self._first = np.concatenate([kept, new])[: len(wanted)], wanted.start
        return self._squares.stack(self._sums)

    def sensor_of_squares(self, frames: int) -> Sensor:
        """Return the gray sensor of the squares in some frames."""
        return self._squares.sensor(frames)

    def merge(
        self, part: Bits | CountStack, of_squares: Motion, start: int
    ) -> tuple[Merged, Motion]:
        """Return the merged counts of a window, and its motion in jots.

        Parameters
        ----------
        part : Bits or CountStack
            The frames of the window.
        of_squares : Motion
            The motion of the squares.
        start : int
            The first frame of the window.
        """
        motion = enlarge_motion(of_squares, self._squares.side, self._size)
        edges = window_edges(len(part), self._settings.step)
        threads, found = self._settings.threads, []
        for kind, memory in self._of_kinds:
            burst, _ = prepare_burst(part, kind.sensor, may_repeat=True)
            paths = paths_along(burst, kind.sensor, motion, threads, edges)
            found.append(kind.merge(paths, motion, start, memory)[0])
        return join_kinds(found, self._sensor, threads), motion


class KindsFilmState:
    """What is carried from image to image if jots are of several kinds."""

    def __init__(self, sensor: Sensor, settings: FilmSettings) -> None:
        check_upsample(settings.upsample, sensor)
        if sensor.mosaic is not None:
            check_mergeable(sensor)
        self._sensor, self._settings = sensor, settings
        self._parts: tuple[FilmKinds, FilmState] | None = None
        """The kinds of jots, and what the film of the squares carries, from the first image on."""

    def next_image(self, known: FilmFrames, start: int) -> FilmImage:
        """Return the image of a window, as :meth:`FilmState.next_image`."""
        settings = self._settings
        window = known.part(settings.window_at(start))
        frames_of_kinds(window, self._sensor)  # it refuses other data
        self._parts = self._parts or self._first_parts(known.data)
        kinds, film_of_squares = self._parts
        around = settings.more_frames(known.numbers, start)
        squares = FilmFrames(kinds.squares(known, around), around.start)
        found = film_of_squares.next_image(squares, start)
        part = _of_sensor(window, self._sensor)
        merged, motion = kinds.merge(part, found.motion, start)
        # Film replaces counts by the readings that they stand for.
        data: Any = part if motion.model == "none" else merged
        return FilmImage(merged, motion, start, found.is_carried, data)

    def _first_parts(self, data: Bits | CountStack) -> tuple[FilmKinds, FilmState]:
        """Return the kinds of jots of frames, and the film of their squares before its images."""
        height, width = jot_shape(data)[1:3]
        kinds = FilmKinds(self._sensor, (height, width), self._settings, trials_of_frame(data))
        # The kinds have memories of their own.
        settings = dataclasses.replace(self._settings, memory=False)
        # Any window predicts what is left of the pattern in the sums, because it stands still, too.
        # So it would also win over the right motion.
        return kinds, FilmState(
            kinds.sensor_of_squares(settings.window), settings, may_stand_still=False
        )


def _of_sensor(window: Bits | CountStack, sensor: Sensor) -> Bits | CountStack:
    """Return the frames of a window with their sensor."""
    if isinstance(window, Bits):
        return window.replace(sensor=sensor)
    return window.with_trials_of(sensor)
