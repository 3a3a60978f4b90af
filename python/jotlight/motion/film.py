"""Films: the motion of a scene, carried from image to image."""

import dataclasses
import warnings
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from jotlight.chunks import windows
from jotlight.errors import JotlightWarning
from jotlight.formats.capture import CountStack
from jotlight.motion.affine import SIGMAS, extrapolate, improve, improve_together, template_of
from jotlight.motion.align import align, as_blocks, as_motion, hot_jots, prepare_burst
from jotlight.motion.consistency import find_consistent
from jotlight.motion.deformation import improve_tiles, improve_tiles_together
from jotlight.motion.merge import as_paths, merge, merge_along
from jotlight.motion.model import divide
from jotlight.motion.motion import MODELS, Motion
from jotlight.motion.outlines import choose
from jotlight.motion.regularize import fit_affine
from jotlight.motion.scoring import FAST, normal_equations
from jotlight.motion.tiles import affine_inverse, mean_tiles, tile_counts
from jotlight.motion.track import Paths, Track
from jotlight.sensing.bits import Bits
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

Array = npt.NDArray[np.float64]

_MAX_CARRIED = 33
"""Number of images after which the motion is estimated afresh."""

_MIN_OVERLAP = 0.75
"""Minimum fraction of a window that the next one shares, for the motion to be carried."""

_MAX_LOSS = 0.03
"""The motion is estimated afresh if the fraction of accepted bits falls by more than this."""

_MIN_BLOCKS, _FRAMES_OF_BLOCK = 16, 16
"""Windows to which a motion is carried have fewer blocks than others, because it is known already:
16 or more, and blocks of 16 frames."""

_MIN_FRACTION = 0.5
"""Minimum fraction of a tile that a segment covers, for the tile to improve its motion."""

_MAX_STILL_GAIN = 18.0
"""Gain in nats by an affine motion of a block, above which a scene no longer stands still.

Twice the gain is χ² with six degrees of freedom, so this happens by chance once in 300,000 blocks.
"""


@dataclasses.dataclass(frozen=True)
class FilmImage:
    """The bits of one image of a film, merged along the motion of the scene."""

    merged: Merged
    motion: Motion
    """The motion. Times count from the first frame of the window."""
    is_carried: bool
    """Whether the motion is that of the image before, with new blocks at its end."""


def film(
    data: Bits | CountStack,
    sensor: Sensor | None = None,
    *,
    window: int,
    step: int | None = None,
    model: str = "auto",
    threads: int | None = None,
) -> Iterator[FilmImage]:
    """Return an iterator over the images of a film, each merged along the motion of the scene.

    Each image shows the middle of a window of frames. The motion of a window is carried to the next
    one, where only the new frames are aligned. It is estimated afresh for every 33rd image, and
    where many of the new bits disagree with the rest.

    Parameters
    ----------
    data : Bits or CountStack
        T frames of bits, or of counts as :func:`jotlight.open` returns them.
    sensor : Sensor, optional
        Sensor of the data. Default: the one of the bits.
    window : int
        Number of frames of each image, from 1 to T.
    step : int, optional
        Frames from one window to the next. Default: the size of a window. If it exceeds a
        quarter of a window, the motion of each window is estimated afresh.
    model : {"auto", "none", "affine", "segments", "tiles"}
        The model of the motion, as in :func:`jotlight.align`.
    threads : int, optional
        Number of threads. Default: all.

    Raises
    ------
    TypeError, ValueError
        When the data do not fit the sensor, or an argument is out of its range.

    Examples
    --------
    >>> from jotlight.datasets import moving
    >>> scene = moving(motion="shake", sensor=Sensor(frames=48), shape=(64, 64), photons=0.5, rng=1)
    >>> [image.is_carried for image in film(scene.bits, window=32, step=8)]
    [False, True, True]
    """
    burst, sensor = prepare_burst(data, sensor)
    if model != "auto" and model not in MODELS:
        raise ValueError(f"model: expected auto or one of {', '.join(MODELS)}, got {model!r}")
    spans = windows(len(data), window, step)
    # A frame of counts has several readings.
    part = sensor.replace(frames=sensor.frames * window // len(burst))
    return _images(data, part, spans, model, threads)


def _images(
    data: Bits | CountStack,
    sensor: Sensor,
    spans: list[slice],
    model: str,
    threads: int | None,
) -> Iterator[FilmImage]:
    """Yield the images of all windows, whose sensor is given."""
    before: FilmImage | None = None
    number, usual, step = 0, 0.0, 0
    for index, span in enumerate(spans):
        part = data[span]
        if index:
            step = span.start - spans[index - 1].start
        shared = 1 - step / (span.stop - span.start)
        image = None
        if before is not None and number < _MAX_CARRIED and shared >= _MIN_OVERLAP:
            image = _carried_image(before.motion, part, sensor, step, usual - _MAX_LOSS, threads)
        if image is None:
            motion = align(part, sensor, model=model, threads=threads)
            burst, sensor = prepare_burst(part, sensor)
            blocks = as_blocks(burst, divide(len(burst)), sensor, threads)
            merged = _merge(as_paths(motion, blocks), motion, part, sensor)
            image = FilmImage(merged, motion, False)
            number, usual = 0, _accepted(merged)
        number += 1
        yield image
        # Where merging has rejected the motion, it is not carried.
        before = None if image.merged.flags is not None and image.merged.flags.all() else image


def _carried_image(
    motion: Motion,
    part: Bits | CountStack,
    sensor: Sensor,
    step: int,
    min_accepted: float,
    threads: int | None,
) -> FilmImage | None:
    """Return the image of a window along the motion of the one before, or None if it is lost."""
    paths = carry(motion, part, sensor, step, threads)
    if paths is None:
        return None
    carried = as_motion(paths, motion.model)
    with warnings.catch_warnings():
        # A motion that is lost is estimated afresh, so a warning about it would mislead.
        warnings.simplefilter("ignore", JotlightWarning)
        merged = _merge(paths, carried, part, sensor)
    return FilmImage(merged, carried, True) if _accepted(merged) >= min_accepted else None


def _merge(paths: Paths, motion: Motion, part: Bits | CountStack, sensor: Sensor) -> Merged:
    """Return the merged bits of a window, with fast templates."""
    if motion.model == "none" and hot_jots(sensor) is not None:
        # The alignment leaves out hot jots, but merging counts them if nothing moves.
        return merge(part, sensor, motion=motion, threads=paths.blocks.threads)
    consistent = find_consistent(paths, is_still=motion.model == "none", network=FAST)
    return merge_along(paths, motion, sensor, consistent)


def _accepted(merged: Merged) -> float:
    """Return the fraction of the bits that were counted."""
    return 1.0 if merged.acceptance is None else float(merged.acceptance.mean())


def carry(
    motion: Motion,
    data: Bits | CountStack,
    sensor: Sensor,
    step: int,
    threads: int | None = None,
) -> Paths | None:
    """Return the paths of a window, from the motion of the window that begins `step` frames before.

    The blocks that both windows share keep their displacements. New ones are aligned with them.
    Then all are improved together.

    Returns
    -------
    Paths or None
        None if a scene that stood still begins to move, or if nothing stays in view, as after a cut
        to another scene, or if the motion folds the image.
    """
    burst, sensor = prepare_burst(data, sensor)
    blocks = as_blocks(burst, divide_by_steps(len(burst), step), sensor, threads)
    before = dataclasses.replace(
        motion, times=motion.times - step, reference=motion.reference - step
    )
    try:
        seen = before.seen_from(float(len(burst) // 2))
    except ValueError:
        # A wrong motion of tiles may fold the image, so that its displacements have no bounds.
        return None
    paths = as_paths(seen, blocks)
    if not _stays_in_view(paths):
        return None
    # Edges are rounded, so centers differ by up to half a frame.
    known = blocks.centers <= before.times[-1] + 0.5
    if motion.model == "none":
        return None if _begins_to_move(paths.tracks[0], known) else paths
    for field, track in enumerate(paths.tracks):
        share = mean_tiles((paths.labels == field).astype(np.float32))
        weights = np.where(share >= _MIN_FRACTION, share, 0)
        # The field of tiles is the last one.
        is_of_tiles = motion.model == "tiles" and track is paths.tracks[-1]
        _add_blocks(track, known, weights if weights.any() else share, is_of_tiles)
    if not _stays_in_view(paths):
        return None
    return Paths(paths.tracks, choose(paths.tracks))


def _stays_in_view(paths: Paths) -> bool:
    """Return whether all displacements are smaller than the image."""
    longest = max(float(abs(track.nodes).max()) for track in paths.tracks)
    return longest < max(paths.blocks.size)  # False for NaN, too


def divide_by_steps(frames: int, step: int) -> npt.NDArray[np.intp]:
    """Return the edges of the blocks of a window.

    Blocks have 16 frames, but there are 16 blocks or more. From 512 frames on, there are as many as
    those of :func:`jotlight.motion.model.divide`. If the step has a block or more, it has a whole
    number of blocks, so that successive windows share blocks.

    Examples
    --------
    >>> divide_by_steps(64, 10).tolist()
    [0, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 64]
    >>> divide_by_steps(256, 32).tolist() == list(range(0, 257, 16))
    True
    """
    most = len(divide(frames)) - 1
    length = frames / min(most, max(_MIN_BLOCKS, frames // _FRAMES_OF_BLOCK))
    if step >= length:
        length = step / round(step / length)
    elif step >= frames / most:
        length = step
    # Unlike np.round, this rounds all halves upward, so that edges have the same distances.
    edges = np.floor(np.arange(0, frames - length / 2, length) + 0.5).astype(np.intp)
    return np.append(edges, frames)


def _add_blocks(
    track: Track, known: npt.NDArray[np.bool_], weights: Array, is_of_tiles: bool
) -> None:
    """Align the new blocks of a track with those that are known, and improve all together."""
    track.known = known.copy()
    velocity = np.zeros(track.nodes.shape[1:])
    template = template_of(track)
    for block in np.flatnonzero(~known):
        extrapolate(track, int(block), velocity)
        for sigma in SIGMAS:
            if is_of_tiles:
                improve_tiles(track, int(block), template, sigma)
            else:
                improve(track, int(block), template, sigma, weights)
        track.known[block] = True
    if is_of_tiles:
        improve_tiles_together(track, template)
    else:
        improve_together(track, weights, template=template)


def _begins_to_move(track: Track, known: npt.NDArray[np.bool_]) -> bool:
    """Return whether the new blocks of a scene that stood still have moved."""
    track.known = known.copy()
    template = template_of(track)
    inverse = affine_inverse(tile_counts(track.blocks.size))
    track.known[:] = True
    for block in np.flatnonzero(~known):
        equations = normal_equations(track.sums(int(block)), template, SIGMAS[-1])
        errors, information = fit_affine(equations, np.ones(track.nodes.shape[2:]))
        parameters = (errors.reshape(2, -1) @ inverse.T).ravel()
        if parameters @ information @ parameters / 2 > _MAX_STILL_GAIN:
            return True
    return False
