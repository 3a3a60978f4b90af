"""The images of a film by the film network, which also reads the last image."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.errors import warn
from jotlight.estimators.inverse_response import equivalent_fractions, intensity_from_probability
from jotlight.motion.films.image import FilmImage
from jotlight.networks.network import Network
from jotlight.networks.planes.film_planes import Counts, film_planes, usual_trials
from jotlight.networks.planes_network import FilmNetwork
from jotlight.networks.pretrained import FILM_START, FOLDER, pretrained_film
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.likelihood.reference import response_of
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.binomial import arcsin_root
from jotlight.squares import mean_squares

_MAX_TRIALS = 512
"""Number of readings for which the network corrects images with more of them.

Few films of its training have more. With its layers for 950 readings, dark films lost 10 dB as soon
as they had a last image.
"""

_MAX_RATIO = 8.0
"""Largest ratio of the numbers of trials of pixels with many and with few for which the network
corrects an image. In the films of its training, it is below 4. It is larger in brackets with a wide
range of light. With a ratio of 50, the network lost 2 dB."""

_TRAINED = 64, 256
"""Minimum and maximum number of frames of the windows in the films of its training."""

_MANY, _FEW = 0.9, 0.1
"""Fractions of the pixels with fewer trials than those with many, and than those with few."""


class FilmEstimates:
    """The images of one film by a film network, one after the other.

    The network corrects the estimates of the gray network "large" where a scene moves, unless some
    pixels have far more trials than others, as in brackets with a wide range of light. It reads the
    counts of a window, those of the quarter and the sixteenth of its frames that are nearest to the
    time of the image, those of the four sixteenths next to it, and its own last image. It reads
    the last image only if the window contains its time: if the step is at most half of the window,
    or shorter than the window in a causal film. The network that comes with jotlight was trained
    for windows of 64 to 256 frames. For shorter ones, its images are worse than those of "large".

    Parameters
    ----------
    network : FilmNetwork, optional
        The network. Default: the trained one that comes with jotlight. The gray network has its
        precision.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=80)
    >>> scene = jl.datasets.moving(
    ...     motion="shake", sensor=sensor, shape=(64, 64), photons=0.5, rng=1
    ... )
    >>> estimates = jl.FilmEstimates()
    >>> film = jl.film(scene.bits, window=64, step=8, causal=True)
    >>> [estimates.add(image).shape for image in film]
    [(64, 64), (64, 64), (64, 64)]
    """

    def __init__(self, network: FilmNetwork | None = None, *, threads: int | None = None) -> None:
        self.network = pretrained_film() if network is None else network
        gray = Network.load(FOLDER / f"{FILM_START}.safetensors")
        self._gray = gray.with_precision(self.network.precision)
        self._threads = threads
        self._last: Image | None = None
        """z = arcsin √p of the last image."""
        self._time = 0.0
        self._has_warned = False

    def add(self, image: FilmImage) -> Image:
        """Return the intensities in [0, S] of the next image of the film, (H, W).

        Those of merged counts (H, W, 1) have this shape, too.

        Raises
        ------
        TypeError
            When it is no image of a film.
        ValueError
            When the image has colors or a finer grid, which the network does not read, or when its
            sensor has a smooth kernel.

        Warns
        -----
        JotlightWarning
            When the window has fewer than 64 frames. There is one warning for a film.
        """
        if not isinstance(image, FilmImage):
            raise TypeError(
                "image: expected an image of jotlight.film(bits, window=64), got "
                f"{type(image).__name__}"
            )
        shape = image.merged.shape
        image = _without_channel_axis(image)
        # Sums of a scene that stands still need no correction.
        if image.motion.model == "none" or _are_uneven(image.merged):
            found = self._start(image)
        else:
            planes, usual = self.planes_of(image)
            trials = min(usual, _MAX_TRIALS)
            found = self.network.estimate_probability(planes, trials, threads=self._threads)[0]
        probability = np.clip(found, 0, 1)
        self._last = arcsin_root(probability)
        self._time = image.time
        self._warn_about_window(image)
        intensity = intensity_from_probability(probability, image.merged.sensor, self._threads)
        return intensity.reshape(shape)

    def _warn_about_window(self, image: FilmImage) -> None:
        """Warn once if the window of an image is shorter than those of the training."""
        frames, (shortest, longest) = image.merged.sensor.frames, _TRAINED
        if self._has_warned or frames >= shortest:
            return
        self._has_warned = True
        warn(
            f"window: the film network is for windows of {shortest} to {longest} frames, got "
            f'{frames}; jotlight.reconstruct(image.data, quality="large") (--quality large in '
            "place of --recurrent) is better for shorter ones"
        )

    def planes_of(self, image: FilmImage) -> tuple[Image, float]:
        """Return what the network reads of the next image, and its usual number of trials."""
        start = self._start(image)
        counts = [self._counts(part) for part in (image.merged, *image.nearest)]
        usual = usual_trials(counts[0])
        return film_planes(start, counts, usual, self._displaced(image)), usual

    def _start(self, image: FilmImage) -> Image:
        """Return P(b = 1) by the gray network."""
        if not image.nearest:
            raise ValueError(
                "image: expected gray counts on the grid of the sensor, got colors or a finer "
                "grid; jotlight.reconstruct(image.data) estimates them"
            )
        sensor = image.merged.sensor
        self.network.check_sensor(sensor)
        estimate = self._gray.reconstruct(image.merged, threads=self._threads)
        return response_of(sensor)(estimate.astype(np.float64)).astype(np.float32)

    def _counts(self, merged: Merged) -> Counts:
        counted = count_pixels(merged, merged.sensor, self._threads)
        trials = np.broadcast_to(np.asarray(counted.trials, np.float32), merged.ones.shape)
        return Counts(equivalent_fractions(counted, self._threads), trials)

    def _displaced(self, image: FilmImage) -> Image | None:
        """Return z of the last image at the places where it showed the present points.

        It is NaN outside of the last image. Points that something hid there count as shown.
        """
        displacement = image.displacement_from(self._time)
        if self._last is None or displacement is None or self._last.shape != image.merged.shape:
            return None
        return displaced(self._last, displacement, image.merged.sensor.oversampling)


def _without_channel_axis(image: FilmImage) -> FilmImage:
    """Return an image of one channel as a gray one, like its nearest counts. Others stay."""
    if image.merged.shape[2:] != (1,):
        return image
    return dataclasses.replace(image, merged=next(image.merged.channels()))


def _are_uneven(merged: Merged) -> bool:
    """Return whether some pixels have far more trials than others."""
    trials = np.asarray(merged.trials)
    seen = trials[trials > 0]
    return bool(seen.size) and bool(np.quantile(seen, _MANY) > _MAX_RATIO * np.quantile(seen, _FEW))


def displaced(last: Image, displacement: npt.NDArray[np.floating], side: int = 1) -> Image:
    """Return an image (H, W) at displaced places, by linear interpolation, and NaN outside.

    Parameters
    ----------
    last : ndarray of float32, shape (H, W)
        The image.
    displacement : ndarray of float, shape (2, H·side, W·side)
        The displacement of each jot in rows and columns, in jots.
    side : int
        A pixel has side × side jots.

    Examples
    --------
    >>> image = np.arange(12, dtype=np.float32).reshape(3, 4)
    >>> displaced(image, np.stack([np.zeros((3, 4)), np.full((3, 4), 0.5)]))[0].tolist()
    [0.5, 1.5, 2.5, nan]
    """
    from scipy.ndimage import map_coordinates

    height, width = last.shape
    moved = mean_squares(displacement, side) / np.float32(side)
    places = np.indices(last.shape, np.float32) + moved
    inside = (places >= 0) & (places <= np.reshape([height - 1, width - 1], (2, 1, 1)))
    found = map_coordinates(last, places, np.float32, order=1, mode="nearest")
    return np.asarray(np.where(inside.all(axis=0), found, np.float32(np.nan)))


def estimate_film(
    images: Iterable[FilmImage],
    network: FilmNetwork | None = None,
    *,
    threads: int | None = None,
) -> Iterator[Image]:
    """Yield the intensities of the images of a film by a film network, (H, W).

    The parameters are those of :class:`FilmEstimates`.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=80)
    >>> scene = jl.datasets.moving(
    ...     motion="shake", sensor=sensor, shape=(64, 64), photons=0.5, rng=1
    ... )
    >>> len(list(jl.estimate_film(jl.film(scene.bits, window=64, step=8))))
    3
    """
    estimates = FilmEstimates(network, threads=threads)
    for image in images:
        yield estimates.add(image)
