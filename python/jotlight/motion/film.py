"""Films: the motion of a scene, carried from image to image."""

import dataclasses
from collections.abc import Iterator
from typing import Any

from jotlight.checks import whole_number_in_range
from jotlight.chunks import windows
from jotlight.formats.capture import CountStack
from jotlight.motion.align import bits_behind_mosaic, prepare_burst
from jotlight.motion.film_colors import ColorFilmState
from jotlight.motion.film_image import FilmImage, FilmSettings
from jotlight.motion.film_state import FilmState
from jotlight.motion.spread import SpreadReadings, spread_readings
from jotlight.sensing.bits import Bits
from jotlight.sensing.merged import Merged
from jotlight.sensing.photon_readings import Readings
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
    one, where only the new frames are aligned. It is estimated afresh for every 33rd image, and
    where many of the new bits disagree with the rest. Where most pixels are flagged, up to four
    windows of frames are aligned. They also are at some of the first images of a causal film whose
    parts move differently.

    Parameters
    ----------
    data : Bits, CountStack, or Readings
        T frames of bits, of counts as :func:`jotlight.open` returns them, or of readings of several
        bits.
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
        then not estimated afresh for every 33rd image, so usual images take the same time.
        :class:`jotlight.motion.live_film.LiveFilm` takes frames that arrive one after the other.
    memory : bool, optional
        Whether bits from before the window are counted, too, where they agree with it. They fade,
        so a still point has up to 3.5 times the trials of a window. True needs a step of at most
        half of the window, or less than the window if the film is causal, and no `upsample`.
        Default: whether the film is causal, and has such a step and no `upsample`.
    upsample : {1, 2}
        2 for a grid of half pixels, as in :func:`jotlight.merge`.
    threads : int, optional
        Number of threads. Default: all.

    Raises
    ------
    TypeError, ValueError
        When the data do not fit the sensor, or an argument is out of its range.

    Notes
    -----
    Films test with a faster network than :func:`jotlight.merge` which bits agree. So a few pixels
    of an image may count other bits than ``merge(data[start : start + window], motion=motion)``.

    Examples
    --------
    >>> from jotlight.datasets import moving
    >>> scene = moving(motion="shake", sensor=Sensor(frames=48), shape=(64, 64), photons=0.5, rng=1)
    >>> [image.is_carried for image in film(scene.bits, window=32, step=8)]
    [False, True, True]
    >>> [image.motion.reference for image in film(scene.bits, window=32, step=8, causal=True)]
    [31.0, 31.0, 31.0]
    """
    spread = spread_readings(data, sensor)
    if spread is not None:
        data, sensor = spread.counts, spread.sensor
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
    frames: Any = data
    images = (state.next_image(frames, 0, span.start) for span in spans)
    return images if spread is None else (_corrected(image, spread) for image in images)


def _corrected(image: FilmImage, spread: SpreadReadings) -> FilmImage:
    """Return an image with the counts of readings of several bits."""
    merged = spread.correct(image.merged)

    def count_nearest() -> tuple[Merged, ...]:
        return tuple(spread.correct(each) for each in image.nearest)

    return dataclasses.replace(image, merged=merged, data=merged, count_nearest=count_nearest)


def begin_film(sensor: Sensor, settings: FilmSettings) -> "FilmState | ColorFilmState":
    """Return the state of a film before its first image, from the sensor of a window.

    Raises
    ------
    ValueError
        When the settings do not fit the sensor.
    """
    return (FilmState if sensor.mosaic is None else ColorFilmState)(sensor, settings)
