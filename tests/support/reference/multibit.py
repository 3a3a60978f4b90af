"""Twins of readings of several bits: sums in the arithmetic of mpmath, and plain loops."""

import functools

import mpmath as mp


def reading_probability(reading, rate, bit_depth, read_noise=0.0, threshold=1):
    """Return P(R = r) as a sum over the numbers of photons, with 50 digits."""
    with mp.workdps(50):
        rate, noise = mp.mpf(rate), mp.mpf(str(read_noise))
        highest = 2**bit_depth - 1
        level = threshold - 1 + reading
        last = int(rate + 15 * mp.sqrt(rate) + 80 + 25 * noise) + level
        total, photons = mp.mpf(0), mp.exp(-rate)
        for count in range(last):
            total += photons * _weight(count, level, reading == 0, reading == highest, noise)
            photons *= rate / (count + 1)
        return total


@functools.cache
def _weight(count, level, is_lowest, is_highest, noise):
    """Return the probability of a level, or of all beyond it, for a number of photons.

    It does not depend on the light, so tests at several rates share it.
    """
    half = mp.mpf("0.5")
    if noise == 0:
        above = is_highest or count <= level
        below = is_lowest or count >= level
        return mp.mpf(1 if above and below else 0)
    low, high = (level - half - count) / noise, (level + half - count) / noise
    if is_lowest:
        return mp.ncdf(high)
    if is_highest:
        return mp.ncdf(-low)
    return mp.ncdf(-low) - mp.ncdf(-high) if count <= level else mp.ncdf(high) - mp.ncdf(low)
