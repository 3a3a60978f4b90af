"""The images of a film along known motions, with the bits that it remembers."""

from functools import partial

from jotlight.motion.agreement.consistency import RINGS, find_consistent
from jotlight.motion.displacements.track import Paths
from jotlight.motion.films.memory import Memory, sum_leaving
from jotlight.motion.merge import merge_along
from jotlight.motion.merging.merged_pixels import MergedAlong
from jotlight.motion.motion import Motion
from jotlight.sensing.sensor import Sensor

_WIDE_RINGS, _MANY_FRAMES = (4, 4), 256
"""The rings of blocks of a film with one motion, from this number of frames of a window on. They
need one template instead of three, because windows have longer blocks than bursts, and their motion
is known better."""


class FilmMerging:
    """The merging of one window after the other, with fast templates.

    Parameters
    ----------
    sensor : Sensor
        The sensor of a window.
    step : int
        Frames from one window to the next.
    upsample : {1, 2}
        2 for a grid of half pixels, onto which nothing can be remembered.
    may_stand_still : bool
        Whether a short window without motion may replace what its motion does not explain.
    """

    def __init__(
        self,
        sensor: Sensor,
        step: int,
        *,
        upsample: int = 1,
        may_stand_still: bool = True,
    ) -> None:
        self.sensor = sensor
        self._step, self._upsample, self._may_stand_still = step, upsample, may_stand_still

    def merge(self, paths: Paths, motion: Motion, start: int, memory: Memory | None) -> MergedAlong:
        """Return the counts of a window along paths, which are those of a motion.

        Parameters
        ----------
        paths, motion
            The paths, and their motion.
        start : int
            The first frame of the window.
        memory : Memory or None
            Bits from before the window, which are counted, too. It is changed for the next window.
        """
        is_still, frames = motion.model == "none", len(paths.blocks.burst)
        is_simple = is_still or motion.model == "affine"
        rings = _WIDE_RINGS if is_simple and frames >= _MANY_FRAMES else RINGS
        consistent = find_consistent(paths, is_still=is_still, rings=rings)
        result = merge_along(
            paths,
            motion,
            self.sensor,
            consistent,
            self._upsample,
            may_stand_still=self._may_stand_still,
            recall=None if memory is None else partial(memory.recall, motion=motion, start=start),
        )
        if memory is not None:
            memory.remember(sum_leaving(paths, result.counted, motion, self._step), motion, start)
        return result
