"""Films: the motion of a scene, carried from image to image."""

import dataclasses
from collections.abc import Iterator
from typing import Any

from jotlight.checks import whole_number_in_range
from jotlight.chunks import windows
from jotlight.formats.capture import CountStack
from jotlight.motion.align import prepare_burst
from jotlight.motion.counts.reading_counts import ReadingCounts, counts_for_motion
from jotlight.motion.films.frames import FilmFrames
from jotlight.motion.films.image import FilmImage
from jotlight.motion.films.kinds import KindsFilmState
from jotlight.motion.films.settings import FilmSettings
from jotlight.motion.films.state import FilmState
from jotlight.motion.merging.jot_kinds import frames_of_kinds, has_kinds
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.alike_frames import check_cycles
from jotlight.sensing.data.contradictions import warn_about_contradictions
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor


def film(
    data: Bits | CountStack | Readings,
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
    one, where only the new frames are aligned. It is estimated anew for every 33rd image, and if
    many of the new bits disagree with it. If most pixels of an image are flagged, up to four
    windows of frames are aligned. This also happens for some of the first images of a causal film
    if parts of the scene move differently.

    Parameters
    ----------
    data : Bits, CountStack, or Readings
        T frames of bits, of readings of several bits, or of counts as
        :func:`jotlight.formats.open_capture` returns them. The exposures of a bracket repeat in
        cycles of frames.
    sensor : Sensor, optional
        Sensor of the data. Default: the one of the bits.
    window : int
        Number of frames of each image, from 1 to T. Those of a bracket are whole cycles.
    step : int, optional
        Frames from one window to the next. Default: the size of a window. If it exceeds a
        quarter of a window, the motion of each window is estimated anew.
    model : {"auto", "none", "affine", "segments", "tiles"}
        The model of the motion, as in :func:`jotlight.align`.
    causal : bool
        Whether each image shows the last frame of its window, as in live viewing. The motion is
        then not estimated anew for every 33rd image, so most images take the same time.
        :class:`jotlight.LiveFilm` takes frames that arrive one after the other.
    memory : bool, optional
        Whether bits from before the window are counted, too, where they agree with it. They fade,
        so a still point has up to 3.5 times the trials of a window. True needs a step of at most
        half of the window, or less than the window if the film is causal, and no `upsample`.
        Default: whether the film is causal, and has such a step and no `upsample`.
    upsample : {1, 2}
        2 for a grid of half pixels, as in :func:`jotlight.merge`.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Raises
    ------
    TypeError, ValueError
        When the data do not fit the sensor, or an argument is out of its range.

    Notes
    -----
    To find the bits that agree with the motion, films use a faster network than
    :func:`jotlight.merge`. So a few pixels of an image may count other bits than
    ``merge(data[start : start + window], motion=motion)``.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=48)
    >>> scene = jl.datasets.moving(
    ...     motion="shake", sensor=sensor, shape=(64, 64), photons=0.5, rng=1
    ... )
    >>> [image.is_carried for image in jl.film(scene.bits, window=32, step=8)]
    [False, True, True]
    >>> [image.motion.reference for image in jl.film(scene.bits, window=32, step=8, causal=True)]
    [31.0, 31.0, 31.0]
    """
    warn_about_contradictions(data, sensor)
    converted = counts_for_motion(data, sensor)
    if converted is not None:
        check_cycles(converted.cycle, window, step)
        data, sensor = converted.counts, converted.sensor
        window, step = window // converted.cycle, None if step is None else step // converted.cycle
    sensor = _sensor_of(data, sensor, may_be_counts=converted is not None)
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
    frames: Any = data
    known = FilmFrames(frames, 0)
    images = (state.next_image(known, span.start) for span in spans)
    return (
        images if converted is None else (_corrected(image, converted, threads) for image in images)
    )


def _sensor_of(
    data: Bits | CountStack | Readings, sensor: Sensor | None, *, may_be_counts: bool
) -> Sensor:
    """Return the sensor of the frames of a film. Those of several kinds of jots may not be counts.

    Counts that stand for readings may be.
    """
    of_kinds = frames_of_kinds(data, sensor)
    if of_kinds is None:
        return prepare_burst(data, sensor)[1]
    if isinstance(data, CountStack) and not may_be_counts:
        kinds = "a mosaic" if of_kinds[1].mosaic else "a map of thresholds"
        raise ValueError(
            f"data: expected bits or readings for the film of a sensor with {kinds}, got counts; "
            "jotlight.merge makes one image of them"
        )
    return of_kinds[1]


def _corrected(image: FilmImage, converted: ReadingCounts, threads: int | None) -> FilmImage:
    """Return an image of counts as one of the readings that became these counts."""
    cycle, still = converted.cycle, image.still
    merged = converted.correct(image.merged, threads)
    if still is not None:
        still = range(cycle * still.start, cycle * still.stop)
    data: Merged | Bits | Readings = merged
    if not isinstance(image.data, Merged):  # counts behind a mosaic that are not merged
        first = cycle * image.start
        data = converted.readings[first : first + cycle * len(image.data)]

    def count_nearest() -> tuple[Merged, ...]:
        return tuple(converted.correct(each, threads) for each in image.nearest)

    return dataclasses.replace(
        image,
        merged=merged,
        data=data,
        still=still,
        count_nearest=count_nearest,
        motion=converted.in_frames(image.motion),
        start=cycle * image.start,
    )


def begin_film(sensor: Sensor, settings: FilmSettings) -> "FilmState | KindsFilmState":
    """Return the state of a film before its first image, from the sensor of a window.

    Raises
    ------
    ValueError
        When the settings do not fit the sensor.
    """
    return (KindsFilmState if has_kinds(sensor) else FilmState)(sensor, settings)
