"""Films of frames that arrive one after the other."""

import numpy as np
import numpy.typing as npt

from jotlight.checks import whole_number_in_range
from jotlight.motion.films.film import begin_film
from jotlight.motion.films.frames import FilmFrames
from jotlight.motion.films.image import FilmImage
from jotlight.motion.films.settings import KEPT_WINDOWS, FilmSettings
from jotlight.motion.merging.jot_kinds import frames_of_kinds, without_kinds
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.data.contradictions import warn_about_contradictions
from jotlight.sensing.parameters.reading_groups import require_plain_bits
from jotlight.sensing.sensor import Sensor, require_any_sensor

_ADVICE = (
    "jotlight.film, of all frames at once, also takes readings of several bits, read "
    "noise, and exposures that repeat"
)
"""What to do with frames other than plain bits."""


class LiveFilm:
    """A film of frames that arrive one after the other. Each image shows the latest frame.

    It keeps the frames of four windows, the motion, and sums of earlier bits. So its memory does
    not grow, however many frames came before.

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
        The number of threads. Default: the number of cores.

    Raises
    ------
    TypeError, ValueError
        When an argument is out of its range.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=48)
    >>> scene = jl.datasets.moving(
    ...     motion="shake", sensor=sensor, shape=(64, 64), photons=0.5, rng=1
    ... )
    >>> live = jl.LiveFilm(scene.sensor, window=32, step=8)
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
        require_any_sensor(sensor)
        require_plain_bits(without_kinds(sensor), _ADVICE)
        window = self._window = whole_number_in_range("window", window, 1, 2**31 - 1)
        self._step = whole_number_in_range("step", step, 1, window)
        settings = FilmSettings(
            window=self._window,
            step=self._step,
            model=model,
            causal=True,
            memory=memory,
            upsample=whole_number_in_range("upsample", upsample, 1, 2),
            threads=threads,
        )
        self._sensor = sensor
        self._state = begin_film(sensor.replace(frames=window), settings)
        self._kept = np.zeros((0, 0, 0), np.uint8)
        """The latest frames, with room for further ones."""
        self._filled, self._width, self._seen = 0, 0, 0
        self._is_tested = False
        """Whether the rates of the jots have been tested for periods."""

    def add(self, frames: Bits) -> list[FilmImage]:
        """Return the images that are complete with some further frames, usually none or one.

        Raises
        ------
        TypeError, ValueError
            When the frames are not bits, do not fit the sensor, or differ in size from earlier
            ones.

        Warns
        -----
        JotlightWarning
            When the sensor of the first frames contradicts that of the film.
        """
        packed, images = self._packed(frames), []
        while len(packed):
            missing = self._missing()
            part, packed = packed[:missing], packed[missing:]
            self._keep(part)
            if len(part) == missing:
                images.append(self._next_image(is_tested=frames.tested_for_periods))
        return images

    def _packed(self, frames: Bits) -> npt.NDArray[np.uint8]:
        """Return packed frames of the size of earlier ones. The first ones determine this size."""
        if not isinstance(frames, Bits):
            raise TypeError(
                f"frames: expected jotlight.Bits, got {type(frames).__name__}; "
                "Bits.from_array packs frames (T, H, W) of 0 and 1"
            )
        packed = np.asarray(frames.packed)
        if self._width == 0:
            warn_about_contradictions(frames, self._sensor, is_required=True)
            self._check_fits(frames)
            room = (KEPT_WINDOWS + 1) * self._window
            self._kept, self._width = np.empty((room, *packed.shape[1:]), np.uint8), frames.width
        size = self._kept.shape[1:]
        if packed.shape[1:] != size or frames.width != self._width:
            raise ValueError(
                f"frames: expected the size of earlier frames, {size[0]} x {self._width}, got "
                f"{frames.shape[1]} x {frames.width}"
            )
        return packed

    def _check_fits(self, frames: Bits) -> None:
        """Raise ValueError unless frames fit the sensor."""
        sensor = self._sensor.replace(frames=len(frames))
        if frames_of_kinds(frames, sensor) is None:
            check_fits(frames.shape, sensor)

    def _missing(self) -> int:
        """Return the number of frames that are missing for the next image."""
        if self._seen < self._window:
            return self._window - self._seen
        return self._step - (self._seen - self._window) % self._step

    def _next_image(self, *, is_tested: bool) -> FilmImage:
        """Return the image of the latest window, whose jots may have been tested for periods."""
        first = max(0, self._filled - KEPT_WINDOWS * self._window)
        kept, is_tested = self._kept[first : self._filled], self._is_tested or is_tested
        bits = Bits(kept, self._width, tested_for_periods=is_tested)
        known = FilmFrames(bits, self._seen - len(bits))
        image = self._state.next_image(known, self._seen - self._window)
        self._is_tested = True  # the first image tests its frames
        return image

    def _keep(self, part: npt.NDArray[np.uint8]) -> None:
        """Add frames to those that are kept, which are moved once per window."""
        if self._filled + len(part) > len(self._kept):
            start = max(0, self._filled - KEPT_WINDOWS * self._window)
            # Earlier images may refer to their frames, so these are not overwritten.
            room = np.empty_like(self._kept)
            room[: self._filled - start] = self._kept[start : self._filled]
            self._kept, self._filled = room, self._filled - start
        self._kept[self._filled : self._filled + len(part)] = part
        self._filled += len(part)
        self._seen += len(part)
