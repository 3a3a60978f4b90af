"""Merging: the counts of all bits along a motion."""

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.checks import whole_number_in_range
from jotlight.errors import warn
from jotlight.formats.capture import CountStack, jot_shape
from jotlight.motion.agreement.consistency import MIN_ACCEPTED, Consistent, find_consistent
from jotlight.motion.agreement.flags import find_flags, flags_of_image, unclear_pixels
from jotlight.motion.agreement.held_out import count_in_place
from jotlight.motion.agreement.still_window import find_window, report_window
from jotlight.motion.agreement.stricter_test import select_bits
from jotlight.motion.align import find_motion, prepare_burst, reference_time
from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import Burst
from jotlight.motion.counts.dark_frames import report_dark
from jotlight.motion.counts.reading_counts import counts_for_motion
from jotlight.motion.counts.sensor_blocks import as_blocks, hot_jots
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.disagreement import disagreement
from jotlight.motion.displacements.flicker import without_saturation
from jotlight.motion.displacements.track import Paths, Track
from jotlight.motion.merging.finer import count_fine, fine_paths
from jotlight.motion.merging.jot_kinds import (
    frames_of_kinds,
    has_kinds,
    join_kinds,
    sensors_of_kinds,
)
from jotlight.motion.merging.merged_pixels import MergedAlong, as_fine, as_merged
from jotlight.motion.merging.threshold_maps import count_still
from jotlight.motion.motion import Motion
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.contradictions import warn_about_contradictions
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

_ALIGNING = 0.8
"""Part of the time that aligning takes."""

Recall = Callable[[list[Sums], npt.NDArray[np.bool_]], list[Sums]]
"""A function of the sums of each channel and of the pixels that are trusted, (H, W)."""

_MAX_FLAGGED = 0.15
"""Fraction of flagged pixels above which the image is compared with sums without motion."""


def merge(
    data: Bits | CountStack | Readings,
    sensor: Sensor | None = None,
    at: float | None = None,
    motion: Motion | None = None,
    *,
    upsample: int = 1,
    threads: int | None = None,
    progress: Progress = None,
) -> Merged:
    """Return the counts of the bits along the motion of a scene: a sharp image of one time.

    Bits that disagree with the others, such as those of objects that hide a part of the scene, are
    left out. So the pixels have different numbers of trials.

    Parameters
    ----------
    data : Bits, CountStack, or Readings
        T frames of bits, of readings of several bits, or of counts as
        :func:`jotlight.formats.open_capture` returns them. The exposures of a bracket repeat in
        cycles of frames.
    sensor : Sensor, optional
        Sensor of the data. Default: the one of the bits.
    at : float, optional
        The time that the image shows, from 0 to T - 1 in frames. Default: the reference time of
        the motion, or the middle, T // 2.
    motion : Motion, optional
        The motion of the scene. Default: the one that :func:`jotlight.align` returns for the same
        data, sensor, and time.
    upsample : {1, 2}
        2 merges onto a grid of half pixels, with twice as many rows and columns. Each reading
        integrates over 2 x 2 pixels of this grid, which K-conditioned networks take into account.
        Shifts by fractions of a pixel fill the grid. Where they do not, the trials are 0.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction. Default: a bar in notebooks.

    Returns
    -------
    Merged
        Counts of pixels, which all methods and all tied networks accept in place of bits. Only
        K-conditioned networks accept those of a finer grid. Behind a mosaic of ideal filters R, G,
        and B, they are color counts, (H, W, 3): along a motion, each pixel of the image is seen
        through all filters. If the scene stands still (model "none"), reconstruct the bits instead.
        Of brackets, of maps of thresholds, and of readings of several bits, they are equivalent
        counts.

    Raises
    ------
    TypeError, ValueError
        When the data, the sensor, and the motion do not fit together.

    Warns
    -----
    JotlightWarning
        When bits that were held out do not show that the merged image is better than a short
        window without motion. That window is then returned. Also when frames are dark, as for
        :func:`jotlight.align`. Dark frames are not counted.

    Examples
    --------
    >>> scene = jl.datasets.moving(
    ...     motion="shake", sensor=jl.Sensor(frames=32), shape=(64, 64), photons=0.5, rng=0
    ... )
    >>> merged = jl.merge(scene.bits)
    >>> merged.shape, bool(merged.trials.max() <= 32)
    ((64, 64), True)
    """
    if not isinstance(motion, Motion | None):
        raise TypeError(
            "motion: expected a jotlight.Motion, as jotlight.align(bits) returns it, or "
            f"jotlight.Motion.load(path), got {motion!r}"
        )
    warn_about_contradictions(data, sensor)
    converted = counts_for_motion(data, sensor)
    counts, own = (data, sensor) if converted is None else (converted.counts, converted.sensor)
    of_kinds = frames_of_kinds(counts, own)
    bursts = _bursts_of_kinds(*of_kinds) if of_kinds else [prepare_burst(counts, own)]
    check_upsample(upsample, bursts[0][1] if of_kinds is None else of_kinds[1])
    with shown_progress(progress, "merging") as update:
        consistent = None
        if motion is None:
            found = find_motion(
                data, sensor, at, "auto", threads, lambda part: update(_ALIGNING * part, "aligning")
            )
            motion, consistent = found.motion, found.consistent
            update(_ALIGNING, "merging")
        motion.check_frames(bursts[0][0].size, len(data))
        if at is not None and reference_time(at, data) != motion.reference:
            motion, consistent = motion.seen_from(at), None
        time = motion.reference
        if converted is not None:
            motion = converted.in_cycles(motion)
        if of_kinds is None:
            merged, dark = _merge(*bursts[0], motion, consistent, upsample, threads)
        else:
            merged, dark = _merge_kinds(bursts, *of_kinds, motion, threads)
        update(1.0)
    report_dark(dark if converted is None else converted.frames_of(dark), time)
    return merged if converted is None else converted.correct(merged, threads)


def _merge(
    burst: Burst,
    sensor: Sensor,
    motion: Motion,
    consistent: Consistent | None,
    upsample: int,
    threads: int | None,
) -> tuple[Merged, list[range]]:
    """Return the counts along a motion, and the spans of dark frames.

    The sums along the motion are computed if they are not given.
    """
    paths = paths_along(burst, sensor, motion, threads)
    if motion.model == "none" and hot_jots(sensor) is not None:
        consistent = None
    merged = merge_along(paths, motion, sensor, consistent, upsample).merged
    return merged, paths.blocks.burst.dark_spans


def _bursts_of_kinds(data: Bits | CountStack, sensor: Sensor) -> list[tuple[Burst, Sensor]]:
    """Return the frames with a sensor for each kind of jots, whose other jots are dead."""
    height, width = jot_shape(data)[1:3]
    return [
        prepare_burst(data, own, may_repeat=True)
        for own in sensors_of_kinds(sensor, (height, width))
    ]


def _merge_kinds(
    bursts: list[tuple[Burst, Sensor]],
    data: Bits | CountStack,
    sensor: Sensor,
    motion: Motion,
    threads: int | None,
) -> tuple[Merged, list[range]]:
    """Return the counts along the motion from all kinds of jots, and the spans of dark frames.

    They are never those of a window without motion, which might differ from kind to kind.
    """
    merged, dark = [], []
    for burst, own in bursts:
        paths = paths_along(burst, own, motion, threads)
        merged.append(merge_along(paths, motion, own, may_stand_still=False).merged)
        dark = paths.blocks.burst.dark_spans
    joined = join_kinds(merged, sensor, threads)
    if motion.model == "none":
        if sensor.mosaic is None:
            return count_still(data, sensor, joined, threads), []
        warn(
            "the scene stands still, so each pixel was seen through one filter alone; reconstruct "
            "the bits in place of merged counts"
        )
    return joined, dark


def paths_along(
    burst: Burst,
    sensor: Sensor,
    motion: Motion,
    threads: int | None,
    edges: npt.NDArray[np.intp] | None = None,
) -> Paths:
    """Return the paths of a motion over the blocks of a burst.

    `edges` are those of the blocks. Default: those of :func:`block_edges`.
    """
    # If nothing moves, only a hot jot itself has seen its scene point. Otherwise others have, too.
    is_still = motion.model == "none"
    edges = block_edges(len(burst)) if edges is None else edges
    blocks = as_blocks(burst, edges, sensor, threads, with_hot_jots=is_still)
    return as_paths(motion, blocks)


def check_upsample(upsample: int, sensor: Sensor) -> None:
    """Raise ValueError unless the readings of a sensor can be merged onto a finer grid."""
    if whole_number_in_range("upsample", upsample, 1, 2) == 1:
        return
    if has_kinds(sensor):
        kinds = "a mosaic" if sensor.mosaic else "a map of thresholds"
        raise ValueError(
            f"upsample: expected 1 for a sensor with {kinds}, got {upsample}; leave out "
            "upsample= (--upsample)"
        )
    if sensor.oversampling > 1:
        raise ValueError(
            f"upsample: expected 1 for pixels of {sensor.oversampling} x {sensor.oversampling} "
            "jots; a sensor with an oversampling of 1 shows each jot as a pixel"
        )


def merge_along(
    paths: Paths,
    motion: Motion,
    sensor: Sensor,
    consistent: Consistent | None = None,
    upsample: int = 1,
    *,
    may_stand_still: bool = True,
    recall: Recall | None = None,
) -> MergedAlong:
    """Return the counts of the bits along paths, which are those of a motion.

    The sums along them are computed if they are not given. If the scene `may_stand_still`, a window
    without motion replaces them where the motion does not explain it better. `recall` adds bits to
    the sums unless such a window replaced them.
    """
    burst, threads = paths.blocks.burst, paths.blocks.threads
    if consistent is None:
        consistent = find_consistent(paths, is_still=motion.model == "none")
    halves = without_saturation(consistent.before, consistent.after, threads, consistent.lights)
    disagreements = disagreement(*halves, threads)
    unclear = unclear_pixels(consistent, disagreements, motion.model, threads)
    is_unclear = bool(unclear.any())
    # Few bits show that a dim scene moves, if its motion was not found.
    is_doubtful = is_unclear and motion.model == "none"
    by_bits = find_flags(consistent, disagreements, motion.labels, is_unclear=is_doubtful)
    # In a clear scene with one motion, nothing moves by itself.
    has_objects = is_unclear or motion.model == "segments"
    counted = select_bits(paths, consistent) if has_objects else consistent
    accepted, agreeing = counted.accepted, float(consistent.accepted.mean())
    of_channels = each_channel(paths)
    window = None
    if may_stand_still and by_bits.mean() > _MAX_FLAGGED:
        window = find_window(paths, consistent.total)
    if window is not None:
        report_window(window, motion.model)
        if upsample > 1:
            of_channels = [fine_paths(each) for each in of_channels]
        sums = [count_in_place(each, window) for each in of_channels]
        agreeing = len(window) / len(burst)
        accepted = np.full_like(accepted, agreeing)
        flags = by_bits = np.ones_like(by_bits)
    else:
        if is_unclear and not is_doubtful:
            by_bits = find_flags(consistent, disagreements, motion.labels, is_unclear=True)
        sums = _count(of_channels, counted, upsample)
        if recall is not None:
            trusted = ~by_bits & (consistent.accepted >= MIN_ACCEPTED)
            sums = recall(sums, trusted | (consistent.total.trials == 0))
        flags = flags_of_image(consistent, disagreements, motion, threads, unclear=unclear)
    finish = as_fine if upsample > 1 else as_merged
    merged = finish(sums, accepted, flags, motion, sensor, color=burst.color)
    return MergedAlong(merged, window, float(by_bits.mean()), agreeing, counted)


def _count(of_channels: list[Paths], consistent: Consistent, upsample: int) -> list[Sums]:
    """Return the sums of each channel along its paths, without bits that disagree."""
    if upsample > 1:
        return [count_fine(fine_paths(each), consistent) for each in of_channels]
    if len(of_channels) == 1:
        return [consistent.total]
    return [consistent.count(each) for each in of_channels]


def as_paths(motion: Motion, blocks: Blocks) -> Paths:
    """Return the paths of a motion over the blocks of a burst."""
    nodes = motion.nodes_at_times(blocks.centers)
    known = np.ones(len(blocks.centers), bool)
    unknown = np.zeros((len(known), 3, *nodes.shape[3:]))
    tracks = [
        Track(blocks, motion.reference, each.astype(np.float64), known, unknown.copy())
        for each in nodes
    ]
    return Paths(tracks, motion.labels, free=int(motion.model == "tiles"))


def each_channel(paths: Paths) -> list[Paths]:
    """Return the same paths over the bits of each channel."""
    number = paths.blocks.burst.channels
    channels = [None] if number == 1 else list(range(number))
    return [_of_channel(paths, channel) for channel in channels]


def _of_channel(paths: Paths, channel: int | None) -> Paths:
    """Return the same paths over the bits of one channel, or of the sum of all."""
    blocks = dataclasses.replace(paths.blocks, channel=channel)
    tracks = [dataclasses.replace(track, blocks=blocks) for track in paths.tracks]
    return dataclasses.replace(paths, tracks=tracks)
