"""Methods for one number of trials, run at some levels of it and interpolated pixel by pixel."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.estimators.inpaint import check_any_valid
from jotlight.sensing.pixel_counts import MAX_PIXELS, PixelCounts

Image = npt.NDArray[np.float32]

LocalTrials = int | Image
"""The local trials of an image: one whole number, or a map (H, W)."""

_MAX_RATIO = 2**0.5
"""Maximum ratio of neighboring levels.

A ratio of 2 costs networks up to 0.5 dB (``docs/results/networks.md``).
"""

_PLATEAU = 0.5
"""A level alone serves the trials up to this fraction of the way to the next one, by logarithm.

From there on, the share of the next level rises. A denoiser that expects 10 % fewer trials than
there are is as good as the right one, but for 10 % more trials it loses up to 0.6 dB.
"""

_NEIGHBORHOOD = 3.0
"""Standard deviation of the neighborhood in which noise is averaged, in pixels."""

_NEAR_RATIO = 1.2
"""Ratio of the largest to the smallest local trials up to which one run serves all pixels."""

_FEWER = 0.9
"""The largest level may have this fraction of the largest number of trials, which costs nothing."""

_FEW_PIXELS, _MAX_GAP = 0.002, 4.0
"""A level for less than this fraction of the pixels is left out, if the ratio of its neighbors is
at most the second number. Its pixels get the next lower level."""

_NEAR, _MIN_SHARE = 0.99, 0.03
"""It does if more than this share of the pixels (second value) has trials from the one fraction of
the largest number to the other. Otherwise, these pixels would need two levels."""


def level_range(smallest: float, largest: float) -> list[int]:
    """Return whole numbers from `smallest` to `largest`, with ratios of at most about √2.

    Those above the smallest depend on the largest one alone. So images of a film have the same
    levels, and networks keep their parameters.

    Examples
    --------
    >>> level_range(3, 30), level_range(4, 30)
    ([3, 4, 6, 8, 11, 15, 21, 30], [4, 6, 8, 11, 15, 21, 30])
    """
    first = max(1, round(smallest))
    level = max(first, round(largest))
    levels = [level]
    while level > first:
        level = max(first, round(level / _MAX_RATIO))
        levels.append(level)
    return levels[::-1]


def _levels_of_map(trials: npt.NDArray[np.floating]) -> list[int]:
    """Return the levels of a map, without those that few pixels need."""
    levels = level_range(float(trials.min()), _largest_level(trials))
    above = [np.count_nonzero(trials >= level) for level in levels]
    kept = levels[:1]
    for index in range(1, len(levels) - 1):
        pixels = above[index - 1] - above[index + 1]
        gap = levels[index + 1] / kept[-1]
        if pixels >= _FEW_PIXELS * trials.size or gap > _MAX_GAP:
            kept.append(levels[index])
    return kept + levels[1:][-1:]


def level_weights(
    trials: npt.NDArray[np.floating],
) -> Iterator[tuple[int, npt.NDArray[np.float32]]]:
    """Yield the levels of a map, and their weights at each pixel, of which one is above 0.

    The weights of a pixel belong to the largest level up to its trials, and near the next level to
    both. Their sum is 1.

    Parameters
    ----------
    trials : ndarray, shape (H, W)
        The number of trials of each pixel, above 0.

    Examples
    --------
    >>> for level, weights in level_weights(np.array([8, 9, 10, 11])):
    ...     print(level, weights.round(2))
    8 [1.  1.  0.6 0. ]
    11 [0.  0.  0.4 1. ]
    """
    levels = _levels_of_map(trials)
    if len(levels) == 1:
        yield levels[0], np.ones(trials.shape, np.float32)
        return
    logarithms = np.log2(levels)
    starts = logarithms[:-1] + _PLATEAU * np.diff(logarithms)
    ends = np.stack([starts, logarithms[1:]], axis=1)
    places = np.repeat(np.arange(len(levels)), 2)[1:-1]
    place = np.interp(np.log2(trials), ends.ravel(), places).astype(np.float32)
    for index, level in enumerate(levels):
        weight = np.maximum(1 - abs(place - np.float32(index)), 0)
        if weight.any():
            yield level, weight


def _largest_level(trials: npt.NDArray[np.floating]) -> float:
    """Return the number of trials of the largest level of a map.

    Most pixels of merged bits have about the same number of trials, but a few bits of some of them
    were left out. The largest level then serves all of these.
    """
    largest = float(trials.max())
    near, fewer = (np.count_nonzero(trials >= part * largest) for part in (_NEAR, _FEWER))
    is_useful = 2 * fewer > trials.size and fewer - near > _MIN_SHARE * trials.size
    return _FEWER * largest if is_useful else largest


def local_trials(trials: npt.NDArray[np.floating]) -> LocalTrials:
    """Return the number of trials that states the noise around each pixel.

    The noise of a fraction of ones is inversely proportional to its trials. A denoiser weighs a
    pixel against its neighbors, so the mean noise around the pixel counts: the harmonic mean of the
    trials. Where it is nearly the same everywhere, it is returned as one whole number from 1.

    Parameters
    ----------
    trials : ndarray, shape (H, W)
        The number of trials of each pixel, above 0.

    Examples
    --------
    >>> local_trials(np.full((3, 4), 16.0))
    16
    >>> trials = np.where(np.arange(90) < 45, 4.0, 16.0) * np.ones((8, 1))
    >>> local_trials(trials)[0, [0, 44, 45, 89]].round(1)
    array([ 4. ,  5.9,  7. , 16. ], dtype=float32)
    """
    return _local_trials_of([trials])[0]


def _local_trials_of(maps: Sequence[npt.NDArray[np.floating]]) -> list[LocalTrials]:
    """Return :func:`local_trials` of maps (H, W), which the engine blurs in one call."""
    noise = [1 / trials for trials in maps if trials.min() < trials.max()]
    blurred = np.empty((len(noise), *maps[0].shape), np.float32)
    if noise:
        engine.blur(np.array(noise, np.float32), _NEIGHBORHOOD, blurred, None)
    images = iter(blurred)
    return [
        _number_or_map(next(images))
        if trials.min() < trials.max()
        else max(1, round(float(trials.flat[0])))
        for trials in maps
    ]


def _number_or_map(noise: Image) -> LocalTrials:
    if noise.max() <= _NEAR_RATIO * noise.min():
        return max(1, round(1 / float(noise.mean(dtype=np.float64))))
    return np.asarray(1 / noise, np.float32)


def count_local_trials(pixels: PixelCounts) -> list[LocalTrials]:
    """Return :func:`local_trials` of each image of pixel counts (N, H, W).

    Dead pixels get those of the nearest valid one.

    Raises
    ------
    ValueError
        When no pixel of an image has a valid bit.

    Examples
    --------
    >>> from jotlight.sensing.pixel_counts import PixelCounts
    >>> from jotlight.sensing.sensor import Sensor
    >>> trials = np.array([[[4.0, 0.0]], [[2.0, 2.0]]])
    >>> counts = np.zeros(trials.shape, np.int32)
    >>> count_local_trials(PixelCounts(Sensor(), counts, trials, 1.0, 0.0, False))
    [4, 2]
    """
    check_any_valid(pixels.trials)
    number = len(pixels.counts)
    if not isinstance(pixels.trials, np.ndarray):
        return [max(1, round(pixels.trials))] * number
    # The images of a sensor with a mask share one map.
    is_shared = pixels.trials.strides[0] == 0
    maps = pixels.trials[:1] if is_shared else pixels.trials
    local = _local_trials_of([fill_from_nearest(trials, trials > 0) for trials in maps])
    return local * number if is_shared else local


def share_levels(
    trials: Sequence[LocalTrials],
) -> Iterator[tuple[int, list[tuple[list[int], Image | None]]]]:
    """Yield the levels of several images, each with groups of images and their weights.

    Parameters
    ----------
    trials : sequence of int or ndarray (H, W)
        The local trials of each image. A number is the only level of an image.

    Yields
    ------
    int
        The level, from the smallest one.
    list of (list of int, ndarray or None)
        Groups of images, with the weights (H, W) of the level at their pixels, or None for 1.

    Examples
    --------
    >>> two = np.array([[8.0, 11.0]])
    >>> for level, groups in share_levels([11, two, 11, two]):
    ...     print(level, groups)
    8 [([1, 3], array([[1., 0.]], dtype=float32))]
    11 [([0, 2], None), ([1, 3], array([[0., 1.]], dtype=float32))]
    """
    groups: dict[int, list[int]] = {}
    for image, each in enumerate(trials):
        # Images of the same sensor share one map.
        groups.setdefault(-id(each) if isinstance(each, np.ndarray) else each, []).append(image)
    levels: dict[int, list[tuple[list[int], Image | None]]] = {}
    for images in groups.values():
        each = trials[images[0]]
        if isinstance(each, np.ndarray):
            for level, weights in level_weights(each):
                levels.setdefault(level, []).append((images, weights))
        else:
            levels.setdefault(each, []).append((images, None))
    for level in sorted(levels):
        yield level, levels[level]


def interpolate_levels(
    run: Callable[[int, list[int]], Image],
    trials: Sequence[LocalTrials],
    shape: tuple[int, int],
) -> Image:
    """Return images whose pixels are those of their nearest level, or lie between two levels.

    Parameters
    ----------
    run : callable
        A function of a level and a list of images, which returns these images, (M, H, W). It is
        called once for each level, or several times if there are many pixels.
    trials : sequence of int or ndarray (H, W)
        The local trials of each image, above 0. A number is the only level of an image.
    shape : (int, int)
        The size of the images.

    Examples
    --------
    >>> trials = np.array([[8, 9, 10, 11]])
    >>> run = lambda level, images: np.full((len(images), 1, 4), level)
    >>> interpolate_levels(run, [trials, 8], (1, 4)).round(2).tolist()
    [[[8.0, 8.0, 9.199999809265137, 11.0]], [[8.0, 8.0, 8.0, 8.0]]]
    """
    result = np.zeros((len(trials), *shape), np.float32)
    number = max(1, MAX_PIXELS // (shape[0] * shape[1]))
    for level, groups in share_levels(trials):
        images = [(image, weights) for group, weights in groups for image in group]
        for start in range(0, len(images), number):
            part = images[start : start + number]
            values = run(level, [image for image, _ in part])
            for (image, weights), value in zip(part, values, strict=True):
                result[image] += value if weights is None else weights * value
    return result


def fill_from_nearest(values: npt.NDArray[np.floating], known: npt.NDArray[np.bool_]) -> Image:
    """Return an image whose unknown pixels have the values of the nearest known ones.

    At least one pixel must be known.

    Examples
    --------
    >>> fill_from_nearest(np.array([[2.0, 0.0, 0.0, 3.0]]), np.array([[True, False, False, True]]))
    array([[2., 2., 3., 3.]], dtype=float32)
    """
    if known.all():
        return values.astype(np.float32)
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)], np.float32)
