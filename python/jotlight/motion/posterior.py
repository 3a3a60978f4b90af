"""How well the displacements are known."""

import numpy as np
import numpy.typing as npt

from jotlight.motion.labels import choose
from jotlight.motion.motion import Motion
from jotlight.motion.tiles import TILE
from jotlight.squares import repeat_squares

_MAX_ERROR = 100.0
"""Largest stated error in jots, for tiles without information."""


def posterior_error(motion: Motion) -> npt.NDArray[np.float32]:
    """Return the standard deviation of the displacement of each jot, (H, W), in jots.

    It is √(½ tr A⁻¹) with the information A of a tile in one block, averaged over the blocks with
    light. All blocks and tiles together are more precise. It is 0 if nothing moves.
    """
    height, width = motion.size
    if motion.model == "none":
        return np.zeros((height, width), np.float32)
    rows, mixed, columns = np.moveaxis(motion.information.astype(np.float64), 2, 0)
    determinant = np.maximum(rows * columns - mixed**2, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = (rows + columns) / (2 * determinant)
    variance = np.where(variance < _MAX_ERROR**2, variance, _MAX_ERROR**2)
    # Blocks without light have no information at all.
    is_lit = np.any(motion.information != 0, axis=(2, 3, 4))
    is_lit |= ~is_lit.any(axis=1, keepdims=True)
    weights = np.broadcast_to(is_lit[:, :, None, None], variance.shape)
    error = np.sqrt(np.average(variance, axis=1, weights=weights)).astype(np.float32)
    jots = repeat_squares(error, TILE, (height, width))
    return choose(motion.labels, list(jots))
