"""The time and the memory that aligning and merging take."""

import dataclasses

from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.counts.kept_sums import keeps_sums

_SECONDS_PER_BLOCK, _SECONDS_PER_BLOCK_AND_PIXEL, _SECONDS_PER_BIT = 4.9e-3, 1.8e-7, 1.9e-9
"""Time for one image: that of the templates and equations of blocks, and that of counting."""

_FURTHER_SECONDS_PER_BLOCK, _FURTHER_SECONDS_PER_BLOCK_AND_PIXEL = 1.5e-3, 4.3e-8
"""Time for a further image of a film, to which the motion is carried."""

_BYTES_PER_PIXEL, _BYTES_PER_BLOCK = 180, 16
"""Memory per pixel, and per pixel and block while the sums of blocks are kept."""


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
    (1, 91)
    """
    if frames < 1 or min(size) < 1:
        raise ValueError(
            f"expected 1 frame or more of 1 x 1 jots or more, got {frames} of {size[0]} x {size[1]}"
        )
    pixels = size[0] * size[1]
    blocks = len(block_edges(frames)) - 1
    is_kept = keeps_sums(size, blocks)
    counting = _SECONDS_PER_BIT * pixels * frames
    of_blocks = blocks * (_SECONDS_PER_BLOCK + _SECONDS_PER_BLOCK_AND_PIXEL * pixels)
    further = _FURTHER_SECONDS_PER_BLOCK + _FURTHER_SECONDS_PER_BLOCK_AND_PIXEL * pixels
    kept_bytes = _BYTES_PER_BLOCK * blocks if is_kept else 0
    return MotionCost(
        seconds=of_blocks + counting,
        further_seconds=blocks * further,
        memory=pixels * (_BYTES_PER_PIXEL + kept_bytes + blocks / 8),
    )
