"""The time and the memory that aligning and merging take."""

import dataclasses

from jotlight.motion.model import divide
from jotlight.motion.track import keeps_sums

_SECONDS_PER_PIXEL, _SECONDS_PER_BIT = 1.1e-5, 1.5e-8
"""Time for one image: that of the templates and equations of up to 32 blocks, and of counting."""

_FURTHER_SECONDS_PER_PIXEL, _FURTHER_SECONDS_PER_BIT = 2.6e-6, 3e-9
"""Time for a further image of a film, to which the motion is carried."""

_BYTES_PER_PIXEL, _BYTES_PER_BLOCK = 180, 16
"""Memory per pixel, and per pixel and block while the sums of blocks are kept."""

_MEASURED_BLOCKS = 32
"""Number of blocks above which the time grows with it."""


@dataclasses.dataclass(frozen=True)
class MotionCost:
    """The time and the memory of `jotlight.align` and `jotlight.merge` together."""

    seconds: float
    """Time for one image on one thread."""
    further_seconds: float
    """Time for each further image of a film on one thread."""
    memory: float
    """Bytes, without those of the bits."""


def motion_cost(frames: int, size: tuple[int, int]) -> MotionCost:
    """Return about how much time and memory aligning and merging take.

    Parameters
    ----------
    frames : int
        T: the number of frames, 1 or more.
    size : (int, int)
        H and W in jots, 1 or more.

    Raises
    ------
    ValueError
        When a number is below 1.

    Notes
    -----
    The constants are those of ``benchmarks/studies/motion_cost.py`` on an AMD EPYC. They are for a
    shaking camera. Several motions in a scene, and tiles that move on their own, take up to five
    times as long.

    Examples
    --------
    >>> cost = motion_cost(256, (256, 512))
    >>> round(cost.seconds), round(cost.memory / 1e6)
    (2, 91)
    """
    if frames < 1 or min(size) < 1:
        raise ValueError(
            f"expected 1 frame or more of 1 x 1 jots or more, got {frames} of {size[0]} x {size[1]}"
        )
    pixels = size[0] * size[1]
    blocks = len(divide(frames)) - 1
    growth = max(1.0, blocks / _MEASURED_BLOCKS)
    kept = blocks if keeps_sums(size, blocks) else 0
    return MotionCost(
        seconds=pixels * (_SECONDS_PER_PIXEL * growth + _SECONDS_PER_BIT * frames),
        further_seconds=pixels
        * (_FURTHER_SECONDS_PER_PIXEL * growth + _FURTHER_SECONDS_PER_BIT * frames),
        memory=pixels * (_BYTES_PER_PIXEL + _BYTES_PER_BLOCK * kept + blocks / 8),
    )
