"""Colors behind a mosaic without fringes: neighboring colors lie on lines."""

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.sensing.parameters.mosaic import Mosaic

_KEPT = 0.5
"""How much of the light behind each pixel's filter is kept. Otherwise, the light of all three
colors is kept. With few bits, this has the smaller error, and with many bits, the former."""


def remove_fringes(colors: Image, mosaic: Mosaic, threads: int | None) -> Image:
    """Return colors whose differences follow the light of their neighborhood, (3, H, W).

    Behind a mosaic, each pixel sees a part of the colors only. So thin strokes have colors that
    they lack: fringes. Where two colors meet, all mixtures lie on a line between both, which
    neighboring pixels state together.

    Parameters
    ----------
    colors : ndarray of float32, shape (3, H, W)
        Red, green, and blue.
    mosaic : Mosaic
        The filters.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Notes
    -----
    The lines: ``crates/jotlight/src/color_lines.rs``. What they gain: decision 47.

    Examples
    --------
    >>> gray = np.full((3, 6, 6), 0.5, np.float32)
    >>> bool(np.allclose(remove_fringes(gray, Mosaic("RGGB"), None), gray))
    True
    """
    source = np.ascontiguousarray(colors, np.float32)
    found = np.empty_like(source)
    engine.color_lines(source, found, threads)
    shares = mosaic.transmission / mosaic.sensitivity[:, None]
    behind = shares.astype(np.float32)[mosaic.full(*source.shape[1:])]
    found += _KEPT * np.einsum("chw,hwc->hw", source - found, behind)
    return found
