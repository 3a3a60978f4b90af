"""Rates that repeat with a period of a few jots, as under the color filters of a Bayer mosaic."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array32, Counts
from jotlight.checks import as_counts
from jotlight.errors import PeriodicRatesWarning, warn
from jotlight.layout import image_channels
from jotlight.progress import Progress, check_progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import frames_within
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.filter_hints import (
    alternating,
    green_orders,
    means_of_filters,
    white_order,
)

THRESHOLD = 6.0
"""Score, in standard deviations, above which rates are periodic.

For random signs, the probability of a larger score is 1e-9.
"""

MIN_AMPLITUDE = 0.01
"""Minimum amplitude of periodic rates, relative to the mean rate.

The blocks of JPEG files and the traces of demosaicing are weaker.
"""

PERIODS = 2, 4
"""Tested periods in jots in ascending order, of a Bayer mosaic and of a quad Bayer mosaic."""

MIN_AMPLITUDE_OF_ONE = 0.1
"""Minimum amplitude of rates that alternate in one direction only, relative to the mean rate.

Sharp gratings that fill the image may have a high score in one direction, but are weaker.
"""

_TILE = 16
"""Width of the tiles that are compared, in halves of a period."""

_MIN_TILES = 4
"""Minimum number of rows and of columns of tiles. Fewer cannot reach the score."""

_MAX_BYTES = 1 << 22
"""Maximum number of bytes of bits that are read for a warning, except that one frame is."""

_MIN_SIDE, _MAX_SIDE = 1 << 7, 1 << 9
"""Minimum and maximum number of rows and columns of jots that are tested for a warning."""


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
    side : int
        Side in jots of the squares of equal rates: half of the period, or 1 for a period of 4 if
        neighboring jots differ, too.
    greens : str, optional
        The orders of a Bayer mosaic that fit: their green filters are on the two jots of equal
        rates.
    white : str, optional
        An order of a mosaic with a white filter, if one of four filters sees much more light.
    alternating : str, optional
        What alternates if rates alternate in one direction only: ``"rows"`` or ``"columns"``.
    """

    period: int
    amplitude: float
    score: float
    side: int
    greens: str | None = None
    white: str | None = None
    alternating: str | None = None

    def describe(self) -> str:
        """Return what periodic rates mean, and how to reconstruct the capture."""
        order = self._order()
        return (
            f"{self._cause()}; the estimate mixes the jots{self._alike()}. For colors, state your "
            "filters from the top left, for example jotlight.reconstruct(bits, "
            f'sensor.replace(oversampling=1, mosaic="{order}")) (--mosaic {order}) for pixels of '
            "one jot"
        )

    def describe_flat(self) -> str:
        """Return what periodic rates mean in a flat capture, and how to calibrate with it."""
        order = self._order()
        return (
            f"flat: {self._cause()}; the response mixes the jots{self._alike()}. State your "
            f'filters from the top left, for example mosaic="{order}" (--mosaic {order})'
        )

    def _cause(self) -> str:
        side, period = self.side, self.period
        if self.alternating is not None:
            return (
                f"the rates repeat every {period} {self.alternating} of jots, for example under "
                f"the color filters RGBW/BWRG, or because {self.alternating} differ"
            )
        names = {(2, 1): "a Bayer mosaic", (4, 2): "a quad Bayer mosaic"}
        mosaic = names.get((period, side), f"a mosaic of {period} x {period} jots")
        if self.white is not None:
            mosaic = "a mosaic with a white filter"
        return (
            f"the rates repeat every {period} x {period} jots, for example under the "
            f"color filters of {mosaic}, or because rows differ"
        )

    def _alike(self) -> str:
        if self.white is not None:
            return f". One of four filters sees much more light, as the white one in {self.white}"
        if self.greens is None:
            return ""
        return f". Two of four filters see about the same light, {self.greens}"

    def _order(self) -> str:
        """Return an order of the filters that fits, as `mosaic` takes it."""
        if self.alternating is not None:
            return "the letters of the filters, with / after each row"
        if (self.period, self.side) not in ((2, 1), (4, 2)):
            return f"the letters of the filters, with / after each {self.period}"
        letters = "GRBG" if self.greens is not None and "GRBG" in self.greens else "RGGB"
        letters = self.white or letters
        if self.side == 1:
            return letters
        rows = ["".join(2 * letter for letter in row) for row in (letters[:2], letters[2:])]
        return "/".join(row for row in rows for _ in range(2))


def find_periodic_rates(
    data: Bits | Readings | npt.ArrayLike,
    *,
    channel_axis: int | None = None,
    threads: int | None = None,
    progress: Progress = False,
) -> PeriodicRates | None:
    """Return the period with which the rates of jots repeat, or None.

    Under a color filter mosaic, jots of different colors alternate. Methods for gray sensors mix
    them. Periodic rates also come from electronics that treat rows or columns differently. Only the
    periods 2 and 4 are tested, and the larger one that is significant is returned. A larger even
    period, such as 6 or 8, may be reported as 2 or 4. Mosaics of 3 x 3 or 6 x 6 jots (X-Trans) are
    not detected.

    Parameters
    ----------
    data : Bits or Readings (T, H, W), or array_like of int, shape (H, W)
        Bits, readings, or counts of single jots. For data with color channels, the result is None.
    channel_axis : int, optional
        Axis of counts that holds color channels. Default: none.
    threads : int, optional
        The number of threads. Default: the number of cores.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called repeatedly with the completed
        fraction, from 0 to 1. None: a bar in a notebook only. Default: no bar.

    Returns
    -------
    PeriodicRates or None
        None if no period is significant, and for less than 64 x 64 jots.

    Raises
    ------
    TypeError, ValueError
        When counts are not those of one image.

    Notes
    -----
    In each tile of 16 x 16 jots, the part of the rates that alternates from row to row, from column
    to column, or like a checkerboard has a sign. The texture of a scene has random signs in
    neighboring tiles, because nothing in a scene is aligned with the jots. So the number of equal
    signs is binomial without a period. Tiles are compared across the stripes only, since the edge
    of an object may continue along them. For a period of 4, squares of 2 x 2 jots are added first.
    The three parts are tested together. Each is also tested by itself, for amplitudes of 10 %
    and more.

    Examples
    --------
    >>> colors = np.tile([[0.2, 0.3], [0.3, 0.1]], (64, 64))
    >>> noise = np.random.default_rng(0).random((20, 128, 128))
    >>> find_periodic_rates(jl.Bits.from_array(noise < colors)).period
    2
    >>> find_periodic_rates(jl.Bits.from_array(noise < 0.2)) is None
    True
    """
    check_progress(progress)
    if isinstance(data, Bits | Readings):
        if len(data.shape) > 3:
            return None
        counts: npt.NDArray[np.integer]
        if isinstance(data, Readings):
            counts = data.sum(progress=progress)
        else:
            counts = data.counts(1, threads=threads, progress=progress)
    else:
        channels = image_channels("counts", as_counts(data), channel_axis)
        if channel_axis is not None:
            return None
        counts = channels[0]
    return largest_period(counts.astype(np.float32), _score)


def largest_period(
    rates: Array32, score_of: Callable[[Array32, int], tuple[float, float]]
) -> PeriodicRates | None:
    """Return the larger period that is significant, or None.

    Parameters
    ----------
    rates : ndarray of float32, shape (H, W)
        Rates of single jots, or counts.
    score_of : callable
        Returns the score and the relative amplitude of rates, for half of a period in jots.
    """
    found = None
    for period in PERIODS:
        side = period // 2
        score, amplitude = score_of(rates, side)
        if score > THRESHOLD and amplitude > MIN_AMPLITUDE:
            if found is not None:
                side, amplitude = found.side, math.hypot(amplitude, found.amplitude)
            means = means_of_filters(rates, side)
            greens = green_orders(means)
            white = white_order(means, greens is not None)
            direction = alternating(means)
            found = PeriodicRates(period, amplitude, score, side, greens, white, direction)
    return found


def warn_about_periods(data: Iterable[object]) -> None:
    """Issue a PeriodicRatesWarning if the rates of the jots of any of the data repeat.

    Bits are tested once. Only the first frames and the middle of large images are tested, and no
    images of less than 128 x 128 jots.

    Parameters
    ----------
    data : iterable of Bits, Readings, or ndarray of int32 (N, H, W)
        Bits, readings, or counts of single jots, whose first image is tested. Other data are
        ignored.
    """
    tested = Bits | Readings | np.ndarray
    found = (_find_in_middle(each) for each in data if isinstance(each, tested))
    periodic = next(filter(None, found), None)
    if periodic is not None:
        warn(periodic.describe(), PeriodicRatesWarning)


def _find_in_middle(data: Bits | Readings | Counts) -> PeriodicRates | None:
    """Return periodic rates of jots in the middle, or None, also for bits that were tested."""
    height, width = data.shape[1:3]
    if min(height, width) < _MIN_SIDE or len(data.shape) > 3:
        return None
    counts: npt.NDArray[np.integer]
    if isinstance(data, Bits):
        if data.tested_for_periods:
            return None
        data.tested_for_periods = True
        counts = data[: frames_within(data.packed, _MAX_BYTES)].counts(1)
    elif isinstance(data, Readings):
        # Readings of any type are tested as if they had 16 bits.
        counts = data[: max(1, _MAX_BYTES // (2 * height * width))].sum()
    else:
        counts = data[0]
    top, left = (max(0, (side - _MAX_SIDE) // 2) for side in (height, width))
    return find_periodic_rates(counts[top : top + _MAX_SIDE, left : left + _MAX_SIDE])


def _score(rates: Array32, side: int = 1) -> tuple[float, float]:
    """Return how often neighboring tiles agree, in standard deviations, and the amplitude.

    `side` is half of the period.
    """
    size = side * _TILE
    height, width = (length // size for length in rates.shape)
    if min(height, width) < _MIN_TILES:
        return 0.0, 0.0
    filters = _filters(side)
    tiles = rates[: height * size, : width * size].reshape(height, size, -1)
    columns = np.matmul(filters, tiles).reshape(height, 2, width, size)
    (means, vertical), (horizontal, checkerboard) = np.einsum("hrwj,cj->rchw", columns, filters)
    power = float(_vertical_products(means).mean())
    if power == 0:
        return 0.0, 0.0
    directions = [
        [_vertical_products(horizontal)],
        [_vertical_products(vertical.T)],
        # Both parts are the same checkerboards.
        [_vertical_products(checkerboard), _vertical_products(checkerboard.T)],
    ]
    powers = np.array([np.mean([part.mean() for part in parts]) for parts in directions]) / power
    strong = [
        _agreement(parts)
        for parts, own in zip(directions, powers, strict=True)
        if own > MIN_AMPLITUDE_OF_ONE**2
    ]
    score = _agreement([part for parts in directions for part in parts])
    return max([score, *strong]), float(np.sqrt(max(0.0, powers.sum())))


def _agreement(parts: list[Array32]) -> float:
    """Return how many more products are positive than negative, in standard deviations."""
    signs = np.sign(np.concatenate(parts))
    return float(signs.sum() / math.sqrt(max(int(np.count_nonzero(signs)), 1)))


@functools.cache
def _filters(side: int) -> Array32:
    """Return a smooth filter, and the same one with alternating signs."""
    smooth = np.hanning(_TILE + 2)[1:-1]
    both = np.stack([smooth, smooth * (-1.0) ** np.arange(_TILE)]) / smooth.sum()
    return np.asarray(both.repeat(side, axis=1), np.float32)


def _vertical_products(values: Array32) -> Array32:
    """Return the products of each tile and the one below it."""
    return (values[1:] * values[:-1]).ravel()
