"""The images of a film from jots of several kinds, along the motion of sums over squares."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from jotlight.formats.capture import CountStack, jot_shape
from jotlight.motion.align import excluded_jots, prepare_burst
from jotlight.motion.block_edges import window_edges
from jotlight.motion.film_image import FilmImage, FilmSettings
from jotlight.motion.film_merging import FilmMerging
from jotlight.motion.film_state import FilmState
from jotlight.motion.jot_kinds import frames_of_kinds, join_kinds, sensors_of_kinds
from jotlight.motion.memory import Memory
from jotlight.motion.merge import check_upsample, paths_at
from jotlight.motion.mosaic_colors import check_mergeable
from jotlight.motion.motion import Motion
from jotlight.motion.squares import Counts, JotSquares, enlarge_motion, trials_of_frame
from jotlight.sensing.bits import Bits
from jotlight.sensing.merged import Merged
from jotlight.sensing.readings import without_mosaic
from jotlight.sensing.sensor import Sensor


class FilmKinds:
    """The windows of a film as sums over squares, and the merged counts of all kinds of jots.

    Parameters
    ----------
    sensor : Sensor
        The sensor of a window, with a mosaic or a map of thresholds.
    size : (int, int)
        H and W in jots.
    step : int
        Frames from one window to the next.
    new_memory : callable
        A function that returns an empty memory, or None if nothing is remembered.
    threads : int, optional
        Number of threads. Default: all.
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
        step: int,
        new_memory: Callable[[], Memory | None],
        threads: int | None = None,
        trials: int = 1,
    ) -> None:
        self._sensor, self._size, self._step, self._threads = sensor, size, step, threads
        self._squares = JotSquares(sensor, size, excluded_jots(without_mosaic(sensor)), trials)
        self._sums: Counts = np.zeros((0, *self._squares.size), np.uint8)
        self._first = 0
        self._of_kinds = [
            (FilmMerging(own, step, may_stand_still=False), new_memory())
            for own in sensors_of_kinds(sensor, size)
        ]

    def squares(self, data: Bits | CountStack, first: int, wanted: range) -> CountStack:
        """Return the sums of some frames. Only those that are not known are summed.

        Parameters
        ----------
        data : Bits or CountStack
            Frames, among them the wanted ones.
        first : int
            The number of the first frame of the data.
        wanted : range
            The numbers of the frames.
        """
        is_known = self._first <= wanted.start < self._first + len(self._sums)
        known = self._sums[wanted.start - self._first :] if is_known else self._sums[:0]
        new = self._squares.count(data, wanted.start + len(known) - first, wanted.stop - first)
        self._sums, self._first = np.concatenate([known, new])[: len(wanted)], wanted.start
        return self._squares.stack(self._sums)

    def sensor_of_squares(self, frames: int) -> Sensor:
        """Return the gray sensor of the squares in some frames."""
        return self._squares.sensor(frames)

    def merge(
        self, part: Bits | CountStack, of_squares: Motion, start: int, *, is_lost: bool
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
        is_lost : bool
            Whether the motion does not explain the squares. All pixels are then flagged.
        """
        motion = enlarge_motion(of_squares, self._squares.side, self._size)
        edges = window_edges(len(part), self._step)
        found = []
        for kind, memory in self._of_kinds:
            burst, _ = prepare_burst(part, kind.sensor, may_repeat=True)
            paths, _ = paths_at(burst, kind.sensor, None, motion, self._threads, edges)
            found.append(kind.merge(paths, motion, start, memory)[0])
        merged = join_kinds(found, self._sensor, self._threads)
        if is_lost:
            merged = dataclasses.replace(merged, flags=np.ones(merged.shape[:2], bool))
            for _, memory in self._of_kinds:
                if memory is not None:
                    memory.forget()
        return merged, motion


class KindsFilmState:
    """What is carried from image to image if jots are of several kinds."""

    def __init__(self, sensor: Sensor, settings: FilmSettings) -> None:
        check_upsample(settings.upsample, sensor)
        if sensor.mosaic is not None:
            check_mergeable(sensor)
        self.sensor, self._settings = sensor, settings
        self._kinds: FilmKinds | None = None
        self._of_squares: FilmState | None = None

    def next_image(self, data: Bits | CountStack, first: int, start: int) -> FilmImage:
        """Return the image of a window, as :meth:`FilmState.next_image`."""
        settings = self._settings
        window = data[start - first : start - first + settings.window]
        frames_of_kinds(window, self.sensor)  # it refuses other data
        part = _of_sensor(window, self.sensor)
        if self._kinds is None:
            height, width = jot_shape(data)[1:3]
            self._kinds = FilmKinds(
                self.sensor,
                (height, width),
                settings.step,
                settings.new_memory,
                settings.threads,
                trials_of_frame(data),
            )
        if self._of_squares is None:
            own = self._kinds.sensor_of_squares(settings.window)
            self._of_squares = FilmState(own, dataclasses.replace(settings, memory=False))
        around = settings.more_frames(first, first + len(data), start)
        stack = self._kinds.squares(data, first, around)
        found = self._of_squares.next_image(stack, around.start, start)
        still = found.still
        merged, motion = self._kinds.merge(part, found.motion, start, is_lost=still is not None)
        # Film replaces counts by the readings that they stand for.
        shown: Any = merged
        if motion.model == "none":
            shown = part
        elif still is not None:
            shown = part[still.start : still.stop]
        return FilmImage(merged, motion, start, found.is_carried, shown, still=still)


def _of_sensor(window: Bits | CountStack, sensor: Sensor) -> Bits | CountStack:
    """Return the frames of a window with their sensor."""
    if isinstance(window, Bits):
        return Bits(window.packed, window.width, sensor)
    return window.with_trials_of(sensor)
