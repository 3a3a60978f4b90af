"""The images of a film along known motions, with the bits that it remembers."""

from functools import partial

import numpy as np

from jotlight.motion.consistency import find_consistent
from jotlight.motion.memory import Memory, sum_leaving
from jotlight.motion.merge import merge_along
from jotlight.motion.motion import Motion
from jotlight.motion.scoring import FAST
from jotlight.motion.track import Paths
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor


class FilmMerging:
    """The merging of one window after the other, with fast templates.

    Parameters
    ----------
    sensor : Sensor
        The sensor of a window.
    step : int
        Frames from one window to the next.
    memory : Memory, optional
        Bits from before the window. Default: none are counted.
    upsample : {1, 2}
        2 for a grid of half pixels.
    may_stand_still : bool
        Whether a short window without motion may replace what its motion does not explain.
    """

    def __init__(
        self,
        sensor: Sensor,
        step: int,
        memory: Memory | None = None,
        *,
        upsample: int = 1,
        may_stand_still: bool = True,
    ) -> None:
        self.sensor, self.memory = sensor, memory
        self._step, self._upsample, self._may_stand_still = step, upsample, may_stand_still

    def merge(self, paths: Paths, motion: Motion, start: int, *, is_carried: bool) -> Merged:
        """Return the counts of a window along paths, which are those of a motion.

        Parameters
        ----------
        paths, motion
            The paths, and their motion.
        start : int
            The first frame of the window.
        is_carried : bool
            Whether the segments of the motion are those of the last image.
        """
        consistent = find_consistent(paths, is_still=motion.model == "none", network=FAST)
        merge = partial(
            merge_along,
            paths,
            motion,
            self.sensor,
            consistent,
            may_stand_still=self._may_stand_still,
        )
        if self.memory is None:
            return merge(upsample=self._upsample)
        recall = partial(self.memory.recall, motion=motion, start=start, is_carried=is_carried)
        merged = merge(recall=recall)
        leaving = sum_leaving(paths, consistent, motion, self._step)
        self.memory.remember(leaving, motion, start)
        return merged

    def forget_if_lost(self, merged: Merged) -> bool:
        """Forget all bits if every pixel is flagged, and return whether it is."""
        is_lost = merged.flags is not None and bool(np.all(merged.flags))
        if is_lost and self.memory is not None:
            self.memory.forget()
        return is_lost
