"""Pixels that are alike, and the exact distribution of the total of their readings."""

import dataclasses

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array
from jotlight.sensing.likelihood.joint_likelihood import JointLikelihood
from jotlight.sensing.likelihood.joint_term import Term
from jotlight.sensing.likelihood.multibit import ReadingLikelihood, reading_distribution
from jotlight.sensing.parameters.response import detection_probability, silence_probability
from jotlight.underflow import underflows_to_0

MAX_KINDS = 64
"""Maximum number of kinds of pixels of an image."""


@dataclasses.dataclass(frozen=True)
class Cell:
    """Readings with the same distribution: those of one group, of a pixel or of one of its jots."""

    term: Term
    trials: int
    """Their number."""
    efficiency: float
    dark_counts: float

    @underflows_to_0
    def distribution(self, level: Array, length: int) -> Array:
        """Return the probabilities of sums of 0 to `length` - 1 at each level, (len, length)."""
        rate = self.efficiency * self.term.light * level + self.dark_counts
        cells = self.term.cells
        if isinstance(cells, ReadingLikelihood):
            one = reading_distribution(cells.response, rate, length, cells.threads)
            return _power(one, self.trials)
        from scipy.special import gammaln, xlogy

        rate = rate[:, None]
        number = self.trials
        counts = np.arange(min(length, number + 1), dtype=np.float64)
        logarithms = xlogy(counts, detection_probability(cells.threshold, rate))
        logarithms += xlogy(number - counts, silence_probability(cells.threshold, rate))
        logarithms += gammaln(number + 1) - gammaln(counts + 1) - gammaln(number - counts + 1)
        padded = np.zeros((len(level), length))
        padded[:, : len(counts)] = np.exp(logarithms)
        return padded


@dataclasses.dataclass(frozen=True)
class PixelKind:
    """Pixels whose totals have the same distribution at the same level of light.

    The level of a pixel is its scale times its intensity plus its offset.
    """

    pixels: npt.NDArray[np.int64]
    """The places of the pixels in the flat image, (n,)."""
    cells: tuple[Cell, ...]
    scale: Array
    """The scale of each pixel, (n,)."""
    offset: Array
    """The offset of each pixel, (n,)."""

    def select(self, pixels: npt.NDArray[np.int64]) -> "PixelKind":
        """Return the kind with some of its pixels, in ascending order."""
        places = np.searchsorted(self.pixels, pixels)
        return PixelKind(pixels, self.cells, self.scale[places], self.offset[places])

    @property
    def max_total(self) -> int:
        """The largest possible total."""
        return sum(cell.trials * cell.term.max_reading for cell in self.cells)

    @underflows_to_0
    def distribution(self, level: Array, length: int) -> Array:
        """Return the probabilities of totals of 0 to `length` - 1 at each level, (len, length).

        It is the convolution of the distributions of the readings.

        Examples
        --------
        >>> from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
        >>> sensor = jl.Sensor(frames=2, gain=[np.log(2), np.log(4)])
        >>> joint = joint_likelihood(jl.Bits.from_array([[[1]], [[0]]]), sensor, None)
        >>> (kind,) = find_kinds(joint)
        >>> kind.distribution(np.array([1.0]), 3).round(4)  # p = 1/2 and 3/4
        array([[0.125, 0.5  , 0.375]])
        """
        result = self.cells[0].distribution(level, length)
        for cell in self.cells[1:]:
            result = _convolve(result, cell.distribution(level, length))
        return result


def find_kinds(joint: JointLikelihood) -> list[PixelKind]:
    """Return the kinds of the live pixels, or none if they are more than 64.

    Pixels are of the same kind if they have the same trials, and the same efficiency and dark
    counts after a change of their scale. A common efficiency of all readings of a pixel only scales
    its intensity. If the readings also have one gain and one threshold, dark counts only shift it.

    Examples
    --------
    >>> from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
    >>> sensor = jl.Sensor(bit_depth=3, efficiency=[[0.5, 0.7, 0.9]], mask=[[False, False, True]])
    >>> readings = sensor.expose(np.array([[0.5, 1.0, 1.0]]), rng=0)
    >>> [kind.pixels.tolist() for kind in find_kinds(joint_likelihood(readings, sensor, None))]
    [[0, 1]]
    """
    terms = [term for term in joint.terms for _ in range(term.side**2)]
    each = [_by_pixel(term) for term in joint.terms]
    trials, efficiency, dark_counts = (
        np.concatenate(values, axis=1) for values in zip(*each, strict=True)
    )
    pixels = np.flatnonzero(trials.any(axis=1))
    trials, efficiency, dark_counts = trials[pixels], efficiency[pixels], dark_counts[pixels]
    scale = efficiency.max(axis=1)
    efficiency /= scale[:, None]
    light = np.array([term.light for term in terms])
    is_single = (trials > 0).sum(axis=1) == 1
    offset = np.where(is_single, (dark_counts / light).sum(axis=1), 0.0)
    dark_counts[is_single] = 0
    kinds = []
    for own in _same_rows(np.concatenate([trials, efficiency, dark_counts], axis=1)):
        values = zip(terms, trials[own[0]], efficiency[own[0]], dark_counts[own[0]], strict=True)
        cells = tuple(Cell(term, int(n), *map(float, jot)) for term, n, *jot in values if n)
        kinds.append(PixelKind(pixels[own], cells, scale[own], offset[own]))
    return kinds


def _same_rows(rows: Array) -> list[npt.NDArray[np.intp]]:
    """Return the places of equal rows for each different row, or none if these are more than 64."""
    codes = np.zeros(len(rows), np.intp)
    for column in rows.T:
        if (column == column[:1]).all():
            continue
        distinct, places = np.unique(column, return_inverse=True)
        found, codes = np.unique(codes * len(distinct) + places, return_inverse=True)
        if len(found) > MAX_KINDS:
            return []
    return [np.flatnonzero(codes == code) for code in range(codes.max(initial=-1) + 1)]


def _by_pixel(term: Term) -> tuple[Array, Array, Array]:
    """Return the trials, the efficiency, and the dark counts of the cells, (H·W, side²).

    All are 0 for cells without readings.
    """
    is_live = term.trials > 0
    parameters = []
    for value in (term.trials, term.cells.efficiency, term.cells.dark_counts):
        cells = np.where(is_live, value, 0.0)
        if term.live is not None:
            everywhere = np.zeros(term.live.shape)
            everywhere[term.live] = cells
            cells = everywhere
        height, width = (size // term.side for size in cells.shape)
        blocks = cells.reshape(height, term.side, width, term.side).swapaxes(1, 2)
        parameters.append(blocks.reshape(height * width, -1))
    return parameters[0], parameters[1], parameters[2]


def _power(distribution: Array, number: int) -> Array:
    """Return the distributions of sums of some independent values, up to the same length."""
    result, power = None, distribution
    while number:
        if number % 2:
            result = power if result is None else _convolve(result, power)
        number //= 2
        if number:
            power = _convolve(power, power)
    assert result is not None
    return result


def _convolve(one: Array, other: Array) -> Array:
    """Return the convolutions of rows, up to their length."""
    from scipy.fft import irfft, next_fast_len, rfft

    length = one.shape[1]
    padded = next_fast_len(2 * length - 1, real=True)
    product = rfft(one, padded, axis=1) * rfft(other, padded, axis=1)
    return np.asarray(np.clip(irfft(product, padded, axis=1)[:, :length], 0, 1))
