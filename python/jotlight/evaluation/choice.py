"""The choice of a method for some data."""

import dataclasses
from collections.abc import Collection

from jotlight.evaluation.methods import (
    DEFAULT_METHOD,
    FALLBACK_METHOD,
    LARGE_METHOD,
    LARGE_TRIALS,
    METHODS,
    OPTION_DEFAULTS,
    SMOOTH_KERNEL_METHOD,
    find_method,
)
from jotlight.networks.network import Network
from jotlight.networks.pretrained import (
    CONDITIONAL_SIZE,
    CONDITIONAL_SIZES,
    remedy,
    unsupported_reason,
)
from jotlight.sensing.reference import saturation_intensity
from jotlight.sensing.sensor import Sensor

OWN_NETWORK = "network"
"""Name of the method that runs a network from the caller."""


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
    accepted = find_method(method).options
    for option in options:
        if option not in accepted:
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
    training: str | None = None,
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
    training : str, optional
        Advice to train a network, for a sensor that no trained network serves. Default: the command
        that trains one.

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
            message = f"{missing}; {remedy(sensor, training)}"
            if requested is not None:
                raise ValueError(message)
            warnings.append(message)
            is_smooth = is_bits and sensor.kernel != "box"
            method, quality = SMOOTH_KERNEL_METHOD if is_smooth else FALLBACK_METHOD, None
            reason = missing
        # K-conditioned networks serve any S. Every other size was trained for S = 1.
        has_fixed_range = quality is not None and quality not in CONDITIONAL_SIZES
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
