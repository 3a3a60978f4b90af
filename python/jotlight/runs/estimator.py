"""A method with its sensor, which workers run on the counts of images."""

import dataclasses
import functools
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight.errors import warn
from jotlight.estimators.demosaicing import COLORS, choose_demosaicing
from jotlight.evaluation.choice import Choice, check_fallback
from jotlight.evaluation.contradictions.bright_pixels import bright_in_first_frames
from jotlight.evaluation.contradictions.clipping import (
    clipping_of,
    warn_about_clipping,
    with_clipping_of,
)
from jotlight.evaluation.contradictions.dark_counts import warn_about_dark_counts
from jotlight.evaluation.methods import COLOR_NETWORK, needs_bits
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.records.info import Info, mean_settings
from jotlight.evaluation.records.weights import weight_files, weights_sha256
from jotlight.evaluation.request import Request
from jotlight.evaluation.run_choice import run_choice
from jotlight.layout import Layout
from jotlight.networks.color.mosaic_planes import plane_sensors
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained, pretrained_conditional
from jotlight.sensing.data.alike_frames import find_cycle
from jotlight.sensing.data.pixel_counts import GrayImages
from jotlight.sensing.parameters.reading_groups import require_plain_bits, without_mosaic
from jotlight.sensing.sensor import Sensor, require_any_sensor

_KEPT = 8
"""Number of networks that a process keeps."""


@dataclasses.dataclass(frozen=True)
class Estimator:
    """A method with its sensor, which estimates images from counts. Workers get copies of it."""

    sensor: Sensor
    request: Request
    """What the caller requests, with the network of the caller, if there is one."""
    choice: Choice
    """The method. Each process reads a pretrained network from its own installation."""

    def with_threads(self, threads: int | None) -> Self:
        """Return the estimator for a number of threads, on which the estimate does not depend."""
        return dataclasses.replace(self, request=self.request.with_threads(threads))

    @property
    def is_color(self) -> bool:
        """Whether an image is estimated from several filters or channels together."""
        return self.sensor.mosaic is not None or self.choice.is_color

    @property
    def is_pixelwise(self) -> bool:
        """Whether a pixel of the estimate depends on its own count alone.

        Networks depend on more than the receptive fields of their filters: the mean and the
        brightest pixels of an image decide how its dark regions are estimated.
        """
        return self.choice.method == "mle" and not (self.sensor.maps() or self.is_color)

    @property
    def own_network(self) -> Network | None:
        """The network of the caller."""
        return self.request.method if isinstance(self.request.method, Network) else None

    def _network(self) -> Network | None:
        """Return the network to run, if it is that of the caller or has a size."""
        if (quality := self.choice.quality) is None:
            return self.own_network
        return _pretrained(self.sensor, quality, is_conditional=self.request.fallback)

    def weights(self, model: Path | None = None) -> str | list[str] | None:
        """Return the SHA-256 of the files of weights, as :func:`weights_sha256` does.

        `model` is the file of the caller's network.
        """
        files = weight_files(
            [self.sensor],
            self.choice.method,
            self.choice.quality,
            model=model,
            is_conditional=self.request.fallback,
            is_color=self.choice.is_color,
        )
        return weights_sha256(files)

    def estimate_shape(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of the estimates of counts (N, H, W) or (N, H, W, C).

        Raises
        ------
        ValueError
            When counts of a mosaic have channels.

        Examples
        --------
        >>> choose_estimator(jl.Sensor(mosaic="RGGB"), "mle").estimate_shape((5, 16, 24))
        (5, 16, 24, 3)
        """
        if self.sensor.mosaic is None:
            return shape
        if len(shape) > 3:
            raise ValueError(
                "mosaic: expected gray frames, because the pixels of a mosaic have one color each, "
                f"got {shape[3]} channels; leave out the mosaic"
            )
        return *shape, COLORS

    @property
    def has_table(self) -> bool:
        """Whether the estimate of a pixel depends on its count alone."""
        return self.is_pixelwise and self.sensor.has_plain_bits

    def table(self) -> npt.NDArray[np.float32]:
        """Return the estimate for each count from 0 to K, if it depends on the count alone.

        Examples
        --------
        >>> choose_estimator(jl.Sensor(frames=4), "mle").table().round(2).tolist()
        [0.0, 0.28999999165534973, 0.6899999976158142, 1.0, 1.0]
        """
        table: npt.NDArray[np.float32] = self(
            np.arange(self.sensor.trials + 1, dtype=np.int32)[None, None]
        )[0, 0]
        return table

    def __call__(
        self,
        counts: npt.NDArray[np.int32],
        out: npt.NDArray[np.float32] | None = None,
        *,
        warns: bool = False,
    ) -> npt.NDArray[np.float32]:
        """Return the estimates of counts, as :meth:`run` does."""
        return self.run(counts, out, warns=warns)[0]

    def run(
        self,
        counts: npt.NDArray[np.int32],
        out: npt.NDArray[np.float32] | None = None,
        *,
        warns: bool = False,
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Return the estimates of counts (N, H, W) or (N, H, W, C), and what the method found.

        Those of a mosaic are (N, H, W, 3). `out` is an array for them, which is returned. Default:
        a new one. With `warns`, warn if the first image contradicts the sensor, as
        :func:`jotlight.reconstruct` does. To compare an image may take longer than its estimate.
        What the method found are the means of :meth:`Info.found_settings` over the images.
        """
        estimates = np.empty(self.estimate_shape(counts.shape), np.float32) if out is None else out
        if counts.size == 0:
            return estimates, {}
        if self.is_color:
            return estimates, mean_settings(self._estimate_colors(counts, estimates))
        images, network = _gray_images(counts), self._network()
        settings = self.request, images, self.sensor, estimates
        _, *ending = run_choice(self.choice, *settings, network=network)
        if warns:
            self._warn_about_contradictions(_gray_images(counts[:1]), estimates[:1])
        info = Info(self.choice.method, self.choice.title, self.choice.reason, 0.0, *ending)
        return estimates, info.found_settings()

    def _warn_about_contradictions(
        self, images: GrayImages, estimates: npt.NDArray[np.float32]
    ) -> None:
        threads = self.request.threads
        with with_clipping_of(self.choice):
            bright = functools.partial(bright_in_first_frames, images, self.sensor, threads)
            warn_about_clipping(estimates, self.sensor, bright)
        if (remark := clipping_of(self.choice, float(estimates.max()))) is not None:
            warn(remark)
        warn_about_dark_counts(images, self.sensor, threads)

    def _estimate_colors(
        self, counts: npt.NDArray[np.int32], out: npt.NDArray[np.float32]
    ) -> list[dict[str, Any]]:
        """Write the estimates of counts of a mosaic, or of three channels, one after another.

        Return what the method found for each image.
        """
        settings = self.request.of_choice(self.choice).arguments() | {"return_info": True}
        found = []
        for image, estimate in zip(counts, out, strict=True):
            axis = None if image.ndim == 2 else -1
            _, info = reconstruct(image, self.sensor, channel_axis=axis, out=estimate, **settings)
            found.append(info.found_settings())
        return found


def _gray_images(counts: npt.NDArray[np.int32]) -> GrayImages:
    """Return counts (N, H, W), or those of N images with channels (N, H, W, C), as gray images."""
    if channels := counts.shape[3:]:
        # The layout (N, C) has the channels as the last axis of the result.
        gray = np.ascontiguousarray(np.moveaxis(counts, -1, 1)).reshape(-1, *counts.shape[1:3])
        return GrayImages(gray, Layout((len(counts), *channels), -1))
    return GrayImages(np.ascontiguousarray(counts), Layout((len(counts),)))


@functools.lru_cache(_KEPT)
def _pretrained(sensor: Sensor, quality: str, *, is_conditional: bool) -> Network:
    return (pretrained_conditional if is_conditional else pretrained)(sensor, quality)


def choose_estimator(
    sensor: Sensor,
    method: str | Network | None = None,
    quality: str | None = None,
    options: dict[str, Any] | None = None,
    *,
    demosaicing: str | None = None,
    precision: str | None = None,
    channels: int = 1,
) -> Estimator:
    """Return the recommended method for counts of a sensor, or the requested one.

    Parameters
    ----------
    sensor : Sensor
        The sensor of an image.
    method, quality, demosaicing, precision
        As for :func:`jotlight.reconstruct`.
    options : dict, optional
        Its further options: those of the method, and `fallback`.
    channels : int
        Number of channels of the counts.

    Raises
    ------
    TypeError, ValueError
        When the method, its options, and the sensor do not fit together.

    Examples
    --------
    >>> choose_estimator(jl.Sensor(frames=16), quality="small").choice.method
    'network-small'
    >>> choose_estimator(jl.Sensor(frames=16, mosaic="RGGB")).choice.method
    'network-color'
    """
    options = dict(options or {})
    fallback = bool(options.pop("fallback", False))
    check_countable(sensor)
    if not isinstance(method, str | Network | None):
        raise TypeError(
            "method: expected the name of a method, or a network for gray images, got "
            f"{method!r}; the pretrained color network is the default for colors"
        )
    request = Request(method, quality, demosaicing, precision, fallback, options, threads=1)
    choice = request.choose(sensor, takes_colors=sensor.mosaic is not None or channels == COLORS)
    return checked(Estimator(sensor, request, choice))


def checked(estimator: Estimator) -> Estimator:
    """Return an estimator, or raise ValueError if its parts do not fit together."""
    sensor, request, choice = estimator.sensor, estimator.request, estimator.choice
    _check_method(choice.method, sensor)
    network = estimator.own_network
    if network is not None:
        for each in plane_sensors(sensor):
            network.check_sensor(each)
    if request.fallback:
        check_fallback(sensor, choice.method, choice.quality, network)
    if sensor.mosaic is not None and choice.method != COLOR_NETWORK:
        choose_demosaicing(sensor.mosaic, request.demosaicing)
    return estimator


def _check_method(method: str, sensor: Sensor) -> None:
    """Raise ValueError if a method needs more than the counts of pixels."""
    if needs_bits(method, sensor):
        raise ValueError(
            f"method: {method} needs bits for the kernel {sensor.kernel}, but runs over windows or "
            f"captures count the ones of {sensor.oversampling} x {sensor.oversampling} jots; use "
            "another method, or jotlight.reconstruct(bits) (`jotlight reconstruct` of this capture "
            "by itself, as a whole)"
        )


def check_countable(sensor: Sensor) -> None:
    """Raise ValueError if the counts of pixels are not enough for the data of a sensor."""
    require_any_sensor(sensor)
    film = ", and `jotlight film` a film" if find_cycle(sensor) is not None else ""
    advice = (
        "runs over windows or captures estimate images from counts of single bits of one exposure; "
        "jotlight.reconstruct(bits) (`jotlight reconstruct` of this capture by itself, as a whole) "
        f"makes an image{film}"
    )
    require_plain_bits(without_mosaic(sensor), advice)
    if sensor.oversampling > 1 and sensor.maps():
        raise ValueError(
            "sensor: expected one without maps of its jots, because counts of pixels of "
            f"{sensor.oversampling} x {sensor.oversampling} jots do not say which jots reported 1; "
            "use oversampling=1 (--oversampling 1)"
        )
