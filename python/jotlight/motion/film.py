"""Films: the motion of a scene, carried from image to image."""

import copy
import dataclasses
import warnings
from collections.abc import Iterator

import numpy as np

from jotlight.checks import whole_number_in_range
from jotlight.chunks import windows
from jotlight.errors import JotlightWarning
from jotlight.formats.capture import CountStack
from jotlight.motion.align import (
    align,
    as_blocks,
    as_motion,
    bits_behind_mosaic,
    hot_jots,
    prepare_burst,
)
from jotlight.motion.carrying import carry
from jotlight.motion.film_colors import FilmColors
from jotlight.motion.film_merging import FilmMerging
from jotlight.motion.memory import Memory, remembers
from jotlight.motion.merge import as_paths, check_upsample
from jotlight.motion.model import divide
from jotlight.motion.mosaics import check_mergeable
from jotlight.motion.motion import MODELS, Motion
from jotlight.motion.track import Paths
from jotlight.sensing.bits import Bits
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

_MAX_CARRIED = 33
"""Number of images after which the motion is estimated afresh, unless the film is causal."""

_MIN_OVERLAP = 0.75
"""Minimum fraction of a window that the next one shares, for the motion to be carried."""

_MAX_LOSS = 0.03
"""The motion is estimated afresh if the fraction of accepted bits falls by more than this."""

_MAX_FLAGGED = 0.5
"""If more than this fraction of the pixels is flagged, a fresh motion may be better."""


@dataclasses.dataclass(frozen=True)
class FilmImage:
    """The bits of one image of a film, merged along the motion of the scene."""

    merged: Merged
    motion: Motion
    """The motion. Times count from the first frame of the window."""
    is_carried: bool
    """Whether the motion is that of the image before, with new blocks at its end."""
    data: Merged | Bits
    """What :func:`jotlight.reconstruct` estimates the image from: `merged`, or the bits of the
    window if the scene stands still behind a mosaic, where each pixel sees one color alone."""


def film(
    data: Bits | CountStack,
    sensor: Sensor | None = None,
    *,
    window: int,
    step: int | None = None,
    model: str = "auto",
    causal: bool = False,
    memory: bool | None = None,
    upsample: int = 1,
    threads: int | None = None,
) -> Iterator[FilmImage]:
    """Return an iterator over the images of a film, each merged along the motion of the scene.

    Each image shows the middle of a window of frames. The motion of a window is carried to the next
    one, where only the new frames are aligned. It is estimated afresh for every 33rd image, and
    where many of the new bits disagree with the rest.

    Parameters
    ----------
    data : Bits or CountStack
        T frames of bits, or of counts as :func:`jotlight.open` returns them.
    sensor : Sensor, optional
        Sensor of the data. Default: the one of the bits.
    window : int
        Number of frames of each image, from 1 to T.
    step : int, optional
        Frames from one window to the next. Default: the size of a window. If it exceeds a
        quarter of a window, the motion of each window is estimated afresh. With a window or more,
        nothing is remembered.
    model : {"auto", "none", "affine", "segments", "tiles"}
        The model of the motion, as in :func:`jotlight.align`.
    causal : bool
        Whether each image shows the last frame of its window, as in live viewing. The motion is
        then estimated afresh only where many of the new bits disagree. So all other images take
        the same time. `LiveFilm` takes frames that arrive one after the other.
    memory : bool, optional
        Whether bits from before the window are counted, too, where they agree with it. They fade,
        so a still point has up to 3.5 times the trials of a window. Not possible with `upsample`.
        Default: whether the film is causal.
    upsample : {1, 2}
        2 for a grid of half pixels, as in :func:`jotlight.merge`.
    threads : int, optional
        Number of threads. Default: all.

    Raises
    ------
    TypeError, ValueError
        When the data do not fit the sensor, or an argument is out of its range.

    Examples
    --------
    >>> from jotlight.datasets import moving
    >>> scene = moving(motion="shake", sensor=Sensor(frames=48), shape=(64, 64), photons=0.5, rng=1)
    >>> [image.is_carried for image in film(scene.bits, window=32, step=8)]
    [False, True, True]
    >>> [image.motion.reference for image in film(scene.bits, window=32, step=8, causal=True)]
    [31.0, 31.0, 31.0]
    """
    colored = bits_behind_mosaic(data, sensor)
    sensor = prepare_burst(data, sensor)[1] if colored is None else colored[1]
    spans = windows(len(data), window, step)
    # A frame of counts has several readings.
    part = sensor.replace(frames=sensor.frames * window // len(data))
    settings = FilmSettings(
        window=window,
        step=window if step is None else step,
        model=model,
        causal=causal,
        memory=memory,
        upsample=whole_number_in_range("upsample", upsample, 1, 2),
        threads=threads,
    )
    state = begin_film(part, settings)
    return (state.next_image(data[span], span.start) for span in spans)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmSettings:
    """How the images of a film are made: the arguments of :func:`film`."""

    window: int
    step: int
    model: str
    causal: bool
    memory: bool | None
    upsample: int
    threads: int | None

    def __post_init__(self) -> None:
        if self.model != "auto" and self.model not in MODELS:
            names = ", ".join(MODELS)
            raise ValueError(f"model: expected auto or one of {names}, got {self.model!r}")

    def new_memory(self) -> Memory | None:
        """Return an empty memory, or None if the film has none."""
        has_memory = remembers(
            self.memory, self.window, self.step, causal=self.causal, upsample=self.upsample
        )
        return Memory(self.window) if has_memory else None


def begin_film(sensor: Sensor, settings: FilmSettings) -> "State | ColorState":
    """Return the state of a film before its first image, from the sensor of a window.

    Raises
    ------
    ValueError
        When the settings do not fit the sensor.
    """
    return (State if sensor.mosaic is None else ColorState)(sensor, settings)


class State:
    """What is carried from image to image."""

    def __init__(self, sensor: Sensor, settings: FilmSettings) -> None:
        check_upsample(settings.upsample, sensor)
        self.sensor, self._settings, self._threads = sensor, settings, settings.threads
        self._merging = FilmMerging(
            sensor, settings.step, settings.new_memory(), upsample=settings.upsample
        )
        self._motion: Motion | None = None
        """The motion of the last window, as seen from its middle."""
        self._start, self._number, self._usual = 0, 0, 0.0
        self._doubt = _Doubt()

    def next_image(self, part: Bits | CountStack, start: int) -> FilmImage:
        """Return the image of a window, whose first frame has a number."""
        step, motion = start - self._start, self._motion
        shared = 1 - step / len(part)
        is_recent = self._settings.causal or self._number < _MAX_CARRIED
        image = None
        if motion is not None and is_recent and shared >= _MIN_OVERLAP:
            # Merging changes the memory, which is needed again if the image is rejected.
            memory = copy.copy(self._merging.memory)
            image = self._carried_image(motion, part, start)
            if image is None:
                self._merging.memory = memory
            elif self._doubt.is_due(image.merged):
                image = self._better_image(image, memory, part, start)
        if image is None:
            motion, image = self._fresh_image(part, start)
            self._motion, self._number, self._usual = motion, 0, _accepted(image.merged)
        self._number += 1
        self._start = start
        if self._merging.forget_if_lost(image.merged):
            # Where merging has rejected the motion, it is not carried.
            self._motion = None
        return image

    def _carried_image(
        self, motion: Motion, part: Bits | CountStack, start: int
    ) -> FilmImage | None:
        """Return the image of a window along the motion of the one before, or None if lost."""
        paths = carry(motion, part, self.sensor, start - self._start, self._threads)
        if paths is None:
            return None
        carried = as_motion(paths, motion.model)
        with warnings.catch_warnings():
            # A motion that is lost is estimated afresh, so a warning about it would mislead.
            warnings.simplefilter("ignore", JotlightWarning)
            image = self._merge(paths, carried, start, is_carried=True)
        if _accepted(image.merged) < self._usual - _MAX_LOSS:
            return None
        self._motion = carried
        return image

    def _fresh_image(self, part: Bits | CountStack, start: int) -> tuple[Motion, FilmImage]:
        """Return a motion that is estimated from a window alone, and the image along it."""
        motion = align(part, self.sensor, model=self._settings.model, threads=self._threads)
        burst, sensor = prepare_burst(part, self.sensor)
        blocks = as_blocks(burst, divide(len(burst)), sensor, self._threads)
        return motion, self._merge(as_paths(motion, blocks), motion, start, is_carried=False)

    def _better_image(
        self, image: FilmImage, memory: Memory | None, part: Bits | CountStack, start: int
    ) -> FilmImage:
        """Return the image along the carried motion or along a fresh one, with fewer flags.

        `memory` is the one from before the image.
        """
        self._merging.memory, kept = memory, self._merging.memory
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", JotlightWarning)
            motion, fresh = self._fresh_image(part, start)
        if _flagged(fresh.merged) >= _flagged(image.merged):
            self._merging.memory = kept
            return image
        self._motion, self._number, self._usual = motion, 0, _accepted(fresh.merged)
        return fresh

    def _merge(self, paths: Paths, motion: Motion, start: int, *, is_carried: bool) -> FilmImage:
        """Return the image of a window along paths."""
        if self._settings.causal:
            motion, paths = _seen_from_end(motion, paths)
        blocks = paths.blocks
        if motion.model == "none" and hot_jots(self.sensor) is not None:
            # The alignment leaves out hot jots, but merging counts them if nothing moves.
            blocks = as_blocks(
                blocks.burst, blocks.edges, self.sensor, self._threads, with_hot_jots=True
            )
            paths = as_paths(motion, blocks)
        merged = self._merging.merge(paths, motion, start, is_carried=is_carried)
        return FilmImage(merged, motion, is_carried, merged)


@dataclasses.dataclass
class _Doubt:
    """After how many images the motion is estimated afresh, if most of their pixels are flagged.

    The number doubles with each attempt, so that films of scenes that no model explains take little
    longer.
    """

    wait: int = 1
    waited: int = 0

    def is_due(self, merged: Merged) -> bool:
        """Return whether the motion of this image is estimated afresh."""
        if _flagged(merged) <= _MAX_FLAGGED:
            self.wait, self.waited = 1, 0
            return False
        self.waited += 1
        if self.waited < self.wait:
            return False
        self.wait, self.waited = min(2 * self.wait, _MAX_CARRIED), 0
        return True


class ColorState:
    """What is carried from image to image behind a mosaic."""

    def __init__(self, sensor: Sensor, settings: FilmSettings) -> None:
        if settings.upsample > 1:
            raise ValueError(
                f"upsample: expected 1 for a sensor with a mosaic, got {settings.upsample}"
            )
        check_mergeable(sensor)
        self.sensor, self._settings = sensor, settings
        self._colors: FilmColors | None = None
        self._of_squares: State | None = None

    def next_image(self, part: Bits | CountStack, start: int) -> FilmImage:
        """Return the image of a window, whose first frame has a number."""
        assert isinstance(part, Bits), "the data of a mosaic"
        settings, size = self._settings, (part.shape[1], part.shape[2])
        part = Bits(part.packed, part.width, self.sensor)
        if self._colors is None:
            self._colors = FilmColors(
                self.sensor, size, settings.step, settings.new_memory, settings.threads
            )
        stack, own = self._colors.squares(part, start)
        if self._of_squares is None:
            self._of_squares = State(own, dataclasses.replace(settings, memory=False))
        found = self._of_squares.next_image(stack, start)
        is_lost = found.merged.flags is not None and bool(found.merged.flags.all())
        merged, motion = self._colors.merge(
            part, found.motion, start, is_carried=found.is_carried, is_lost=is_lost
        )
        data = part if motion.model == "none" else merged
        return FilmImage(merged, motion, found.is_carried, data)


def _seen_from_end(motion: Motion, paths: Paths) -> tuple[Motion, Paths]:
    """Return a motion as seen from the last frame, and its paths."""
    try:
        motion = motion.seen_from(float(len(paths.blocks.burst) - 1))
    except ValueError:
        # A wrong motion may fold the image, so that its displacements have no bounds. The image
        # then shows the middle of the window.
        return motion, paths
    return motion, as_paths(motion, paths.blocks)


def _flagged(merged: Merged) -> float:
    """Return the fraction of the pixels that are flagged."""
    return 0.0 if merged.flags is None else float(np.mean(merged.flags))


def _accepted(merged: Merged) -> float:
    """Return the fraction of the bits that were counted."""
    return 1.0 if merged.acceptance is None else float(merged.acceptance.mean())
