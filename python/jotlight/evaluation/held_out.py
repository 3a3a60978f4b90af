"""The blend of several methods under which held-out bits are most likely."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Array, Image
from jotlight.errors import hide_warnings
from jotlight.estimators.admm import admm_tv
from jotlight.estimators.demosaicing import COLORS
from jotlight.estimators.inpaint import NO_VALID_BIT, warn_about_dead_pixels
from jotlight.estimators.mle import mle
from jotlight.evaluation.blend_weights import blend_weights
from jotlight.evaluation.color.color_data import takes_channels
from jotlight.evaluation.color.color_images import reconstruct_channels
from jotlight.layout import Layout, join
from jotlight.networks.network import Network
from jotlight.networks.pretrained import DEFAULT_SIZE, pretrained
from jotlight.sensing.bits.subsampling import draw_share
from jotlight.sensing.data.gray_outputs import output_of
from jotlight.sensing.data.pixel_counts import (
    Data,
    GrayImages,
    PixelCounts,
    gray_images,
    prepare_data,
)
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

NAMES = "network", "total variation", "maximum likelihood"
"""Names of the methods of the blend for gray images."""

COLORS_NAME = "color network"
"""Name of the color network, which is a method of the blend for colors."""

HELD_OUT_FRACTION = 0.2
"""Fraction of the bits that are held out.

On six photographs with K from 256 to 100,000, images are up to 0.02 dB worse with 0.1 or 0.35, and
up to 0.3 dB worse with 0.05 (ad hoc; decision 20 is about the blend)."""

_SEED = 2026
"""Seed of the draw of the held-out bits, so that the result is reproducible."""

_MIN_WEIGHT = 1e-3
"""Weight below which a method is left out."""

_MAX_REGIONS = 8
"""Maximum number of regions. With a single one, images of the six photographs of
`HELD_OUT_FRACTION` are up to 1.6 dB worse (ad hoc; decision 53 is about their number)."""

_MIN_REGION = 4096
"""Minimum number of pixels of a region, so that its held-out bits suffice for its weights."""

_BLUR = 2.0
"""Standard deviation of the Gaussian that smooths the brightness, in pixels."""

_DIM_FLOOR = 0.1
"""Largest floor of the light, as a fraction of its mean."""

_DARK = 1e-3
"""Fraction of the mean light below which all pixels count as equally dark."""


def held_out(
    data: Data,
    sensor: Sensor | None = None,
    *,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    out: npt.NDArray[np.float32] | None = None,
    threads: int | None = None,
) -> Image:
    """Return the blend of networks, total variation, and maximum likelihood that suits the data.

    With many trials, the pixels say more than any prior, and the best method depends on the scene.
    A fifth of the bits of each pixel, at random, is held out. The pretrained network "medium",
    :func:`jotlight.admm_tv`, and :func:`jotlight.mle`, and for three color channels the color
    network, estimate the image from the others. Their weights are those under which the held-out
    bits are most likely, for up to eight regions of different brightness. The result is the
    weighted sum of the estimates from all bits. Between the mean brightnesses of the regions, the
    weights are interpolated by the brightness of a pixel.

    Parameters
    ----------
    data : Bits, Merged, list of them, or array_like of int
        Bits, merged counts, or counts L of shape (..., H, W).
    sensor : Sensor, optional
        The sensor that recorded the data, with the box kernel. Default: the one that bits or merged
        counts carry.
    trials : float or array_like of float, optional
        The number of binary readings behind each pixel of counts, 0 or more: a number, or a map of
        the shape of the counts. Default: the sensor's K.
    channel_axis : int, optional
        The axis of counts that holds color channels. Default: none, and axes before the last two
        are those of a stack.
    out : ndarray of float32, optional
        An array of the shape of the result to write to and return. Default: a new one.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    ndarray of float32
        Intensities in [0, S], of the shape of the counts. Estimates of color bits are (H, W, C).

    Raises
    ------
    TypeError, ValueError
        When data, sensor, trials, and `out` do not fit together, or for a smooth kernel.

    Warns
    -----
    JotlightWarning
        When pixels without a valid bit were inpainted from their neighbors.

    Notes
    -----
    The weights are 0 or more and have the sum 1. The best single method is one of these blends. But
    held-out bits cannot rank two methods that are nearly as good, whereas the blend of two such
    methods is better than both if they err in different ways. The log-likelihood is concave in the
    weights. The methods run on all images of a stack at once; the weights of each image are chosen
    one image after another.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=4000)
    >>> image = np.outer(np.linspace(0.1, 0.3, 32), np.ones(32))
    >>> bool(abs(held_out(sensor.expose(image, rng=0)) - image).max() < 0.02)
    True
    """
    data, sensor = prepare_data(data, sensor, trials, channel_axis)
    images = gray_images(data)
    output = output_of(images, sensor, out)
    network = pretrained(sensor, DEFAULT_SIZE)
    is_color = takes_channels(images)
    return output.finish(blend(images, sensor, network, threads, is_color=is_color)[0])


def blend(
    images: GrayImages,
    sensor: Sensor,
    network: Network,
    threads: int | None,
    *,
    is_color: bool = False,
) -> tuple[Image, dict[str, float]]:
    """Return the blends of :func:`held_out` with another network, (N, H, W), and the shares.

    Parameters
    ----------
    images : GrayImages
        The data.
    sensor : Sensor
        The sensor of the data.
    network : Network
        The K-conditioned network of the blend.
    threads : int, optional
        The number of threads. Default: the number of cores.
    is_color : bool
        Whether the images are color channels, red, green, and blue of each image, which the color
        network estimates, too.

    Returns
    -------
    ndarray of float32, shape (N, H, W)
        The blends.
    dict of str to float
        The mean weight of each method, by its name. They sum to 1.
    """
    if (reason := smooth_kernel_reason(sensor)) is not None:
        raise ValueError(f"sensor: {reason}")
    functions: list[EstimateImages] = [
        lambda images: network.reconstruct(images, sensor, threads=threads),
        lambda images: admm_tv(images, sensor, threads=threads),
        lambda images: mle(images, sensor, threads=threads),
    ]
    methods = list(map(BlendedMethod, NAMES, functions))
    if is_color:
        by_colors = partial(reconstruct_channels, sensor=sensor, out=None, threads=threads)
        methods.insert(0, BlendedMethod(COLORS_NAME, by_colors, COLORS))
    estimates, shares = [], []
    for part in images.parts(sensor, together=methods[0].together):
        pixels = part.count(sensor, threads)
        weights = used_weights(_choose_weights(methods, pixels, threads))
        total = np.zeros(weights.shape[1:], np.float32)
        for weight, method in zip(weights, methods, strict=True):
            if len(places := method.places(weight)):
                with hide_warnings(NO_VALID_BIT):
                    total[places] += weight[places] * method.estimate(part.select(places.tolist()))
        if pixels.dead_pixels is not None:
            warn_about_dead_pixels(pixels.dead_pixels)
        estimates.append(np.clip(total, 0, np.float32(sensor.max_intensity)))
        shares.extend(weights.mean(axis=(2, 3), dtype=np.float64).T)
    means = zip(methods, np.mean(shares, axis=0), strict=True)
    return join(estimates), {method.name: float(share) for method, share in means}


def smooth_kernel_reason(sensor: Sensor) -> str | None:
    """Return why the bits of a sensor cannot be divided at random, or None if they can.

    Examples
    --------
    >>> smooth_kernel_reason(jl.Sensor(frames=16)) is None
    True
    """
    if sensor.kernel == "box":
        return None
    return (
        f"expected the box kernel for a blend on held-out bits, got {sensor.kernel}: the jots of a "
        "pixel receive different light"
    )


EstimateImages = Callable[[GrayImages], Image]
"""A function that returns the estimates (N, H, W) of images."""


class BlendedMethod(NamedTuple):
    """A method of the blend."""

    name: str
    estimate: EstimateImages
    together: int = 1
    """Number of successive images that it estimates together."""

    def places(self, weight: Image) -> npt.NDArray[np.intp]:
        """Return the places of the images (N, H, W) to estimate, those with any weight above 0."""
        used = weight.any(axis=(1, 2)).reshape(-1, self.together).any(axis=1)
        return np.flatnonzero(np.repeat(used, self.together))


def _choose_weights(
    methods: list[BlendedMethod], pixels: PixelCounts, threads: int | None
) -> Image:
    """Return the weight of each method at each pixel, (M, N, H, W)."""
    sensor = pixels.sensor
    each = [pixels.select([place]) for place in range(len(pixels.counts))]
    held_out = [hold_out(one) for one in each]
    training = [
        Merged(
            (one.counts - ones)[0],
            np.asarray(one.trials - trials, np.float64)[0],
            sensor,
            dark_counts=_first(one.dark_counts),
            efficiency=_first(one.efficiency),
        )
        for one, (ones, trials) in zip(each, held_out, strict=True)
    ]
    stack = GrayImages(training, Layout((len(training),)))
    with hide_warnings():  # the estimates from all bits warn, too
        estimates = np.stack([method.estimate(stack) for method in methods], axis=1)
    lights = estimates.astype(np.float64) * sensor.light_per_intensity
    weights = [
        weights_of_image(one, *bits, own, threads)
        for one, bits, own in zip(each, held_out, lights, strict=True)
    ]
    return np.stack(weights, axis=1)


def used_weights(weights: Image) -> Image:
    """Return weights (M, N, H, W) without methods of small weight, with the sum 1 at each pixel.

    A method is left out of an image if its weight is small at all pixels.

    Examples
    --------
    >>> used_weights(np.float32([0.0005, 0.3995, 0.6]).reshape(3, 1, 1, 1)).ravel().round(4)
    array([0.    , 0.3997, 0.6003], dtype=float32)
    """
    used = weights * (weights.max(axis=(2, 3), keepdims=True) >= _MIN_WEIGHT)
    return np.asarray(used / used.sum(axis=0), np.float32)


def _first(value: float | Array) -> float | Array:
    return value[0] if isinstance(value, np.ndarray) else value


def weights_of_image(
    pixels: PixelCounts,
    ones: npt.NDArray[np.int32],
    trials: Array,
    lights: Array,
    threads: int | None,
) -> Image:
    """Return the weights of one image, (M, H, W), from its held-out bits.

    Parameters
    ----------
    pixels : PixelCounts
        All bits of the image.
    ones, trials : ndarray
        The held-out bits, as :func:`hold_out` returns them.
    lights : ndarray of float64, shape (M, H, W)
        The light at each pixel by each method, per frame and jot.
    threads : int, optional
        The number of threads. Default: the number of cores.
    """
    brightness = _brightness(lights)
    # Where an estimate is 0, a one among the held-out bits must not exclude a method. In a dim
    # scene, half a one would be more than the light.
    floor = 0.5 / max(float(np.mean(pixels.trials)), 1.0)
    floor = min(floor, max(_DIM_FLOOR * float(lights.mean()), np.finfo(np.float64).tiny))
    cells: list[Any] = [ones, trials, pixels.efficiency, pixels.dark_counts]
    weights, places = [], []
    for region in _split_by_brightness(brightness):
        own = [value.flat[region] if isinstance(value, np.ndarray) else value for value in cells]
        likelihood = Likelihood(
            own[0],
            own[1],
            threshold=pixels.sensor.threshold,
            efficiency=own[2],
            dark_counts=own[3],
            threads=threads,
        )
        own_lights = lights.reshape(len(lights), -1)[:, region]
        weights.append(blend_weights(likelihood, own_lights, floor))
        places.append(float(brightness.flat[region].mean()))
    interpolated = [np.interp(brightness, places, column) for column in np.transpose(weights)]
    return np.asarray(interpolated, np.float32)


def hold_out(pixels: PixelCounts) -> tuple[npt.NDArray[np.int32], Array]:
    """Return the ones among the held-out bits of each pixel, and the number of these bits."""
    trials = np.broadcast_to(np.asarray(pixels.trials, np.float64), pixels.counts.shape)
    rng = np.random.default_rng(_SEED)
    ones, number = draw_share(pixels.counts, trials, HELD_OUT_FRACTION, rng)
    return ones.astype(np.int32), number


def _brightness(lights: Array) -> Array:
    """Return the logarithm of the mean light in the neighborhood of each pixel, (H, W)."""
    from scipy.ndimage import gaussian_filter

    mean = gaussian_filter(lights.mean(axis=0), _BLUR)
    return np.asarray(np.log(mean + _DARK * mean.mean() + np.finfo(np.float64).tiny))


def _split_by_brightness(brightness: Array) -> list[npt.NDArray[np.intp]]:
    """Return the flat indices of the pixels of each region, from dark to bright."""
    number = min(max(brightness.size // _MIN_REGION, 1), _MAX_REGIONS)
    return np.array_split(np.argsort(brightness, axis=None), number)
