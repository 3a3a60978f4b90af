"""Rates that repeat with a period of a few jots, as under the color filters of a Bayer mosaic."""

import dataclasses
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.checks import Counts, as_counts
from jotlight.errors import warn
from jotlight.sensing.bits import Bits

THRESHOLD = 6.0
"""Score, in standard deviations, above which rates are periodic.

For random signs, the probability of a larger score is 1e-9.
"""

MIN_AMPLITUDE = 0.01
"""Minimum amplitude of periodic rates, relative to the mean rate.

The blocks of JPEG files and the traces of demosaicing are weaker.
"""

PERIODS = 2, 4
"""Tested periods in jots, of a Bayer mosaic and of a quad Bayer mosaic."""

_TILE = 16
"""Width of the tiles that are compared, in halves of a period."""

_MIN_TILES = 4
"""Minimum number of rows and of columns of tiles. Fewer cannot reach the score."""

_MAX_BYTES = 1 << 26
"""Maximum number of bytes of bits that are read for a warning."""

_MAX_SIDE = 1 << 11
"""Maximum number of rows and columns of jots that are tested for a warning."""

Array = npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class PeriodicRates:
    """A periodic part of the rates of a capture.

    Parameters
    ----------
    period : int
        Period in jots, of rows and of columns: 2 or 4.
    amplitude : float
        Root mean square of the periodic part, relative to the mean rate.
    score : float
        How many more neighboring tiles agree than by chance, in standard deviations.
    """

    period: int
    amplitude: float
    score: float

    def describe(self) -> str:
        """Return what periodic rates mean, and how to reconstruct the capture."""
        side = self.period // 2
        mosaic = "Bayer mosaic" if self.period == 2 else "quad Bayer mosaic"
        return (
            f"the rates repeat every {self.period} x {self.period} jots, with an amplitude of "
            f"{self.amplitude:.0%} of the mean, as under the color filters of a {mosaic}; the "
            "estimate mixes the colors. In Python, load the bits, and reconstruct each color "
            f"alone: jotlight.reconstruct(bits.counts({side})[0::2, 0::2], "
            f"sensor.replace(oversampling={side})), and likewise [0::2, 1::2], [1::2, 0::2], and "
            "[1::2, 1::2]. The sensor states all frames, the gain, the dark counts, and the "
            "efficiency; its maps need the jots of the color"
        )


def find_periodic_rates(
    data: Bits | npt.ArrayLike,
    *,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> PeriodicRates | None:
    """Return the period with which the rates of jots repeat, or None.

    Under a color filter mosaic, jots of different colors alternate. Methods for gray sensors mix
    them. Periodic rates also come from electronics that treat odd and even rows differently.

    Parameters
    ----------
    data : Bits (T, H, W), or array_like of int, shape (H, W)
        Bits, or counts of single jots. Data with color channels are not tested: None.
    threads : int, optional
        Number of threads. Default: all.
    progress : callable, optional
        Called repeatedly with the completed fraction, 0 to 1.

    Returns
    -------
    PeriodicRates or None
        None if no period is significant, and for less than 64 x 64 jots.

    Notes
    -----
    In each tile of 16 x 16 jots, the part of the rates that alternates from row to row, from column
    to column, or like a checkerboard has a sign. The texture of a scene has random signs in
    neighboring tiles, because nothing in a scene is aligned with the jots. So the number of equal
    signs is binomial without a period. Tiles are compared across the stripes only, since the edge
    of an object may continue along them. For a period of 4, squares of 2 x 2 jots are added first.

    Examples
    --------
    >>> colors = np.tile([[0.2, 0.3], [0.3, 0.1]], (64, 64))
    >>> noise = np.random.default_rng(0).random((20, 128, 128))
    >>> find_periodic_rates(Bits.from_array(noise < colors)).period
    2
    >>> find_periodic_rates(Bits.from_array(noise < 0.2)) is None
    True
    """
    if isinstance(data, Bits):
        if len(data.shape) > 3:
            return None
        counts = data.counts(1, threads=threads, progress=progress)
    else:
        counts = as_counts(data)
    if counts.ndim > 2:
        return None
    rates = counts.astype(np.float64)
    for period in PERIODS:
        score, amplitude = _score(rates)
        if score > THRESHOLD and amplitude > MIN_AMPLITUDE:
            return PeriodicRates(period, amplitude, score)
        height, width = (length // 2 for length in rates.shape)
        rates = rates[: 2 * height, : 2 * width].reshape(height, 2, width, 2).sum((1, 3))
    return None


def warn_about_period(data: Bits | Counts, threads: int | None) -> None:
    """Issue a warning if the rates of jots repeat.

    Only the first 64 MiB of bits are read, and only a part of large images is tested.
    """
    if isinstance(data, Bits):
        frame_bytes = max(1, data.packed.nbytes // len(data))
        data = data[: max(1, _MAX_BYTES // frame_bytes)].counts(1, threads=threads)
    periodic = find_periodic_rates(data[:_MAX_SIDE, :_MAX_SIDE])
    if periodic is not None:
        warn(periodic.describe())


def _score(rates: Array) -> tuple[float, float]:
    """Return how often neighboring tiles agree, in standard deviations, and the amplitude."""
    height, width = (length // _TILE for length in rates.shape)
    if min(height, width) < _MIN_TILES:
        return 0.0, 0.0
    tiles = rates[: height * _TILE, : width * _TILE].reshape(height, _TILE, width, _TILE)
    smooth = np.hanning(_TILE + 2)[1:-1]
    smooth /= smooth.sum()
    alternating = smooth * (-1.0) ** np.arange(_TILE)

    def filtered(rows: Array, columns: Array) -> Array:
        return np.asarray(np.einsum("hiwj,i,j->hw", tiles, rows, columns))

    checkerboard = filtered(alternating, alternating)
    parts = [
        _vertical_products(filtered(alternating, smooth)),
        _vertical_products(filtered(smooth, alternating).T),
        _vertical_products(checkerboard),
        _vertical_products(checkerboard.T),
    ]
    signs = np.sign(np.concatenate(parts))
    if not signs.any():
        return 0.0, 0.0
    # Two of the parts are the same checkerboards.
    power = parts[0].mean() + parts[1].mean() + (parts[2].mean() + parts[3].mean()) / 2
    mean_power = _vertical_products(filtered(smooth, smooth)).mean()
    amplitude = np.sqrt(max(0.0, power) / mean_power)
    return float(signs.sum() / np.sqrt(np.count_nonzero(signs))), float(amplitude)


def _vertical_products(values: Array) -> Array:
    """Return the products of each tile and the one below it."""
    return (values[1:] * values[:-1]).ravel()
