"""A method with its sensor, which workers run on the counts of images."""

import dataclasses
import functools
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators.deconvolution import DECONVOLUTION_RADIUS
from jotlight.evaluation.choice import (
    OWN_NETWORK,
    check_fallback,
    choose_method,
    requested_method,
)
from jotlight.evaluation.held_out import blend
from jotlight.evaluation.methods import LARGE_METHOD, METHODS, check_options
from jotlight.layout import Layout
from jotlight.networks.architectures import QUALITIES
from jotlight.networks.graph import size_divisor
from jotlight.networks.network import Network
from jotlight.networks.pretrained import (
    CONDITIONAL_SIZE,
    pretrained,
    pretrained_conditional,
    pretrained_file,
)
from jotlight.sensing.pixel_counts import GrayImages
from jotlight.sensing.sensor import Sensor

_KEPT = 8
"""Number of networks that a process keeps."""


@dataclasses.dataclass(frozen=True)
class Estimator:
    """A method with its sensor, which estimates images from counts. Workers get copies of it."""

    sensor: Sensor
    method: str
    """Key of :data:`METHODS`, or :data:`OWN_NETWORK`."""
    quality: str | None = None
    """Size of a shipped network, which each process reads from its own installation."""
    network: Network | None = None
    """Network of the caller."""
    options: tuple[tuple[str, Any], ...] = ()
    """Options of the method."""
    threads: int | None = 1
    """Number of threads. The estimate does not depend on it."""
    fallback: bool = False
    """Whether a network falls back to other methods, as in `jotlight.reconstruct`."""

    @property
    def halo(self) -> int | None:
        """Radius in pixels on which a pixel of the estimate depends. None: on the whole image."""
        if self.sensor.maps() or self.fallback:
            return None
        network = self._network()
        if network is not None:
            radius = network.halo + (0 if self.sensor.kernel == "box" else DECONVOLUTION_RADIUS)
            return -(-radius // self.grid) * self.grid
        return 0 if self.method == "mle" else None

    @property
    def grid(self) -> int:
        """Tiles and their halos begin at multiples of this number, where strides begin, too."""
        network = self._network()
        return 1 if network is None else size_divisor(network.layers)

    def _network(self) -> Network | None:
        if self.quality is None:
            return self.network
        return _shipped(self.sensor, self.quality, is_conditional=self.fallback)

    def weights(self, model: Path | None = None) -> str | None:
        """Return the SHA-256 of the file of the network's weights, or None without a network.

        `model` is the file of the caller's network.
        """
        if model is None:
            quality = CONDITIONAL_SIZE if self.method == LARGE_METHOD else self.quality
            if quality is None:
                return None
            model = pretrained_file(self.sensor, quality, is_conditional=self.fallback)
        return hashlib.sha256(model.read_bytes()).hexdigest()

    def __call__(self, counts: npt.NDArray[np.int32]) -> npt.NDArray[np.float32]:
        """Return the estimates of counts (N, H, W) or (N, H, W, C)."""
        channels = counts.shape[3:]
        if counts.size == 0:
            return np.empty(counts.shape, np.float32)
        if channels:
            # The layout (N, C) has the channels as the last axis of the result.
            gray = np.ascontiguousarray(np.moveaxis(counts, -1, 1)).reshape(-1, *counts.shape[1:3])
            layout = Layout((len(counts), *channels), -1)
        else:
            gray, layout = np.ascontiguousarray(counts), Layout((len(counts),))
        images = GrayImages(gray, layout)
        if (network := self._network()) is not None:
            if self.fallback:
                return layout.arrange(blend(images, self.sensor, network, self.threads)[0])
            return network.reconstruct(images, self.sensor, threads=self.threads)
        run, options = METHODS[self.method].run, dict(self.options)
        return np.asarray(run(images, self.sensor, threads=self.threads, **options))


@functools.lru_cache(_KEPT)
def _shipped(sensor: Sensor, quality: str, *, is_conditional: bool) -> Network:
    return (pretrained_conditional if is_conditional else pretrained)(sensor, quality)


def choose_estimator(
    sensor: Sensor,
    method: str | Network | None = None,
    quality: str | None = None,
    options: dict[str, Any] | None = None,
) -> Estimator:
    """Return the recommended method for counts of a sensor, or the requested one.

    Raises
    ------
    TypeError, ValueError
        When the method, its options, and the sensor do not fit together.

    Examples
    --------
    >>> choose_estimator(Sensor(frames=16), quality="small").method
    'network-small'
    """
    options = dict(options or {})
    fallback = bool(options.pop("fallback", False))
    if quality is not None:
        if method is not None:
            raise ValueError(f"quality: selects a shipped network, but method is {method!r}")
        if quality not in QUALITIES:
            raise ValueError(f"quality: expected one of {', '.join(QUALITIES)}, got {quality!r}")
        method = f"network-{quality}"
    check_countable(sensor)
    if isinstance(method, Network):
        if options:
            raise ValueError(f"{next(iter(options))}: is not an option of a network; leave it out")
        method.check_sensor(sensor)
        return checked_fallback(Estimator(sensor, OWN_NETWORK, network=method, fallback=fallback))
    if method is not None and not isinstance(method, str):
        raise TypeError(f"method: expected the name of a method, or a network, got {method!r}")
    requested = requested_method(method, list(options))
    if requested is not None:
        check_options(requested, options)
    choice = choose_method(sensor, requested=requested)
    chosen = tuple(sorted(options.items()))
    return checked_fallback(
        Estimator(sensor, choice.method, choice.quality, options=chosen, fallback=fallback)
    )


def checked_fallback(estimator: Estimator) -> Estimator:
    """Return an estimator, or raise ValueError if it cannot fall back as it should."""
    if estimator.fallback:
        check_fallback(estimator.sensor, estimator.method, estimator.quality, estimator.network)
    return estimator


def check_countable(sensor: Sensor) -> None:
    """Raise ValueError if the counts of pixels are not enough for the data of a sensor."""
    if sensor.oversampling > 1 and sensor.maps():
        raise ValueError(
            "sensor: expected one without maps of its jots, because counts of pixels of "
            f"{sensor.oversampling} x {sensor.oversampling} jots do not say which jots reported 1; "
            "use oversampling=1 (--oversampling 1)"
        )
