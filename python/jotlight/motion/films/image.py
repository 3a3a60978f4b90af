"""An image of a film, and the counts of the parts of its window."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.kept import kept_property
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.track import Paths, from_center
from jotlight.motion.merging.merged_pixels import as_pixels
from jotlight.motion.motion import Motion
from jotlight.networks.planes.film_planes import NEIGHBORS
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

_PARTS = 4, 16
"""About a quarter and a sixteenth of the blocks of a window count as nearest to its image."""


def _no_counts() -> tuple[Merged, ...]:
    return ()


@dataclasses.dataclass(frozen=True, eq=False)
class FilmImage:
    """The bits of one image of a film, merged along the motion of the scene.

    Attributes
    ----------
    merged : Merged
        The merged bits.
    motion : Motion
        The motion. Times count from the first frame of the window.
    start : int
        The number of the first frame of the window.
    is_carried : bool
        Whether the motion is that of the image before, with new blocks at its end.
    data : Merged, Bits, or Readings
        The data to pass to :func:`jotlight.reconstruct`. In most cases, they are `merged`. Behind a
        mosaic, and with a map of thresholds, they are the bits or readings of the window if the
        scene stands still. The flags of `merged` then say nothing about the image.
    count_nearest : callable
        A function that returns :attr:`nearest`.
    still : range, optional
        The frames of the window whose sums without motion are shown, because merging has rejected
        the motion. None if the bits are merged along it, as always behind a mosaic and with a map
        of thresholds.
    """

    merged: Merged
    motion: Motion
    start: int
    is_carried: bool
    data: Merged | Bits | Readings = dataclasses.field(repr=False)
    count_nearest: Callable[[], tuple[Merged, ...]] = dataclasses.field(
        default=_no_counts, repr=False
    )

    still: range | None = None

    @kept_property
    def nearest(self) -> tuple[Merged, ...]:
        """The counts of about a quarter and a sixteenth of the window along the motion.

        They are those of the whole blocks of frames that are nearest to the time of the image. All
        of their bits are counted, whether or not they agree with the motion. The counts of the
        next four sixteenths follow, in the order of their distance in time; of two with the same
        distance, the earlier one is first. The film network reads these counts and `merged`. If
        merging has rejected the motion, they are counted without it. Those of a single channel have
        no axis of channels. The tuple is empty for more colors, for maps of thresholds, and for a
        finer grid. It is computed when it is first read.
        """
        return self.count_nearest()

    def __getstate__(self) -> dict[str, Any]:
        """Return the values for `pickle`, with :attr:`nearest` in place of all frames."""
        return {**vars(self), "count_nearest": functools.partial(tuple, self.nearest)}

    def displacement_from(self, time: float) -> npt.NDArray[np.float32] | None:
        """Return where an earlier image showed the points of this one, (2, H, W), in jots.

        Where merging has rejected the motion, the points stand still. A motion states nothing about
        the time before its window, so the result is None for an image that shows such a time.

        Parameters
        ----------
        time : float
            The time that the earlier image shows, in frames of the film.
        """
        time -= self.start
        if not 0 <= time <= self.motion.reference:
            return None
        displacement = self.motion.at(time)
        return np.zeros_like(displacement) if self.is_rejected else displacement

    @property
    def time(self) -> float:
        """The time that the image shows, in frames of the film."""
        return self.start + self.motion.reference

    @property
    def is_rejected(self) -> bool:
        """Whether merging has rejected the motion. All pixels are then flagged."""
        return self.still is not None


def count_nearest(paths: Paths, sensor: Sensor, *, is_still: bool) -> tuple[Merged, ...]:
    """Return the counts along paths that :attr:`FilmImage.nearest` lists.

    If it `is_still`, the counts are those of the pixels themselves.
    """
    if is_still:
        track = dataclasses.replace(paths.tracks[0], nodes=np.zeros_like(paths.tracks[0].nodes))
        paths = Paths([track], np.zeros_like(paths.labels))
    blocks = paths.blocks
    return tuple(
        as_pixels([Sums.total(map(paths.sums, part), blocks.threads, blocks.size)], sensor)
        for part in find_parts(paths)
    )


def find_parts(paths: Paths) -> list[list[int]]:
    """Return the blocks of the parts of a window that :attr:`FilmImage.nearest` lists.

    A window of few frames has fewer neighbors, so the last parts have no blocks.
    """
    order = [int(block) for block in from_center(paths)]
    quarter, nearest = (order[: max(1, len(order) // part)] for part in _PARTS)
    length = len(nearest)
    before = range(min(nearest) - 1, -1, -1)
    after = range(max(nearest) + 1, len(order))
    neighbors = [
        list(side[first : first + length])
        for side in (before, after)
        for first in range(0, len(side) - length + 1, length)
    ]
    centers = paths.blocks.centers

    def distance(part: list[int]) -> tuple[float, int]:
        return abs(float(np.mean(centers[part])) - paths.reference), part[0]

    neighbors.sort(key=distance)
    neighbors = [*neighbors, *[[]] * NEIGHBORS][:NEIGHBORS]
    return [quarter, nearest, *neighbors]
