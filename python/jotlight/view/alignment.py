"""The alignment of the frames of a window."""

from jotlight.formats.capture import CountStack
from jotlight.motion.align import align
from jotlight.motion.counts.burst import refuse_pixels
from jotlight.motion.counts.reading_counts import counts_for_motion
from jotlight.motion.merge import merge
from jotlight.motion.merging.jot_kinds import frames_of_kinds
from jotlight.motion.motion import Motion
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.view.estimate import choose
from jotlight.view.viewed import Check, Viewable


def alignment_reason(viewed: Viewable) -> str | None:
    """Return why no window can be aligned, or None if windows can."""
    number = 2 * viewed.cycle
    sensor = viewed.sensor(number)
    is_plain = without_mosaic(sensor).has_plain_bits
    if is_plain and (sensor.oversampling == 1 or viewed.is_live):
        return None  # the first frames of a live capture may have left memory
    part = viewed.part(viewed.frames[:number])
    try:
        if isinstance(part, CountStack):
            refuse_pixels(viewed.sensor(len(viewed.frames)))
        elif not is_plain and counts_for_motion(part, sensor) is None:
            frames_of_kinds(part, sensor)
    except ValueError as error:
        return str(error)
    return None


def merge_window(
    viewed: Viewable, frames: range, method: str, check: Check = lambda: None
) -> tuple[Merged | None, Motion]:
    """Return the bits of a window, aligned to its middle, for a method; and their motion.

    The bits are None for a scene that stands still behind a mosaic, whose pixels see one color
    each.

    Raises
    ------
    CancelledError
        When `check` raises it, which is called several times.
    ValueError
        When the data cannot be aligned.
    """
    if len(frames) == viewed.cycle > 1:
        raise ValueError(
            f"align: expected two cycles of exposures or more, which are {2 * viewed.cycle} "
            f"frames, got {len(frames)} frames; choose a longer window"
        )

    def progress(_: float) -> None:
        check()

    # The largest intensity decides which jots are hot.
    max_intensity = choose(viewed, len(frames), method).max_intensity
    sensor = viewed.sensor(len(frames)).replace(max_intensity=max_intensity)
    data = viewed.part(frames)
    motion = align(data, sensor, progress=progress)
    if sensor.mosaic is not None and motion.model == "none":
        return None, motion
    return merge(data, sensor, motion=motion, progress=progress), motion
