"""Methods for one number of trials, run at some levels of it and interpolated pixel by pixel."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Image
from jotlight.sensing.bits.values import check_any_valid
from jotlight.sensing.data.pixel_counts import MAX_PIXELS, PixelCounts
from jotlight.sensing.merged import MAX_SILENT_TRIALS

LocalTrials = int | Image
"""The local trials of an image: one whole number, or a map (H, W)."""


def local_trials(trials: npt.NDArray[np.floating], threads: int | None = None) -> LocalTrials:
    """Return the number of trials that states the noise around each pixel.

    The noise of a fraction of ones is inversely proportional to its trials. A denoiser weighs a
    pixel against its neighbors, so the mean noise around the pixel counts: the harmonic mean of the
    trials. Where it is nearly the same everywhere, it is returned as one whole number from 1. A
    fraction of at least 2/3 is rounded up, because a denoiser loses less with too few trials than
    with too many.

    Parameters
    ----------
    trials : ndarray, shape (H, W)
        The number of trials of each pixel, above 0.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> local_trials(np.full((3, 4), 16.0))
    16
    >>> trials = np.where(np.arange(90) < 45, 4.0, 16.0) * np.ones((8, 1))
    >>> local_trials(trials)[0, [0, 44, 45, 89]].round(1)
    array([ 4. ,  5.9,  7. , 16. ], dtype=float32)
    """
    return engine.local_trials([np.asarray(trials, np.float64)], threads)[0]


def count_local_trials(pixels: PixelCounts, threads: int | None = None) -> list[LocalTrials]:
    """Return :func:`local_trials` of each image of pixel counts (N, H, W).

    Dead pixels, and those that say nothing, get those of the nearest other one.

    Parameters
    ----------
    pixels : PixelCounts
        The counts.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Raises
    ------
    ValueError
        When no pixel of an image has a valid bit.

    Examples
    --------
    >>> from jotlight.sensing.data.pixel_counts import PixelCounts
    >>> trials = np.array([[[4.0, 0.0]], [[2.0, 2.0]]])
    >>> counts = np.zeros(trials.shape, np.int32)
    >>> count_local_trials(PixelCounts(jl.Sensor(), counts, trials, 1.0, 0.0, False))
    [4, 2]
    """
    check_any_valid(pixels.trials)
    number = len(pixels.counts)
    if not isinstance(pixels.trials, np.ndarray):
        return [local_trials(np.full((1, 1), pixels.trials), threads)] * number
    # The images of a sensor with a mask share one map.
    is_shared = pixels.trials.strides[0] == 0
    maps = pixels.trials[:1] if is_shared else pixels.trials
    filled = []
    for trials in maps:
        known = trials > MAX_SILENT_TRIALS
        known = known if known.any() else trials > 0
        filled.append(fill_from_nearest(trials, known).astype(np.float64))
    local = engine.local_trials(filled, threads)
    return local * number if is_shared else local


def share_levels(
    trials: Sequence[LocalTrials],
) -> Iterator[tuple[int, list[tuple[list[int], Image | None]]]]:
    """Yield the levels of several images, each with groups of images and their weights.

    The levels of a map are whole numbers, with ratios of about √2 where many pixels lie between
    them. A ratio of 2 costs networks up to 0.5 dB (``docs/results/networks.md``). The weights of a
    pixel belong to the largest level up to its trials, and near the next level to both. Their sum
    is 1. A level alone serves a pixel up to half of the way to the next one, by logarithm. From
    there on, the share of the next level rises: a denoiser loses less if it expects too few trials
    than if it expects too many.

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
    firsts = [trials[images[0]] for images in groups.values()]
    maps = [np.asarray(each, np.float32) for each in firsts if isinstance(each, np.ndarray)]
    weights_of_maps = iter(engine.level_weights(maps) if maps else [])
    levels: dict[int, list[tuple[list[int], Image | None]]] = {}
    for images, each in zip(groups.values(), firsts, strict=True):
        if isinstance(each, np.ndarray):
            for level, weights in next(weights_of_maps):
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
