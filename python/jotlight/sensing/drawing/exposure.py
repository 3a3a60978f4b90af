"""Simulation of a sensor: rates, probabilities, and random readings of an image."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.parameter_names import takes_rng
from jotlight.progress import Progress, shown_progress
from jotlight.seeds import SeedLike, seed_bytes
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.drawing.draw_bits import draw_bits
from jotlight.sensing.drawing.draw_readings import draw_readings, noisy_probability
from jotlight.sensing.drawing.draws import Draw
from jotlight.sensing.drawing.simulate import (
    EnginePart,
    Window,
    checked_images,
    crop,
    evaluate_parts,
)
from jotlight.sensing.parameters.parameters import Parameters


class Exposure(Parameters):
    """The base class of the sensor that simulates it."""

    oversampling: int
    frames: int
    max_intensity: float
    kernel: str
    bit_depth: int
    read_noise: float

    if TYPE_CHECKING:

        @property
        def trials(self) -> int: ...  # noqa: D102
        @property
        def readings_differ(self) -> bool: ...  # noqa: D102
        def engine_parts(self) -> list[EnginePart]: ...  # noqa: D102
        def replace(self, **changes: Any) -> Self: ...  # noqa: D102
        def select_frames(self, frames: slice) -> Self: ...  # noqa: D102

    def rate(
        self,
        image: npt.ArrayLike,
        *,
        channel_axis: int | None = None,
        out: npt.NDArray[np.float32] | None = None,
        threads: int | None = None,
    ) -> npt.NDArray[np.float32]:
        """Return the expected detections per jot and frame, η s + d.

        Parameters
        ----------
        image : array_like of float, shape (..., H, W)
            Intensities, finite and not negative.
        channel_axis : int, optional
            The axis of color channels. Default: none; of a sensor with a mosaic, whose image is
            (..., H, W, 3), the last one.
        out : ndarray of float32, optional
            An array of the shape of the result to write to and return. Default: a new one.
        threads : int, optional
            The number of threads. Default: the number of cores.

        Returns
        -------
        ndarray of float32, shape (..., H * K̂, W * K̂)
            The rates of all jots. Dead jots are treated as if they were alive. With a gain for each
            frame, the first axis is that of the frames, (T, ..., H * K̂, W * K̂).

        Examples
        --------
        >>> jl.Sensor(oversampling=2, gain=2.0, dark_counts=0.125).rate(np.full((1, 1), 0.5))
        array([[0.375, 0.375],
               [0.375, 0.375]], dtype=float32)
        """
        images = checked_images(self, image, channel_axis)
        # Rates do not depend on thresholds, of which maps make groups.
        sensor = self.replace(threshold=1) if self.readings_differ else self
        return evaluate_parts(engine.rate, sensor.engine_parts(), *images, out, threads)

    def probability(
        self,
        image: npt.ArrayLike,
        *,
        channel_axis: int | None = None,
        out: npt.NDArray[np.float32] | None = None,
        threads: int | None = None,
    ) -> npt.NDArray[np.float32]:
        """Return P(b = 1) of each jot: equation (3). It is 0 for a dead jot.

        The parameters are those of :meth:`rate`. With a gain or a threshold for each frame, the
        first axis of the result is that of the frames.

        Examples
        --------
        >>> np.allclose(jl.Sensor().probability(np.ones((1, 1))), 1 - np.exp(-1))
        True
        """
        if self.bit_depth > 1:
            raise ValueError(
                f"probability: expected readings of one bit, got {self.bit_depth} bits; "
                "jotlight.sensing.likelihood.multibit.reading_probability(reading, "
                "sensor.rate(image), bit_depth=…) is the probability of each reading"
            )
        images = checked_images(self, image, channel_axis)
        function = noisy_probability if self.read_noise else engine.probability
        return evaluate_parts(function, self.engine_parts(), *images, out, threads)

    @takes_rng
    def expose(
        self,
        image: npt.ArrayLike,
        rng: SeedLike = None,
        *,
        channel_axis: int | None = None,
        tile: tuple[slice, slice] | None = None,
        frames: slice | None = None,
        out: npt.NDArray[np.uint8] | None = None,
        threads: int | None = None,
        progress: Progress = False,
    ) -> Bits:
        """Return random bits of an image, or a list of those of each image of a stack.

        Each bit depends only on the seed and on its own position. A `tile` or a range of `frames`
        therefore equals that part of the whole exposure exactly, with any number of threads. The
        bits see all of the light: `max_intensity` limits estimates only.

        Parameters
        ----------
        image : array_like of float, shape (..., H, W)
            Intensities, finite and not negative. Arrays of float32 and float64 are not copied.
        rng : int, numpy.random.Generator, numpy.random.SeedSequence or None
            The seed. A generator yields a new seed each time; None takes fresh entropy.
        channel_axis : int, optional
            The axis of color channels, which are independent. In bits they are the last axis.
            Default: none, and axes before the last two are those of a stack. A sensor with a mosaic
            sees an image (..., H, W, 3) through its filters, and its bits are gray.
        tile : (slice, slice), optional
            Rows and columns of pixels. Default: all.
        frames : slice, optional
            A range of frames. Default: all.
        out : ndarray of uint8, optional
            The array for the packed bits, of the shape of ``Bits.packed``, after that of a stack.
            Readings of several bits, and bits with read noise, take none.
        threads : int, optional
            The number of threads. Default: the number of cores.
        progress : bool or callable, optional
            Whether to show a progress bar, or a function that is called repeatedly with the
            completed fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

        Returns
        -------
        Bits, or Readings if they have several bits
            The packed bits. Their sensor is this sensor, cropped to the tile and the frames. For a
            stack, a flat list with the bits of each image, which have different seeds.

        Raises
        ------
        TypeError
            For an image of integers, because its scale is unknown.
        ValueError
            When an image is empty, negative, or not finite, or its axes are not clear.

        Notes
        -----
        The generator is ChaCha with 8 rounds. The seed is its key, and the bit's position is its
        counter. A bit is [U < P(b = 1)], where U is a uniform random number of 48 bits. The number
        of photons behind a reading of several bits comes from the same U, so it is at least q where
        the bit of a sensor with threshold q is 1. Read noise has random numbers of its own.

        Examples
        --------
        >>> image = np.linspace(0, 1, 16).reshape(4, 4)
        >>> sensor = jl.Sensor(oversampling=8, frames=2)
        >>> whole = sensor.expose(image, rng=1)
        >>> part = sensor.expose(image, rng=1, tile=(slice(1, 3), slice(2, 4)), frames=slice(1, 2))
        >>> bool((part.to_array() == whole.to_array()[1:2, 8:24, 16:32]).all())
        True
        """
        pixels, layout = checked_images(self, image, channel_axis)
        height, width = layout.moved(pixels).shape[-2:]
        window = Window.from_slices((height, width), self.frames, tile, frames)
        sensor = crop(self, window, (height, width))
        is_plain = self.bit_depth == 1 and not self.read_noise
        if out is not None and not is_plain:
            raise ValueError(
                "out: expected none, because it holds packed bits without read noise, and the "
                f"sensor has {self.bit_depth} bits and read noise {self.read_noise:g}; leave it out"
            )
        seed = seed_bytes(rng)
        with shown_progress(progress, "drawing") as update:
            draw = Draw(self.engine_parts(), pixels, layout, seed, window, threads, update)
            drawn: Any = draw_bits(draw, out) if is_plain else draw_readings(draw)
        if self.bit_depth > 1:
            several: Any = [Readings(each, sensor) for each in drawn]
        else:
            width = len(window.columns) * self.oversampling
            packed = drawn if is_plain else [np.packbits(each > 0, axis=2) for each in drawn]
            # The sensor is gray, even if the scene has a period.
            several = [Bits(each, width, sensor, tested_for_periods=True) for each in packed]
        # The type of the result cannot tell images from stacks, nor bits from readings. Most
        # callers have the bits of an image.
        return several if layout.is_stack else several[0]  # type: ignore[no-any-return]
