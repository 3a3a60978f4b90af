"""Alignment: the motion of a scene, estimated from its bits."""

import dataclasses
from collections.abc import Callable, Sized

import numpy as np
import numpy.typing as npt

from jotlight.checks import real_number
from jotlight.errors import warn
from jotlight.estimators.planned_motion import MIN_FRAMES
from jotlight.formats.capture import CountStack, jot_shape
from jotlight.motion.block_edges import block_edges
from jotlight.motion.blocks import Blocks
from jotlight.motion.burst import Burst, as_burst, refuse_pixels
from jotlight.motion.consistency import Consistent
from jotlight.motion.jot_kinds import frames_of_kinds
from jotlight.motion.jots import Jots
from jotlight.motion.motion import MODELS, Motion
from jotlight.motion.path_search import find_paths
from jotlight.motion.reading_counts import ReadingCounts, ReadingStack, counts_for_motion
from jotlight.motion.squares import enlarge_motion, in_squares, squares_side
from jotlight.motion.tiles import TILE, tile_counts
from jotlight.motion.track import Paths
from jotlight.parameter_names import check_choice
from jotlight.progress import Progress, shown_progress
from jotlight.sensing.alike_frames import require_alike_frames
from jotlight.sensing.bits import Bits
from jotlight.sensing.bits_checks import check_fits
from jotlight.sensing.periodic_rates import warn_about_periods
from jotlight.sensing.pixel_counts import carried_sensor
from jotlight.sensing.reading_groups import refuse_mosaic, without_mosaic
from jotlight.sensing.readings import Readings
from jotlight.sensing.sensor import Sensor

_MIN_HOT_RATIO = 5.0
"""Jots with dark counts above this multiple of the median are hot, if they exceed the light, too.

They stand still, so they would pull the motion toward 0.
"""


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
        middle, T // 2, or for a bracket the middle of the cycle there.
    model : {"auto", "none", "affine", "segments", "tiles"}
        The model of the motion. "auto" selects the one that explains the bits best.
    threads : int, optional
        Number of threads. Default: all.
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
        that some frames show nothing of the image at the reference time.

    Notes
    -----
    From 1,024 frames on, the memory grows with the square root of the number of frames.
    :func:`jotlight.motion.cost.motion_cost` estimates it.
    The method is described in docs/decisions/0019-motion.md.

    Examples
    --------
    >>> from jotlight.datasets import moving
    >>> scene = moving(motion="shake", sensor=Sensor(frames=32), shape=(64, 96), photons=0.5, rng=0)
    >>> motion = align(scene.bits)
    >>> motion.model, motion.at(31).shape
    ('affine', (2, 64, 96))
    """
    with shown_progress(progress, "aligning") as update:
        return find_motion(data, sensor, at, model, threads, update)[0]


def find_motion(
    data: Bits | CountStack | Readings,
    sensor: Sensor | None,
    at: float | None,
    model: str,
    threads: int | None,
    progress: Callable[[float], object],
) -> tuple[Motion, Consistent | None]:
    """Return the motion that :func:`align` returns, and the sums along it if they are known."""
    if (converted := counts_for_motion(data, sensor)) is not None:
        return _motion_of_counts(converted, at, model, threads, progress)
    if (of_kinds := frames_of_kinds(data, sensor)) is not None:
        return _motion_of_squares(*of_kinds, at, model, threads, progress), None
    burst, sensor = prepare_burst(data, sensor)
    check_choice("model", model, ("auto", *MODELS))
    time = reference_time(at, burst)
    blocks = as_blocks(burst, block_edges(len(burst)), sensor, threads)
    if (reason := _unusable(blocks)) is not None:
        warn(f"{reason}; the scene is assumed to stand still")
        model = "none"
    found = find_paths(blocks, model, progress)
    if (hidden := _frames_out_of_view(found.paths)) > 0:
        warn(
            f"what the image shows is out of view in {hidden} of {len(burst)} frames, which are "
            "not used; take a shorter part of the burst, or another time `at`"
        )
    motion = as_motion(found.paths, found.model)
    if time != motion.reference:
        return motion.seen_from(time), None
    return motion, found.consistent


def _motion_of_counts(
    converted: ReadingCounts,
    at: float | None,
    model: str,
    threads: int | None,
    progress: Callable[[float], object],
) -> tuple[Motion, Consistent | None]:
    """Return the motion of readings that become counts of single bits, as :func:`find_motion`."""
    counts = converted.counts, converted.sensor
    time = reference_time(at, converted.readings)
    motion, consistent = find_motion(*counts, None, model, threads, progress)
    motion = converted.in_frames(motion)
    if at is None or time == motion.reference:
        return motion, consistent
    return motion.seen_from(time), None


def _motion_of_squares(
    data: Bits | CountStack,
    sensor: Sensor,
    at: float | None,
    model: str,
    threads: int | None,
    progress: Callable[[float], object],
) -> Motion:
    """Return the motion of a scene that kinds of jots show, from sums over squares of them."""
    gray = without_mosaic(sensor)
    squares, own = in_squares(data, sensor, excluded_jots(gray))
    motion, _ = find_motion(squares, own, at, model, threads, progress)
    side = squares_side(sensor)
    height, width = jot_shape(data)[1:3]
    return enlarge_motion(motion, side, (height, width))


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


def as_blocks(
    burst: Burst,
    edges: npt.NDArray[np.intp],
    sensor: Sensor,
    threads: int | None,
    *,
    with_hot_jots: bool = False,
) -> Blocks:
    """Return the blocks of a burst that a sensor recorded.

    Parameters
    ----------
    burst, edges, threads
        As for :class:`jotlight.motion.blocks.Blocks`.
    sensor : Sensor
        The sensor. Its dead jots are not counted.
    with_hot_jots : bool
        Whether hot jots are counted.
    """
    valid = valid_jots(sensor, with_hot_jots=with_hot_jots)
    jots = Jots.of_sensor(sensor, burst.size, valid)
    return Blocks(burst, edges, valid, threads, jots=jots)


def valid_jots(sensor: Sensor, *, with_hot_jots: bool = False) -> npt.NDArray[np.uint8] | None:
    """Return the packed mask of the jots that are neither dead nor hot, or None if all are good."""
    excluded = sensor.mask if with_hot_jots else excluded_jots(sensor)
    if excluded is None or not excluded.any():
        return None
    return np.packbits(~excluded, axis=1)


def excluded_jots(sensor: Sensor) -> npt.NDArray[np.bool_] | None:
    """Return the jots that are dead or hot, or None if there are none."""
    dead, hot = sensor.mask, hot_jots(sensor)
    return dead if hot is None else hot if dead is None else dead | hot


def hot_jots(sensor: Sensor) -> npt.NDArray[np.bool_] | None:
    """Return the hot jots, or None if there are none."""
    dark = sensor.dark_counts
    if not isinstance(dark, np.ndarray):
        return None
    light = sensor.light_per_intensity * sensor.max_intensity
    hot = (dark > _MIN_HOT_RATIO * np.median(dark)) & (dark > 0.01 * light)
    return hot if hot.any() else None


def _unusable(blocks: Blocks) -> str | None:
    """Return why no motion can be estimated, or None if one can be."""
    burst = blocks.burst
    if len(burst) < MIN_FRAMES:
        return (
            f"expected {MIN_FRAMES} or more frames, images of counts, or cycles of exposures, to "
            f"estimate a motion, got {len(burst)}"
        )
    if blocks.valid is not None and not blocks.valid.any():
        return "all jots are dead or hot, so that no motion can be estimated"
    total = burst.counts(range(len(burst)), blocks.threads)
    if total.min() == total.max() and total.flat[0] in (0, len(burst) * burst.trials):
        return f"all bits are {int(total.flat[0] > 0)}, so that no motion can be estimated"
    return None


def _frames_out_of_view(paths: Paths) -> int:
    """Return the number of frames in blocks that show no point of the image."""
    size = np.array(paths.blocks.size).reshape(2, 1, 1)
    corners = TILE * np.indices(tile_counts(paths.blocks.size))
    hidden = 0
    for block, length in enumerate(np.diff(paths.blocks.edges)):
        in_view = False
        for track in paths.tracks:
            place = corners + track.nodes[block]
            in_view |= bool(((place > -TILE) & (place < size)).all(axis=0).any())
        hidden += 0 if in_view else int(length)
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
    return Motion(nodes, labels, times, float(paths.reference), model, information)
