"""Alignment: the motion of a scene, estimated from its bits."""

import dataclasses
import itertools
from collections.abc import Callable, Sized
from typing import NamedTuple

import numpy as np

from jotlight.checks import real_number
from jotlight.errors import warn
from jotlight.estimators.planning.planned_motion import MIN_FRAMES
from jotlight.formats.capture import CountStack, jot_shape
from jotlight.motion.agreement.consistency import Consistent
from jotlight.motion.counts.block_edges import block_edges
from jotlight.motion.counts.blocks import Blocks
from jotlight.motion.counts.burst import Burst, as_burst, refuse_pixels
from jotlight.motion.counts.dark_frames import report_dark
from jotlight.motion.counts.reading_counts import ReadingCounts, ReadingStack, counts_for_motion
from jotlight.motion.counts.sensor_blocks import as_blocks, excluded_jots
from jotlight.motion.displacements.track import Paths
from jotlight.motion.fast_motion import find_fast_motion, report_fast_motion
from jotlight.motion.merging.jot_kinds import frames_of_kinds
from jotlight.motion.merging.jot_squares import enlarge_motion, in_squares, squares_side
from jotlight.motion.motion import MODELS, Motion
from jotlight.motion.path_search import find_paths
from jotlight.motion.tiles import TILE, tile_counts
from jotlight.parameter_names import check_choice
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.alike_frames import require_alike_frames
from jotlight.sensing.data.contradictions import warn_about_contradictions
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.data.periodic_rates import warn_about_periods
from jotlight.sensing.parameters.reading_groups import refuse_mosaic, without_mosaic
from jotlight.sensing.sensor import Sensor


def align(
    data: Bits | CountStack | Readings,
    sensor: Sensor | None = None,
    at: float | None = None,
    model: str = "auto",
    *,
    threads: int | None = None,
    progress: Progress = None,
) -> Motion:
    """Return the motion of a scene, estimated from the bits that a sensor recorded.

    Parameters
    ----------
    data : Bits, CountStack, or Readings
        T frames of bits, of readings of several bits, or of counts as
        :func:`jotlight.formats.open_capture` returns them. The method needs 16 frames or more. All
        color channels have the same motion. The exposures of a bracket repeat in cycles of frames,
        of which 16 or more are needed.
    sensor : Sensor, optional
        Sensor of the data. Its dead and hot jots are not used, and its maps of the efficiency and
        of the dark counts are part of the likelihood. Default: the one of the bits.
    at : float, optional
        Reference time, from 0 to T - 1 in frames: the time that the image will show. Default: the
        middle, T // 2, or for a bracket the middle of the cycle there. If this frame is dark, it is
        the middle of the others.
    model : {"auto", "none", "affine", "segments", "tiles"}
        The model of the motion. "auto" selects the one that explains the bits best.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction. Default: a bar in notebooks.

    Returns
    -------
    Motion
        Displacements of all jots, at all times.

    Raises
    ------
    TypeError, ValueError
        When the data do not fit the sensor, or an argument is out of its range.

    Warns
    -----
    JotlightWarning
        When the motion cannot be estimated, because there are fewer than 16 frames or because all
        bits are equal. The scene is then assumed to stand still. Also when the scene moves so far
        that some frames show nothing of the image at the reference time, and when frames are dark:
        when they have less than 1/8 of the mean light. Dark frames are not used.

    Notes
    -----
    From 1,024 frames on, the memory grows with the square root of the number of frames.
    :func:`jotlight.motion.cost.motion_cost` estimates it.
    The method is described in docs/decisions/0019-motion.md.

    Examples
    --------
    >>> scene = jl.datasets.moving(
    ...     motion="shake", sensor=jl.Sensor(frames=32), shape=(64, 96), photons=0.5, rng=0
    ... )
    >>> motion = jl.align(scene.bits)
    >>> motion.model, motion.at(31).shape
    ('affine', (2, 64, 96))
    """
    warn_about_contradictions(data, sensor)
    with shown_progress(progress, "aligning") as update:
        found = find_motion(data, sensor, at, model, threads, update)
    report_dark(found.dark, found.motion.reference)
    return found.motion


class FoundMotion(NamedTuple):
    """A motion that was found."""

    motion: Motion
    consistent: Consistent | None
    """The sums along it, if they are known."""
    dark: list[range]
    """The spans of frames without light."""


def find_motion(
    data: Bits | CountStack | Readings,
    sensor: Sensor | None,
    at: float | None,
    model: str,
    threads: int | None,
    progress: Callable[[float], object],
) -> FoundMotion:
    """Return the motion that :func:`align` returns, without a warning about dark frames."""
    if (converted := counts_for_motion(data, sensor)) is not None:
        return _motion_of_counts(converted, at, model, threads, progress)
    if (of_kinds := frames_of_kinds(data, sensor)) is not None:
        return _motion_of_squares(*of_kinds, at, model, threads, progress)
    burst, sensor = prepare_burst(data, sensor)
    check_choice("model", model, ("auto", *MODELS))
    time = reference_time(at, burst)
    blocks = as_blocks(burst, block_edges(len(burst)), sensor, threads)
    if at is None:
        time = _lit_time(blocks)
    if (reason := _unusable(blocks)) is not None:
        warn(f"{reason}; the scene is assumed to stand still")
        model = "none"
    found = find_paths(blocks, model, progress)
    if (hidden := _frames_out_of_view(found.paths)) > 0:
        warn(
            f"what the image shows is out of view in {hidden} of {len(burst)} frames, which are "
            "not used; take a shorter part of the burst, or another time `at`"
        )
    if blocks.burst.number_lit(range(len(burst))) >= MIN_FRAMES:
        total = None if found.consistent is None else found.consistent.total
        length = len(burst) / len(blocks.centers)
        report_fast_motion(find_fast_motion(found.paths, total), length)
    motion, dark = as_motion(found.paths, found.model), blocks.burst.dark_spans
    if time != motion.reference:
        return FoundMotion(seen_from(motion, time), None, dark)
    return FoundMotion(motion, found.consistent, dark)


def seen_from(motion: Motion, time: float) -> Motion:
    """Return a motion as seen from a time, or that of a scene that stands still, with a warning.

    A wrong motion may fold the image, so that its displacements have no bounds.
    """
    try:
        return motion.seen_from(time)
    except ValueError:
        warn(
            f"the motion that was found is wrong: at time {time:g}, it folds the image; the scene "
            "is assumed to stand still"
        )
    nodes, information = (np.zeros_like(each[:1]) for each in (motion.nodes, motion.information))
    labels = np.zeros_like(motion.labels)
    return Motion(nodes, labels, motion.times, time, "none", information)


def _motion_of_counts(
    converted: ReadingCounts,
    at: float | None,
    model: str,
    threads: int | None,
    progress: Callable[[float], object],
) -> FoundMotion:
    """Return the motion of readings that become counts of single bits, as :func:`find_motion`."""
    counts = converted.counts, converted.sensor
    time = reference_time(at, converted.readings)
    found = find_motion(*counts, None, model, threads, progress)
    motion, dark = converted.in_frames(found.motion), converted.frames_of(found.dark)
    if at is None or time == motion.reference:
        return FoundMotion(motion, found.consistent, dark)
    return FoundMotion(seen_from(motion, time), None, dark)


def _motion_of_squares(
    data: Bits | CountStack,
    sensor: Sensor,
    at: float | None,
    model: str,
    threads: int | None,
    progress: Callable[[float], object],
) -> FoundMotion:
    """Return the motion of a scene that kinds of jots show, from sums over squares of them."""
    gray = without_mosaic(sensor)
    squares, own = in_squares(data, sensor, excluded_jots(gray))
    found = find_motion(squares, own, at, model, threads, progress)
    side = squares_side(sensor)
    height, width = jot_shape(data)[1:3]
    return FoundMotion(enlarge_motion(found.motion, side, (height, width)), None, found.dark)


def prepare_burst(
    data: Bits | CountStack | Readings, sensor: Sensor | None, *, may_repeat: bool = False
) -> tuple[Burst, Sensor]:
    """Return the frames of the data and their sensor, after a test for periodic rates.

    There is no such test if the rates `may_repeat`.

    Raises
    ------
    TypeError, ValueError
        When the data are of another type, or do not fit the sensor.
    """
    if sensor is None and isinstance(data, Bits):
        sensor = carried_sensor(data)
    if not isinstance(sensor, Sensor | None):
        raise TypeError(
            f"sensor: expected a jotlight.Sensor, got {type(sensor).__name__}; pass other "
            "arguments by their names, such as motion=motion"
        )
    if sensor is not None:
        refuse_mosaic(sensor)
        require_alike_frames(sensor)
    if isinstance(data, CountStack) and sensor is not None:
        refuse_pixels(sensor)
        data = data.with_trials_of(sensor)
    burst = as_burst(data)
    if sensor is None:
        sensor = Sensor(frames=burst.trials // burst.channels * len(burst))
    if not isinstance(data, ReadingStack):
        burst = dataclasses.replace(burst, threshold=sensor.threshold)
    if isinstance(data, Bits):
        check_fits(data.shape, sensor)
    sensor.check_map_shapes(*burst.size)
    if not may_repeat:
        jots = data[:MIN_FRAMES].sum()[None] if isinstance(data, CountStack) else data
        warn_about_periods([jots])
    return burst, sensor


def reference_time(at: float | None, burst: Sized) -> float:
    """Return the reference time: `at`, or the middle of the frames of a burst.

    Raises
    ------
    ValueError
        When it lies outside of the burst.
    """
    if at is None:
        return len(burst) // 2
    if not 0 <= real_number(at) <= len(burst) - 1:
        raise ValueError(f"at: expected a time from 0 to {len(burst) - 1} in frames, got {at!r}")
    return at


def _lit_time(blocks: Blocks) -> float:
    """Return the middle frame, or if this is dark, a lit frame near the middle of the others."""
    middle, dark = len(blocks.burst) // 2, blocks.burst.dark
    if dark is None or not dark[middle]:
        return float(middle)
    lit = np.flatnonzero(~dark)
    return float(lit[abs(lit - blocks.middle).argmin()])


def _unusable(blocks: Blocks) -> str | None:
    """Return why no motion can be estimated, or None if one can be."""
    burst = blocks.burst
    if (lit := burst.number_lit(range(len(burst)))) < MIN_FRAMES:
        return (
            f"expected {MIN_FRAMES} or more frames{' with light' if lit < len(burst) else ''}, "
            "images of counts, or cycles of exposures, to "
            f"estimate a motion, got {lit}"
        )
    if blocks.valid is not None and not blocks.valid.any():
        return "all jots are dead or hot, so that no motion can be estimated"
    total = burst.counts(range(len(burst)), blocks.threads)
    if total.min() == total.max() and total.flat[0] in (0, len(burst) * burst.trials):
        return f"all bits are {int(total.flat[0] > 0)}, so that no motion can be estimated"
    return None


def _frames_out_of_view(paths: Paths) -> int:
    """Return the number of frames with light in blocks that show no point of the image."""
    size = np.array(paths.blocks.size).reshape(2, 1, 1)
    corners = TILE * np.indices(tile_counts(paths.blocks.size))
    hidden = 0
    edges, burst = paths.blocks.edges.tolist(), paths.blocks.burst
    for block, (start, stop) in enumerate(itertools.pairwise(edges)):
        in_view = False
        for track in paths.tracks:
            place = corners + track.nodes[block]
            in_view |= bool(((place > -TILE) & (place < size)).all(axis=0).any())
        hidden += 0 if in_view else burst.number_lit(range(start, stop))
    return hidden


def as_motion(paths: Paths, model: str) -> Motion:
    """Return paths as a motion, without the fields that no pixel follows."""
    used = np.unique(paths.labels) if len(paths.tracks) > 1 else np.zeros(1, np.uint8)
    nodes, information = (
        np.stack([getattr(paths.tracks[index], name) for index in used]).astype(np.float32)
        for name in ("nodes", "information")
    )
    times = paths.blocks.centers
    if len(times) == 1:
        # A motion has two times or more.
        nodes, information = nodes.repeat(2, axis=1), information.repeat(2, axis=1)
        times = times[0] + np.arange(2.0)
    labels = np.searchsorted(used, paths.labels).astype(np.uint8)
    if model == "segments" and len(used) == 1:
        model = "affine"
    return Motion(nodes, labels, times, float(paths.reference), model, information)
