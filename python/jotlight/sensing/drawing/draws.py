"""What a simulation draws: the readings of which images, with which seeds, in which window."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.kept import kept_property
from jotlight.layout import Layout
from jotlight.seeds import seed_of_image
from jotlight.sensing.drawing.simulate import EnginePart, EngineSensor, Window


@dataclasses.dataclass(frozen=True, eq=False)
class Draw:
    """The random readings of a window of an image, or of each image of a stack."""

    parts: list[EnginePart]
    """The readings of each gain and threshold. All of them together are the readings."""
    pixels: npt.NDArray[Any]
    """The images, in the layout."""
    layout: Layout
    seed: bytes
    """The seed of the first image. The others have seeds that follow from it."""
    window: Window
    """The frames, rows, and columns that are drawn."""
    threads: int | None
    """The number of threads. Default: the number of cores."""
    progress: Callable[[float], object]
    """A function that receives the completed fraction."""

    @property
    def is_color(self) -> bool:
        """Whether the images have color channels."""
        return self.layout.channel_axis is not None

    @property
    def stack(self) -> tuple[int, ...]:
        """The shape of the stack, or () for a single image."""
        return self.layout.shape[:-1] if self.is_color else self.layout.shape

    @kept_property
    def images(self) -> npt.NDArray[Any]:
        """N images of C channels, (N, C, H, W)."""
        images = self.layout.split(self.pixels)
        return images.reshape(math.prod(self.stack), -1, *images.shape[1:])

    @kept_property
    def seeds(self) -> list[bytes]:
        """The seed of each image."""
        return [seed_of_image(self.seed, index) for index in range(math.prod(self.stack))]

    @property
    def oversampling(self) -> int:
        """K̂: each pixel covers K̂ x K̂ jots."""
        return int(self.parts[0].sensor["oversampling"])

    def runs(self, length: int) -> list[tuple[EngineSensor, Window, slice]]:
        """Return the successive frames of each part, at most `length` of them together.

        They are the sensor of the part, the window of these frames, and their place in the window.
        """
        first = self.window.frames.start
        return [
            (
                sensor,
                dataclasses.replace(self.window, frames=frames),
                slice(frames.start - first, frames.stop - first),
            )
            for numbers, sensor in self.parts
            for frames in _successive(numbers, self.window.frames, length)
        ]


def _successive(numbers: npt.NDArray[np.intp] | None, window: range, length: int) -> list[range]:
    """Return the frames of a part in a window, as ranges of at most `length` frames."""
    if numbers is None:
        inside = np.arange(window.start, window.stop)
    else:
        inside = numbers[(numbers >= window.start) & (numbers < window.stop)]
    ends = np.flatnonzero(np.diff(inside) > 1) + 1
    return [
        range(start, min(start + length, int(run[-1]) + 1))
        for run in np.split(inside, ends)
        if len(run)
        for start in range(int(run[0]), int(run[-1]) + 1, length)
    ]
