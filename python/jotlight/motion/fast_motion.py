"""Motion within blocks, which is faster than the displacements of an alignment can follow.

An alignment finds a displacement for each block of frames. If the scene vibrates or jitters within
blocks, the image is blurred, and nothing else shows it. So some blocks are divided into parts of
one frame, of four, and so on. The translation of each part, relative to the template of all frames,
has noise of a known size. Further deviations from a constant velocity within a block are fast
motion.
"""

import math

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.errors import warn
from jotlight.motion.counts.sums import Sums
from jotlight.motion.displacements.scoring import Template, make_blurred_template, normal_equations
from jotlight.motion.displacements.track import Paths, Track

_MIN_DEVIATION, _MIN_CLEAR = 0.5, 10.0
"""Fast motion is reported if its standard deviation exceeds this number of pixels, and its χ² that
of noise by this number of standard deviations."""

_OFTEN = 0.75
"""Minimum fraction of the blocks in which there is fast motion. A single jump is none."""

_SIGMA = 2.0
"""Width of the filter, which shows displacements of a few pixels."""

_FACTOR = 4
"""Ratio of the lengths of the parts of successive scales."""

_MAX_PARTS, _BLOCKS, _PIXELS = 4, (2, 16), 1 << 20
"""Maximum number of parts of a block, and range of the number of blocks that are divided.

All parts together have about this number of pixels, which show fast motion clearly.
"""


def find_fast_motion(paths: Paths, total: Sums | None) -> float:
    """Return the standard deviation of motion within blocks in pixels, or 0 if none is clear.

    It is that of the background: of the track that most pixels follow.

    Parameters
    ----------
    paths : Paths
        The paths that were found.
    total : Sums, optional
        The sums of all bits that agree with them. Default: those of all bits.
    """
    if paths.blocks.jots is not None:
        return 0.0  # what remains of their pattern would look like motion
    largest = int(np.bincount(paths.labels.ravel()).argmax())
    pixels = paths.labels == largest
    track = paths.tracks[largest].inside(None if pixels.all() else pixels)
    if total is None:
        total = Sums.total(map(track.sums, range(len(track.nodes))), track.blocks.threads)
    template = make_blurred_template(total, track.blocks.threads)
    lit = np.flatnonzero(track.blocks.is_lit)
    number = int(np.clip(_PIXELS // (_MAX_PARTS * pixels.size), *_BLOCKS))
    chosen = lit[np.unique(((np.arange(number) + 0.5) * len(lit) / number).astype(int))]
    found, length = 0.0, 1
    longest = int(np.diff(track.blocks.edges).max())
    while 3 * length <= longest:
        found = max(found, _deviation(track, template, chosen, length))
        length *= _FACTOR
    return found


def report_fast_motion(deviation: float, frames: float) -> None:
    """Warn about motion within blocks of some mean number of frames."""
    if deviation > 0:
        warn(
            f"the scene moves by about {deviation:.1f} pixels (standard deviation) within "
            f"{frames:.0f} frames, which is faster than --motion follows, so the image is blurred; "
            "align fewer frames at a time, which are followed more closely"
        )


def _deviation(
    track: Track, template: Template, blocks: npt.NDArray[np.intp], length: int
) -> float:
    """Return the standard deviation of parts of a length within blocks, or 0 if it is not clear."""
    each, freedom, information = [], 0, 0.0
    for block in blocks:
        times, matrices, right = _equations(track, template, int(block), length)
        if len(times) < 3:
            continue
        # The translations of the parts are linear in time, as those of a slow motion.
        design = np.kron(np.stack([np.ones_like(times), times], axis=1), np.eye(2))
        design = design.reshape(len(times), 2, 4)
        total = np.einsum("nia,nij,njb->ab", design, matrices, design)
        line = design @ (np.linalg.pinv(total) @ np.einsum("nia,ni->a", design, right))
        # With the translations e = A⁻¹ b of the parts, this is Σ (e - line)ᵀ A (e - line).
        residuals = right - np.einsum("nij,nj->ni", matrices, line)
        inverses = np.linalg.pinv(matrices, hermitian=True)
        own = 2 * (len(times) - 2)
        each.append(float(np.einsum("ni,nij,nj->", residuals, inverses, residuals)) - own)
        freedom += own
        information += float(np.trace(matrices.sum(axis=0))) * (1 - 2 / len(times))
    excess, often = sum(each), sum(part > 0 for part in each)
    if excess <= _MIN_CLEAR * math.sqrt(2 * freedom) or often < _OFTEN * len(each):
        return 0.0
    deviation = math.sqrt(excess / information)
    return deviation if deviation > _MIN_DEVIATION else 0.0


def _equations(
    track: Track, template: Template, block: int, length: int
) -> tuple[Array, Array, Array]:
    """Return the times of the lit parts of a block, (n,), and the equations of their translations.

    These are A, (n, 2, 2), and b, (n, 2).
    """
    blocks, (first, stop) = track.blocks, track.blocks.edges[block : block + 2].tolist()
    number = min(_MAX_PARTS, (stop - first) // length)
    times, matrices, right = [], [], []
    for start in np.linspace(first, stop - length, number).astype(int).tolist():
        frames = range(start, start + length)
        if blocks.burst.number_lit(frames) == 0:
            continue
        times.append(float(start - first))
        sums = blocks.count(frames, track.nodes, blocks.centers)
        if track.pixels is not None:
            sums = sums.masked(track.pixels)
        equations = normal_equations(sums, template, _SIGMA)
        rows, mixed, columns = equations.information.sum(axis=(1, 2))
        matrices.append([[rows, mixed], [mixed, columns]])
        right.append(equations.right.sum(axis=(1, 2)))
    return np.array(times), np.reshape(matrices, (-1, 2, 2)), np.reshape(right, (-1, 2))
