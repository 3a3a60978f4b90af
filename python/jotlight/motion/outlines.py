"""Outlines: which of several motions each pixel follows."""

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from jotlight.motion.blocks import Sums
from jotlight.motion.consistency import chi_squared
from jotlight.motion.scoring import make_template
from jotlight.motion.track import Track

Array = npt.NDArray[np.float64]
Labels = npt.NDArray[np.uint8]

_CENTRAL_FRACTION = 8
"""The central 1/8 of the blocks are the template."""

_GROUPS = 16
"""Number of groups of blocks that are compared with it."""

_MAX_COST = 5.0
"""Values of χ² above this one count as this one."""

_OTHER_SIDE = 0.25
"""Weight of the side of the reference time on which a motion explains the pixel worse.

Something may hide the pixel before or after the reference time, but rarely both.
"""

_LENGTH = 3.0
"""Cost of an outline per pixel of its length, in units of the mean χ² of a pixel."""

_CELL = 4
"""Width of the squares in which outlines are searched, in pixels."""

_ITERATIONS, _TOLERANCE, _STEP = 300, 2e-4, 0.25
"""Maximum number of iterations that shorten outlines, the change of the energy at which they end,
as a fraction of the first energy, and the length of a step."""

_MARGIN = 0.05
"""Cost of all motions but the most frequent one."""


def choose_labels(tracks: Sequence[Track]) -> Labels:
    """Return the index of the motion that each pixel follows, (H, W).

    The cost of a motion is the mean χ² of the blocks along it, compared with the central blocks.
    Outlines are short: the total cost includes their length.
    """
    size = tracks[0].blocks.size
    if len(tracks) == 1:
        return np.zeros(size, np.uint8)
    costs = np.stack([_cost(track) for track in tracks])
    excess = costs - costs.mean(axis=0)
    smooth = np.stack([_with_short_outlines(each) for each in excess])
    frequent = int(np.bincount(smooth.argmin(axis=0).ravel()).argmax())
    smooth[frequent] -= _MARGIN
    return np.asarray(smooth.argmin(axis=0), np.uint8)


def _cost(track: Track) -> npt.NDArray[np.float32]:
    """Return the mean χ² of each pixel along a motion, mostly of the better side in time."""
    number = len(track.nodes)
    order = track.from_center()
    central = max(2, number // _CENTRAL_FRACTION)
    threads = track.blocks.threads

    def total(blocks: Iterable[int]) -> Sums:
        return Sums.total((track.sums(int(block)) for block in blocks), threads)

    template = make_template(total(order[:central]), threads)
    length = max(1, number // _GROUPS)
    sides = []
    for is_later in (False, True):
        blocks = [
            int(block)
            for block in order[central:]
            if (track.blocks.centers[block] > track.reference) == is_later
        ]
        groups = [blocks[first : first + length] for first in range(0, len(blocks), length)]
        if not groups:
            continue
        costs = [np.minimum(chi_squared(total(group), template), _MAX_COST) for group in groups]
        sides.append(np.mean(costs, axis=0))
    low, high = np.min(sides, axis=0), np.max(sides, axis=0)
    return np.asarray((1 - _OTHER_SIDE) * low + _OTHER_SIDE * high, np.float32)


def _with_short_outlines(cost: npt.NDArray[np.float32]) -> Array:
    """Return a cost whose level sets minimize its sum plus the cost of their outlines, (H, W).

    The minimizer of total variation has this property (Rudin, Osher, and Fatemi 1992; Chambolle
    2004).
    """
    from scipy.ndimage import zoom

    height, width = cost.shape
    padded = np.pad(cost, ((0, -height % _CELL), (0, -width % _CELL)), mode="edge")
    rows, columns = (length // _CELL for length in padded.shape)
    cells = padded.reshape(rows, _CELL, columns, _CELL).mean(axis=(1, 3), dtype=np.float64)
    smooth = with_little_variation(cells, _LENGTH / _CELL)
    fine = zoom(smooth, _CELL, order=1, mode="nearest", grid_mode=True)
    return np.asarray(fine[:height, :width])


def with_little_variation(image: Array, weight: float) -> Array:
    """Return the image u that minimizes ½ Σ (u - image)² + weight Σ |∇u|, nearly.

    It is that of `skimage.restoration.denoise_tv_chambolle`, whose import takes half a second.

    Examples
    --------
    >>> with_little_variation(np.array([[0.0, 0.0, 4.0, 4.0]]), 1.0).round(1).tolist()
    [[0.5, 0.5, 3.5, 3.5]]
    """
    flow, slopes = np.zeros((2, 2, *image.shape))
    change, smooth, first, last = np.zeros_like(image), image, 0.0, 0.0
    for iteration in range(_ITERATIONS):
        if iteration > 0:
            change = -(flow[0] + flow[1])
            change[1:] += flow[0, :-1]
            change[:, 1:] += flow[1, :, :-1]
            smooth = image + change
        slopes[0, :-1], slopes[1, :, :-1] = np.diff(smooth, axis=0), np.diff(smooth, axis=1)
        length = np.sqrt(slopes[0] ** 2 + slopes[1] ** 2)
        energy = float((change**2).sum() + weight * length.sum())
        flow = (flow - _STEP * slopes) / (1 + _STEP / weight * length)
        if iteration == 0:
            first = energy
        elif abs(last - energy) < _TOLERANCE * first:
            break
        last = energy
    return smooth
