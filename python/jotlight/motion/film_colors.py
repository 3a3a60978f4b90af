"""The color images of a film behind a mosaic, along the motion of sums over squares of jots."""

import dataclasses
from collections.abc import Callable

import numpy as np

from jotlight.formats.capture import CountStack
from jotlight.motion.align import bits_behind_mosaic, excluded_jots, prepare_burst
from jotlight.motion.carrying import divide_by_steps
from jotlight.motion.film_image import FilmImage, FilmSettings
from jotlight.motion.film_merging import FilmMerging
from jotlight.motion.film_state import FilmState
from jotlight.motion.memory import Memory
from jotlight.motion.merge import check_upsample, paths_at
from jotlight.motion.mosaic_colors import check_mergeable, join_colors, sensors_of_colors
from jotlight.motion.mosaics import Counts, Squares, enlarge
from jotlight.motion.motion import Motion
from jotlight.sensing.bits import Bits
from jotlight.sensing.merged import Merged
from jotlight.sensing.readings import without_mosaic
from jotlight.sensing.sensor import Sensor


class FilmColors:
    """The windows of a film as sums over squares, and their merged colors.

    Parameters
    ----------
    sensor : Sensor
        The sensor of a window, with a mosaic.
    size : (int, int)
        H and W in jots.
    step : int
        Frames from one window to the next.
    new_memory : callable
        A function that returns an empty memory, or None if nothing is remembered.
    threads : int, optional
        Number of threads. Default: all.

    Raises
    ------
    ValueError
        When the bits behind the mosaic cannot be merged.
    """

    def __init__(
        self,
        sensor: Sensor,
        size: tuple[int, int],
        step: int,
        new_memory: Callable[[], Memory | None],
        threads: int | None = None,
    ) -> None:
        self._sensor, self._size, self._step, self._threads = sensor, size, step, threads
        self._squares = Squares(sensor, size, excluded_jots(without_mosaic(sensor)))
        self._sums: Counts = np.zeros((0, *self._squares.size), np.uint8)
        self._first = 0
        self._of_colors = [
            (FilmMerging(own, step, may_stand_still=False), new_memory())
            for own in sensors_of_colors(sensor, size)
        ]

    def squares(self, data: Bits, first: int, wanted: range) -> CountStack:
        """Return the sums of some frames. Only those that are not known are summed.

        Parameters
        ----------
        data : Bits
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
        self, part: Bits, of_squares: Motion, start: int, *, is_lost: bool
    ) -> tuple[Merged, Motion]:
        """Return the merged colors of a window, and its motion in jots.

        Parameters
        ----------
        part : Bits
            The frames of the window.
        of_squares : Motion
            The motion of the squares.
        start : int
            The first frame of the window.
        is_lost : bool
            Whether the motion does not explain the squares. All pixels are then flagged.
        """
        motion = enlarge(of_squares, self._squares.side, self._size)
        edges = divide_by_steps(len(part), self._step)
        found = []
        for color, memory in self._of_colors:
            burst, _ = prepare_burst(part, color.sensor, may_repeat=True)
            paths, _ = paths_at(burst, color.sensor, None, motion, self._threads, edges)
            found.append(color.merge(paths, motion, start, memory)[0])
        merged = join_colors(found, self._sensor)
        if is_lost:
            merged = dataclasses.replace(merged, flags=np.ones(merged.shape[:2], bool))
            for _, memory in self._of_colors:
                if memory is not None:
                    memory.forget()
        return merged, motion


class ColorFilmState:
    """What is carried from image to image behind a mosaic."""

    def __init__(self, sensor: Sensor, settings: FilmSettings) -> None:
        check_upsample(settings.upsample, sensor)
        check_mergeable(sensor)
        self.sensor, self._settings = sensor, settings
        self._colors: FilmColors | None = None
        self._of_squares: FilmState | None = None

    def next_image(self, data: Bits | CountStack, first: int, start: int) -> FilmImage:
        """Return the image of a window, as :meth:`FilmState.next_image`."""
        settings = self._settings
        window = data[start - first : start - first + settings.window]
        bits_behind_mosaic(window, self.sensor)  # it refuses other data
        assert isinstance(data, Bits), "the data of a mosaic"
        assert isinstance(window, Bits), "a part of the data"
        part = Bits(window.packed, window.width, self.sensor)
        if self._colors is None:
            size = data.shape[1], data.shape[2]
            self._colors = FilmColors(
                self.sensor, size, settings.step, settings.new_memory, settings.threads
            )
        if self._of_squares is None:
            own = self._colors.sensor_of_squares(settings.window)
            self._of_squares = FilmState(own, dataclasses.replace(settings, memory=False))
        around = settings.more_frames(first, first + len(data), start)
        stack = self._colors.squares(data, first, around)
        found = self._of_squares.next_image(stack, around.start, start)
        still = found.still
        merged, motion = self._colors.merge(part, found.motion, start, is_lost=still is not None)
        shown: Merged | Bits = merged
        if motion.model == "none":
            shown = part
        elif still is not None:
            frames = part.packed[still.start : still.stop]
            shown = Bits(frames, part.width, self.sensor.replace(frames=len(still)))
        return FilmImage(merged, motion, start, found.is_carried, shown, still=still)
