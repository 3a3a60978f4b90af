"""Counts of many windows of frames, as a lazy array.

The counts of a window are the sum of those of its pieces (:mod:`jotlight.dask.pieces`). Whole
numbers are added, so the sum does not depend on the chunks.
"""

from typing import TYPE_CHECKING

from jotlight.dask.pieces import Pieces
from jotlight.sensing.bits.bits import Bits

if TYPE_CHECKING:
    import dask.array


def count(
    x: "Bits | dask.array.Array",
    window: int,
    step: int | None = None,
    *,
    oversampling: int | None = None,
    width: int | None = None,
) -> "dask.array.Array":
    """Return L of each window of frames, the number of ones of each pixel, as a lazy array.

    Parameters
    ----------
    x : Bits or dask.array.Array of uint8, shape (T, H, ceil(W / 8)) or (T, H, ceil(W / 8), C)
        Bits, or packed bits as :meth:`jotlight.Bits.to_dask` returns them. A chunk holds whole
        frames.
    window : int
        Number of frames of a window, from 1 to T.
    step : int, optional
        Frames from one window to the next. Default: the size of a window.
    oversampling : int, optional
        K̂. Default: that of the bits' own sensor, or 1.
    width : int, optional
        W: the true width in jots, such as ``bits.width``. An array of packed bits needs it, because
        its rows are padded to whole bytes. Default: that of the bits.

    Returns
    -------
    dask.array.Array of int32, shape (N, H / K̂, W / K̂) or (N, H / K̂, W / K̂, C)
        The counts of N windows. Its values do not depend on the chunks of `x`.

    Raises
    ------
    MissingExtraError
        When dask is not installed.
    TypeError, ValueError
        When `x` is not packed, its chunks do not hold whole frames, or a number is out of range.

    Notes
    -----
    Workers with another version of jotlight raise RuntimeError when the counts are computed.

    Examples
    --------
    >>> bits = jl.Bits.from_array(np.ones((100, 16, 16), bool))
    >>> counts = count(bits.to_dask(chunks=30), window=32, width=bits.width)
    >>> counts.shape, np.unique(counts.compute()).tolist()
    ((3, 16, 16), [32])
    """
    return Pieces.of(x, window, step, oversampling=oversampling, width=width).count()
