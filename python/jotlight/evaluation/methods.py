"""All reconstruction methods by name, and the choice of a method for a sensor.

The command line, the experiments, and the contract tests take the methods from :data:`METHODS`.
"""

import dataclasses
from collections.abc import Callable, Collection
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.estimators.admm import admm_tv
from jotlight.estimators.mle import mle
from jotlight.estimators.mle_iterative import mle_iterative
from jotlight.estimators.noniterative import noniterative
from jotlight.evaluation.held_out import held_out
from jotlight.networks.network import Network
from jotlight.networks.pretrained import (
    CONDITIONAL_SIZE,
    pretrained,
    training_command,
    unsupported_message,
    unsupported_reason,
)
from jotlight.sensing.pixel_counts import Data, prepare_data
from jotlight.sensing.reference import saturation_intensity
from jotlight.sensing.sensor import Sensor

Run = Callable[..., npt.NDArray[np.float32]]


def initial_network(
    data: Data,
    sensor: Sensor | None = None,
    *,
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    threads: int | None = None,
    **options: Any,
) -> npt.NDArray[np.float32]:
    """Return the estimate of a network at its initial parameters.

    `options` are those of :meth:`jotlight.Network.initial`.
    """
    data, sensor = prepare_data(data, sensor, trials, channel_axis)
    return Network.initial(sensor, **options).reconstruct(data, sensor, threads=threads)


def trained_network(
    data: Data,
    sensor: Sensor | None = None,
    *,
    quality: str = "medium",
    trials: npt.ArrayLike | None = None,
    channel_axis: int | None = None,
    threads: int | None = None,
) -> npt.NDArray[np.float32]:
    """Return the estimate of the network that ships with jotlight for this sensor."""
    data, sensor = prepare_data(data, sensor, trials, channel_axis)
    return pretrained(sensor, quality).reconstruct(data, sensor, threads=threads)


@dataclasses.dataclass(frozen=True)
class Method:
    """A reconstruction method."""

    title: str
    run: Run
    """``run(data, sensor, *, threads)`` returns the estimate."""
    options: frozenset[str] = frozenset()
    """Names in :data:`OPTION_DEFAULTS` that this method accepts."""
    quality: str | None = None
    """Size of the shipped network, or None for other methods."""
    required_package: str | None = None
    """Package that must be installed in addition to jotlight's own dependencies."""
    unsupported_reason: Callable[[Sensor], str | None] = lambda _: None
    """Function that returns why the method cannot serve a sensor, or None if it can."""
    is_distinct: Callable[[Sensor], bool] = lambda _: True
    """Function that returns whether the estimate for a sensor differs from a faster method's."""
    warms_up: bool = True
    """Whether a comparison runs it on a corner first, so that its time is that of the method."""
    iterative: bool = False
    """Whether `run` takes `tol`, `max_iter`, `callback` and `return_history`."""

    @property
    def available(self) -> bool:
        """Whether the required package is installed."""
        return self.required_package is None or find_spec(self.required_package) is not None


_ITERATIVE_OPTIONS = frozenset({"tol", "max_iter"})


def _noniterative(title: str, denoiser: str, required_package: str | None = None) -> Method:
    run = partial(noniterative, denoiser=denoiser)
    return Method(
        f"non-iterative, {title}", run, frozenset({"inverse"}), required_package=required_package
    )


def _shipped_network(title: str, quality: str) -> Method:
    return Method(
        f"network, {title}",
        partial(trained_network, quality=quality),
        quality=quality,
        unsupported_reason=partial(unsupported_message, quality=quality),
    )


METHODS: dict[str, Method] = {
    "mle": Method("maximum likelihood", mle, frozenset({"uncertainty"})),
    "mle-iterative": Method(
        "maximum likelihood, iterative",
        mle_iterative,
        _ITERATIVE_OPTIONS,
        is_distinct=lambda sensor: sensor.kernel != "box",
        iterative=True,
    ),
    "noniterative-gaussian": _noniterative("Gaussian", "gaussian"),
    "noniterative-tv": _noniterative("total variation", "tv"),
    "noniterative-nlm": _noniterative("non-local means", "nlm"),
    "noniterative-bm3d": _noniterative("BM3D", "bm3d", required_package="bm3d"),
    "admm-tv": Method(
        "ADMM, total variation",
        admm_tv,
        _ITERATIVE_OPTIONS | {"weight", "norm"},
        iterative=True,
    ),
    "network-initial": Method("network, initial", initial_network),
    "network-two-layer": _shipped_network("two-layer", "two-layer"),
    "network-small": _shipped_network("small", "small"),
    "network-medium": _shipped_network("medium", "medium"),
    "network-large": _shipped_network("large", "large"),
    "held-out": Method(
        "best blend on held-out bits",
        held_out,
        unsupported_reason=partial(unsupported_message, quality=CONDITIONAL_SIZE),
        is_distinct=lambda sensor: sensor.trials > LARGE_TRIALS,
    ),
}
"""All methods, in the order in which tables list them."""

DEEP_NETWORKS = "network-small", "network-medium", "network-large"
"""Networks that go beyond the paper."""

DEFAULT_METHOD = "network-medium"
"""Method for every sensor that it serves, unless another one is requested."""

LARGE_METHOD = "held-out"
"""Method for these sensors instead of the default if K is above :data:`LARGE_TRIALS`."""

LARGE_TRIALS = 1000
"""Largest K up to which the default needs no comparison with methods that trust the data more."""

FALLBACK_METHOD = "noniterative-tv"
"""Method for sensors that the default does not serve. It serves every sensor."""

SMOOTH_KERNEL_METHOD = "admm-tv"
"""Fallback for the bits of a sensor with a smooth kernel, because it models the kernel."""

OWN_NETWORK = "network"
"""Name of the method that runs a network from the caller."""

OPTION_DEFAULTS = {
    "uncertainty": "mle",
    "inverse": FALLBACK_METHOD,
    "weight": SMOOTH_KERNEL_METHOD,
    "norm": SMOOTH_KERNEL_METHOD,
    "tol": SMOOTH_KERNEL_METHOD,
    "max_iter": SMOOTH_KERNEL_METHOD,
}
"""Options that not all methods accept, each with the method that it selects.

If several are set, the first one in this order selects.
"""


def requested_method(method: str | None, options: Collection[str] = ()) -> str | None:
    """Return the requested method: the named one, or the one that an option selects.

    Parameters
    ----------
    method : str or None
        Name of a method.
    options : collection of str
        Names in :data:`OPTION_DEFAULTS` that the user set.

    Returns
    -------
    str or None
        A key of :data:`METHODS`, or None if neither a name nor an option is set.

    Raises
    ------
    ValueError
        For an unknown name, or an option that the method does not accept.

    Examples
    --------
    >>> requested_method(None, ["weight"])
    'admm-tv'
    >>> requested_method("mle", ["weight"])
    Traceback (most recent call last):
      ...
    ValueError: weight: is an option of admm-tv, not of mle
    """
    if method is None:
        method = next((name for key, name in OPTION_DEFAULTS.items() if key in options), None)
    if method is None:
        return None
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    for option in options:
        if option not in METHODS[method].options:
            owners = [name for name, other in METHODS.items() if option in other.options]
            raise ValueError(f"{option}: is an option of {', '.join(owners)}, not of {method}")
    return method


@dataclasses.dataclass(frozen=True)
class Choice:
    """The method for some data, and the range of its estimate."""

    method: str
    """Key of :data:`METHODS`, or :data:`OWN_NETWORK`."""
    quality: str | None
    """Size of the shipped network to load, or None for other methods."""
    max_intensity: float
    """Largest intensity S of the estimate."""
    has_fixed_range: bool
    """Whether the method is a network that was trained for one S."""
    saturation: float | None
    """Intensity at which the bits saturate, if a network's fixed S is below it; otherwise None."""
    reason: str
    """Why the method was chosen."""
    notes: tuple[str, ...]
    """Assumptions to report."""
    warnings: tuple[str, ...]
    """Reasons why the default method was not chosen."""

    @property
    def title(self) -> str:
        """Name of the method in tables and messages."""
        return "network, own" if self.method == OWN_NETWORK else METHODS[self.method].title


def choose_method(
    sensor: Sensor,
    *,
    requested: str | None = None,
    network: Network | None = None,
    is_bits: bool = True,
    is_range_known: bool = True,
    remedy: str | None = None,
) -> Choice:
    """Return the method for some data: the requested one, or the best one for the sensor.

    Parameters
    ----------
    sensor : Sensor
        Sensor of the data.
    requested : str, optional
        Key of :data:`METHODS`, as returned by :func:`requested_method`. Default: the network
        `DEFAULT_METHOD` where it serves the sensor, or `LARGE_METHOD` if K is above `LARGE_TRIALS`;
        else `SMOOTH_KERNEL_METHOD` for the bits of a smooth kernel, else `FALLBACK_METHOD`.
    network : Network, optional
        Network of the caller. It replaces the request.
    is_bits : bool
        Whether the data are bits. Counts do not show how a smooth kernel spread the light.
    is_range_known : bool
        Whether the data or the user state the largest intensity S. Otherwise, with a box kernel, S
        rises to the saturation of the bits, if the method allows it.
    remedy : str, optional
        Advice that follows the reason why no network serves the sensor. Default: the command that
        trains a network.

    Returns
    -------
    Choice

    Raises
    ------
    ValueError
        When the requested network does not serve the sensor.

    Examples
    --------
    >>> choose_method(Sensor(frames=16)).method
    'network-medium'
    >>> choose_method(Sensor(frames=10_000)).method
    'held-out'
    >>> choose_method(Sensor(frames=16, kernel="cubic"), is_bits=False).method
    'noniterative-tv'
    """
    warnings: list[str] = []
    reason = "requested"
    if network is not None:
        method, quality, has_fixed_range = OWN_NETWORK, None, network.trials_range is None
    else:
        method = requested or (LARGE_METHOD if sensor.trials > LARGE_TRIALS else DEFAULT_METHOD)
        if requested is None:
            reason = f"recommended for {sensor.trials:,} trials per pixel"
        quality = METHODS[method].quality
        needed = CONDITIONAL_SIZE if method == LARGE_METHOD else quality
        if needed is not None and (missing := unsupported_reason(sensor, needed)) is not None:
            message = f"{missing}; {remedy or 'train one: ' + training_command(sensor)}"
            if requested is not None:
                raise ValueError(message)
            warnings.append(message)
            is_smooth = is_bits and sensor.kernel != "box"
            method, quality = SMOOTH_KERNEL_METHOD if is_smooth else FALLBACK_METHOD, None
            reason = missing
        # The medium network serves any S. Every other size was trained for S = 1.
        has_fixed_range = quality is not None and quality != CONDITIONAL_SIZE
    max_intensity = sensor.max_intensity
    limit, notes = None, []
    saturation = saturation_intensity(sensor)
    if not is_range_known and sensor.kernel == "box" and saturation > max_intensity:
        if has_fixed_range:
            limit = saturation
        else:
            max_intensity = saturation
            notes.append(
                "the largest intensity is half a count from saturation, so that only saturated "
                "pixels are clipped; max_intensity=S (--max-intensity) sets another one"
            )
    return Choice(
        method,
        quality,
        max_intensity,
        has_fixed_range,
        limit,
        reason,
        tuple(notes),
        tuple(warnings),
    )
