"""Advice where a network does not fit a capture, or where the scene moves."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

from jotlight.cli.terminal.console import caution
from jotlight.evaluation.choice import Choice
from jotlight.evaluation.contradictions.clipping import clipping_of
from jotlight.formats.capture import Capture
from jotlight.motion.counts.detection import THRESHOLD, motion_score
from jotlight.motion.counts.reading_counts import counts_of_readings
from jotlight.motion.merging.jot_kinds import without_kinds
from jotlight.motion.merging.mosaic_colors import is_mergeable
from jotlight.networks.pretrained import DEFAULT_SIZE
from jotlight.sensing.data.alike_frames import find_cycle
from jotlight.sensing.sensor import Sensor

T = TypeVar("T")

_DIM = 0.7
"""Brightness of a scene below which the pretrained networks lose quality."""


def range_advice(choice: Choice, maximum: float, brightness: float) -> str | None:
    """Return a remark where the range of a network does not fit the scene, or None.

    Parameters
    ----------
    choice : Choice
        Method of the estimate.
    maximum : float
        Largest value of the estimate.
    brightness : float
        Brightness of the estimate: all but 0.1 % of the pixels are darker.
    """
    if (remark := clipping_of(choice, maximum)) is not None:
        return remark
    is_pretrained = choice.quality is not None
    if is_pretrained and choice.has_fixed_range and brightness < _DIM:
        return (
            f"the network {choice.quality} is for scenes with a brightness of 1, and the "
            f"brightness of this scene is {brightness:.2g}; --quality {DEFAULT_SIZE} is for "
            "every brightness"
        )
    return None


def representatives(items: Sequence[T]) -> list[T]:
    """Return the first, the middle, and the last item, which stand for all.

    Examples
    --------
    >>> representatives(range(10)), representatives("ab"), representatives([])
    ([0, 5, 9], ['a', 'b'], [])
    """
    number = len(items)
    return [items[index] for index in sorted({0, number // 2, number - 1})] if number else []


def caution_about_motion(
    parts: Iterable[Capture],
    sensor: Sensor,
    threads: int | None,
    *,
    advice: str = "--motion aligns its frames",
    name: str | None = None,
) -> bool:
    """Print a remark if the scene moves in one of some parts of a capture, and return whether.

    Parameters
    ----------
    parts : iterable of Bits or CountStack
        The frames of an image each.
    sensor : Sensor
        The sensor of each part.
    threads : int, optional
        The number of threads. Default: the number of cores.
    advice : str
        How to align the frames.
    name : str, optional
        The capture, if the user has named several.
    """
    if find_cycle(sensor) is None:
        return False  # their ones change without motion
    for part in parts:
        converted = counts_of_readings(part, sensor)
        counts = part if converted is None else converted.counts
        own = without_kinds(sensor if converted is None else converted.sensor)
        score = motion_score(counts, threshold=own.threshold, threads=threads)
        if score > THRESHOLD:
            way = (
                advice
                if is_mergeable(sensor) and (converted is None or converted.is_mergeable)
                else "an image from fewer frames is sharper"
            )
            scene = "the scene" if name is None else f"the scene of {name}"
            caution("motion", f"{scene} moves, so the image is blurred; {way}")
            return True
    return False
