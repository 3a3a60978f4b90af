"""Slow NumPy twin of K-conditioned networks for maps of trials, and for more trials than they know.

It evaluates the network everywhere for each level, and needs only its output for a single K.
"""

import math

import numpy as np
from scipy.ndimage import gaussian_filter

RATIO_OF_PASS = 16


def denoise_map(network, ones, trials, number_of_runs=None):
    """Return the probability of a one at each pixel, where every pixel has trials.

    The list `number_of_runs` gets the level of each run.
    """
    runs = [] if number_of_runs is None else number_of_runs
    smallest, largest = network.trials_range
    local = local_trials(trials)
    served = np.clip(local, smallest, largest)
    fraction = ones / trials
    estimate = at_levels(network, fraction, served, runs)
    passes = math.ceil(math.log(max(local.max() / largest, 1), RATIO_OF_PASS))
    for _ in range(passes):
        gain = np.sqrt(local / served)
        base = np.arcsin(np.sqrt(estimate))
        data = np.arcsin(np.sqrt((fraction * local + 0.375) / (local + 0.75)))
        angle = np.clip(base + gain * (data - base), 0, np.pi / 2)
        raised = (np.sin(angle) ** 2 * (served + 0.75) - 0.375) / served
        denoised = at_levels(network, raised, np.full(local.shape, float(largest)), runs)
        angle = base + (np.arcsin(np.sqrt(denoised)) - base) / gain
        changed = np.sin(np.clip(angle, 0, np.pi / 2)) ** 2
        estimate = np.where(gain > 1, changed, estimate)
    return estimate


def local_trials(trials):
    """The harmonic mean in a neighborhood, or the same number everywhere if it is nearly so."""
    local = 1 / gaussian_filter(1 / trials.astype(float), 3, mode="reflect", truncate=3)
    if local.max() <= 1.2 * local.min():
        return np.full(local.shape, float(max(1, math.floor(1 / np.mean(1 / local) + 1 / 3))))
    return local


def at_levels(network, fraction, trials, runs):
    """The sum over levels of their weights times the output of the network for the level."""
    levels = levels_of(trials)
    result = np.zeros(fraction.shape)
    for index, level in enumerate(levels):
        weight = np.ones(fraction.shape)
        if index:
            weight = weight * share(trials, levels[index - 1], level)
        if index + 1 < len(levels):
            weight = weight * (1 - share(trials, level, levels[index + 1]))
        if weight.any():
            runs.append(level)
            output = network.denoise_probability(fraction.astype(np.float32), level)
            result += weight * output
    return np.clip(result, 0, 1)


def levels_of(trials):
    """Each level is that above it divided by the root of 2; the smallest is about the minimum."""
    high, pixels = trials.max(), trials.size
    near, fewer = (np.sum(trials >= part * high) for part in (0.99, 0.9))
    if fewer > pixels / 2 and fewer - near > 0.03 * pixels:
        high = 0.9 * high
    low = max(1, round(float(trials.min())))
    levels = [max(low, round(float(high)))]
    while levels[0] > low:
        levels.insert(0, max(low, round(levels[0] / math.sqrt(2))))
    # The smallest one is left out for fewer than 0.2 % of the pixels, and others below.
    if len(levels) > 1 and np.sum(trials < levels[1]) < 0.002 * pixels:
        levels = levels[1:]
    kept = levels[:1]
    for below, level, above in zip(levels, levels[1:], [*levels[2:], None], strict=False):
        is_needed = above is None or above > 4 * kept[-1]
        if is_needed or np.sum((trials >= below) & (trials < above)) >= 0.002 * pixels:
            kept.append(level)
    return kept


def share(trials, low, high):
    """The weight of the upper one of two neighboring levels."""
    place = np.log2(trials / low) / np.log2(high / low)
    return np.clip(2 * place - 1, 0, 1)
