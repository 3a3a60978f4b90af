"""Films: the motion of a scene, carried from image to image."""

import copy
import dataclasses
import warnings
from collections.abc import Iterator
from functools import partial

import numpy as np
import numpy.typing as npt

from jotlight.checks import whole_number_in_range
from jotlight.chunks import windows
from jotlight.errors import JotlightWarning
from jotlight.formats.capture import CountStack
from jotlight.motion.align import align, as_blocks, as_motion, hot_jots, prepare_burst
from jotlight.motion.carrying import carry
from jotlight.motion.consistency import find_consistent
from jotlight.motion.memory import Memory, remembers, sum_leaving
from jotlight.motion.merge import as_paths, check_upsample, merge_along
from jotlight.motion.model import divide
from jotlight.motion.motion import MODELS, Motion
from jotlight.motion.scoring import FAST
from jotlight.motion.track import Paths
from jotlight.sensing.bits import Bits
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor, require_sensor

_MAX_CARRIED = 33
"""Number of images after which the motion is estimated afresh, unless the film is causal."""

_MIN_OVERLAP = 0.75
"""Minimum fraction of a window that the next one shares, for the motion to be carried."""

_MAX_LOSS = 0.03
"""The motion is estimated afresh if the fraction of accepted bits falls by more than this."""


@dataclasses.dataclass(frozen=True)
class FilmImage:
    """The bits of one image of a film, merged along the motion of the scene."""

    merged: Merged
    motion: Motion
    """The motion. Times count from the first frame of the window."""
    is_carried: bool
    """Whether the motion is that of the image before, with new blocks at its end."""


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
        the same time. :class:`LiveFilm` takes frames that arrive one after the other.
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
    burst, sensor = prepare_burst(data, sensor)
    spans = windows(len(data), window, step)
    # A frame of counts has several readings.
    part = sensor.replace(frames=sensor.frames * window // len(burst))
    state = _State(
        part,
        window,
        window if step is None else step,
        model=model,
        causal=causal,
        memory=memory,
        upsample=upsample,
        threads=threads,
    )
    return (state.next_image(data[span], span.start) for span in spans)


class LiveFilm:
    """A film of frames that arrive one after the other. Each image shows the latest frame.

    It keeps the frames of a window, the motion, and sums of earlier bits. So an image takes the
    same time and the same number of bytes, however many came before.

    Parameters
    ----------
    sensor : Sensor
        The sensor. Its number of frames has no effect.
    window : int
        Number of frames of each image.
    step : int
        Frames from one image to the next, at most a window.
    model : {"auto", "none", "affine", "segments", "tiles"}
        The model of the motion, as in :func:`jotlight.align`.
    memory : bool, optional
        Whether bits from before the window are counted, as in :func:`film`. Default: True, but not
        with `upsample`.
    upsample : {1, 2}
        2 for a grid of half pixels, as in :func:`jotlight.merge`.
    threads : int, optional
        Number of threads. Default: all.

    Raises
    ------
    TypeError, ValueError
        When an argument is out of its range.

    Examples
    --------
    >>> from jotlight.datasets import moving
    >>> scene = moving(motion="shake", sensor=Sensor(frames=48), shape=(64, 64), photons=0.5, rng=1)
    >>> live = LiveFilm(scene.sensor, window=32, step=8)
    >>> [len(live.add(scene.bits[start : start + 4])) for start in range(0, 48, 4)]
    [0, 0, 0, 0, 0, 0, 0, 1, 0, 1, 0, 1]
    """

    def __init__(
        self,
        sensor: Sensor,
        *,
        window: int,
        step: int,
        model: str = "auto",
        memory: bool | None = None,
        upsample: int = 1,
        threads: int | None = None,
    ) -> None:
        require_sensor(sensor)
        self._window = whole_number_in_range("window", window, 1, 2**31 - 1)
        self._step = whole_number_in_range("step", step, 1, window)
        part = sensor.replace(frames=window)
        self._state = _State(
            part,
            window,
            step,
            model=model,
            causal=True,
            memory=memory,
            upsample=upsample,
            threads=threads,
        )
        self._kept: npt.NDArray[np.uint8] | None = None
        self._width, self._seen = 0, 0

    def add(self, frames: Bits) -> list[FilmImage]:
        """Return the images that are complete with some further frames, usually none or one.

        Raises
        ------
        TypeError, ValueError
            When the frames are not bits, or differ in size from earlier ones.
        """
        if not isinstance(frames, Bits):
            raise TypeError(
                f"frames: expected jotlight.Bits, got {type(frames).__name__}; "
                "Bits.from_array packs frames (T, H, W) of 0 and 1"
            )
        packed = np.asarray(frames.packed)
        if self._kept is None:
            self._kept, self._width = packed[:0], frames.width
        if packed.shape[1:] != self._kept.shape[1:] or frames.width != self._width:
            raise ValueError(
                f"frames: expected the size of earlier frames, {self._kept.shape[1]} x "
                f"{self._width}, got {frames.shape[1]} x {frames.width}"
            )
        images = []
        while len(packed):
            missing = self._window - self._seen
            if missing <= 0:
                missing = self._step - (self._seen - self._window) % self._step
            part, packed = packed[:missing], packed[missing:]
            self._kept = np.concatenate([self._kept, part])[-self._window :]
            self._seen += len(part)
            if len(part) == missing:
                bits = Bits(self._kept, self._width, self._state.sensor)
                images.append(self._state.next_image(bits, self._seen - self._window))
        return images


class _State:
    """What is carried from image to image."""

    def __init__(
        self,
        sensor: Sensor,
        window: int,
        step: int,
        *,
        model: str,
        causal: bool,
        memory: bool | None,
        upsample: int,
        threads: int | None,
    ) -> None:
        check_upsample(upsample, sensor)
        if model != "auto" and model not in MODELS:
            raise ValueError(f"model: expected auto or one of {', '.join(MODELS)}, got {model!r}")
        self.sensor = sensor
        self._model, self._causal, self._upsample, self._threads = model, causal, upsample, threads
        has_memory = remembers(memory, window, step, causal=causal, upsample=upsample)
        self._memory = Memory(window) if has_memory else None
        self._step = step
        self._motion: Motion | None = None
        """The motion of the last window, as seen from its middle."""
        self._start, self._number, self._usual = 0, 0, 0.0

    def next_image(self, part: Bits | CountStack, start: int) -> FilmImage:
        """Return the image of a window, whose first frame has a number."""
        step, motion = start - self._start, self._motion
        shared = 1 - step / len(part)
        is_recent = self._causal or self._number < _MAX_CARRIED
        image = None
        if motion is not None and is_recent and shared >= _MIN_OVERLAP:
            image = self._carried_image(motion, part, start)
        if image is None:
            motion = align(part, self.sensor, model=self._model, threads=self._threads)
            burst, sensor = prepare_burst(part, self.sensor)
            blocks = as_blocks(burst, divide(len(burst)), sensor, self._threads)
            image = self._merge(as_paths(motion, blocks), motion, start, is_carried=False)
            self._motion, self._number, self._usual = motion, 0, _accepted(image.merged)
        self._number += 1
        self._start = start
        if image.merged.flags is not None and image.merged.flags.all():
            # Where merging has rejected the motion, it is not carried.
            self._motion = None
            if self._memory is not None:
                self._memory.forget()
        return image

    def _carried_image(
        self, motion: Motion, part: Bits | CountStack, start: int
    ) -> FilmImage | None:
        """Return the image of a window along the motion of the one before, or None if lost."""
        paths = carry(motion, part, self.sensor, start - self._start, self._threads)
        if paths is None:
            return None
        carried = as_motion(paths, motion.model)
        # Merging changes the memory, which is needed again if the image is rejected.
        memory = copy.copy(self._memory)
        with warnings.catch_warnings():
            # A motion that is lost is estimated afresh, so a warning about it would mislead.
            warnings.simplefilter("ignore", JotlightWarning)
            image = self._merge(paths, carried, start, is_carried=True)
        if _accepted(image.merged) < self._usual - _MAX_LOSS:
            self._memory = memory
            return None
        self._motion = carried
        return image

    def _merge(self, paths: Paths, motion: Motion, start: int, *, is_carried: bool) -> FilmImage:
        """Return the image of a window along paths, with fast templates."""
        if self._causal:
            motion, paths = _seen_from_end(motion, paths)
        blocks, is_still = paths.blocks, motion.model == "none"
        if is_still and hot_jots(self.sensor) is not None:
            # The alignment leaves out hot jots, but merging counts them if nothing moves.
            blocks = as_blocks(
                blocks.burst, blocks.edges, self.sensor, self._threads, with_hot_jots=True
            )
            paths = as_paths(motion, blocks)
        consistent = find_consistent(paths, is_still=is_still, network=FAST)
        if self._memory is None:
            merged = merge_along(paths, motion, self.sensor, consistent, self._upsample)
            return FilmImage(merged, motion, is_carried)
        recall = partial(self._memory.recall, motion=motion, start=start, is_carried=is_carried)
        merged = merge_along(paths, motion, self.sensor, consistent, recall=recall)
        leaving = sum_leaving(paths, consistent, motion, self._step)
        self._memory.remember(leaving, motion, start)
        return FilmImage(merged, motion, is_carried)


def _seen_from_end(motion: Motion, paths: Paths) -> tuple[Motion, Paths]:
    """Return a motion as seen from the last frame, and its paths."""
    try:
        motion = motion.seen_from(float(len(paths.blocks.burst) - 1))
    except ValueError:
        # A wrong motion may fold the image, so that its displacements have no bounds. The image
        # then shows the middle of the window.
        return motion, paths
    return motion, as_paths(motion, paths.blocks)


def _accepted(merged: Merged) -> float:
    """Return the fraction of the bits that were counted."""
    return 1.0 if merged.acceptance is None else float(merged.acceptance.mean())
