"""The velocity of a whole image, from the correlations of short blocks of frames.

Two blocks of dim frames hardly correlate. The correlations of all pairs of blocks together do: if
the scene moves at the velocity v, those of pairs that are n frames apart have their peaks at n v.
"""

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits import Bits

Array = npt.NDArray[np.float64]

_MAX_BLOCKS = 32
"""Maximum number of blocks that are correlated."""

_MAX_LAG = 12
"""Maximum distance in blocks of a pair."""

_MAX_VELOCITY = 2.0
"""Maximum velocity in pixels per frame, in each direction."""

_BAND = 1.0, 16.0
"""Standard deviations of the filters between which details are correlated, in pixels."""


def find_velocity(bits: Bits, reference: int, length: int, threads: int | None) -> Array:
    """Return the velocity around a reference time in pixels per frame, (2,).

    Parameters
    ----------
    bits : Bits
        The burst, (T, H, W).
    reference : int
        The time between the two middle blocks.
    length : int
        Number of frames in a block.
    threads : int, optional
        Number of threads.
    """
    from scipy.ndimage import map_coordinates

    spectra = _spectra(bits, reference, length, threads)
    lags = range(1, min(_MAX_LAG, len(spectra) - 1) + 1)
    # At the largest lag, neighboring velocities are half a pixel apart.
    step = 1 / (2 * length * max(lags, default=1))
    line = np.arange(-_MAX_VELOCITY, _MAX_VELOCITY + step / 2, step)
    velocities = np.stack(np.meshgrid(line, line, indexing="ij"))
    score = np.zeros(velocities.shape[1:])
    for lag in lags:
        correlation = _correlate(spectra, lag, bits.shape[1:3])
        score += map_coordinates(correlation, velocities * length * lag, order=1, mode="grid-wrap")
    return np.asarray(velocities.reshape(2, -1)[:, int(np.argmax(score))])


def _spectra(
    bits: Bits, reference: int, length: int, threads: int | None
) -> list[npt.NDArray[np.complex64]]:
    """Return the band-passed Fourier transforms of the counts of blocks around a time."""
    from scipy import fft

    frames, height, width = bits.shape
    number = min(_MAX_BLOCKS, 2 * (min(reference, frames - reference) // length))
    start = reference - number // 2 * length
    window = (np.hanning(height)[:, None] * np.hanning(width)).astype(np.float32)
    squared = (2 * np.pi * fft.fftfreq(height)[:, None]) ** 2
    squared = squared + (2 * np.pi * fft.rfftfreq(width)) ** 2
    fine, coarse = (np.exp(-squared * sigma**2 / 2) for sigma in _BAND)
    band = (fine - coarse).astype(np.float32)
    spectra = []
    for first in range(start, start + number * length, length):
        counts = bits[first : first + length].counts(1, threads=threads).astype(np.float32)
        spectra.append(fft.rfft2((counts - counts.mean()) * window) * band)
    return spectra


def _correlate(
    spectra: list[npt.NDArray[np.complex64]], lag: int, size: tuple[int, ...]
) -> npt.NDArray[np.float32]:
    """Return the correlation of all pairs of blocks that are `lag` blocks apart, in its noise."""
    from scipy import fft

    cross = np.zeros_like(spectra[0])
    for first, second in zip(spectra[:-lag], spectra[lag:], strict=True):
        cross += np.conj(first) * second
    magnitude = np.abs(cross)
    # The root is between correlation, whose peaks are wide, and phase correlation.
    cross /= np.sqrt(magnitude + 1e-9 * magnitude.max() + 1e-30)
    correlation = fft.irfft2(cross, s=size)
    return np.asarray(correlation / max(float(correlation.std()), 1e-30))
