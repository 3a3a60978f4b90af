"""Colors behind a mosaic without fringes: neighboring colors lie on lines."""

import numpy as np

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.sensing.parameters.mosaic import Mosaic

_TAKEN_BACK = 0.5
"""Lines keep the light of all colors together, but change the part that passes the pixel's own
filter. This fraction of the change is taken back. 0 is best for photographs with few bits, and 1
for text."""


def remove_fringes(colors: Image, mosaic: Mosaic, threads: int | None) -> Image:
    """Return colors whose differences follow the light of their neighborhood, (3, H, W).

    Behind a mosaic, each pixel sees a part of the colors only. So thin strokes get wrong
    colors: fringes. Where two colors meet, all mixtures of them lie on a line between both, and
    neighboring pixels together show this line.

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
    found += _TAKEN_BACK * np.einsum("chw,hwc->hw", source - found, behind)
    return found
