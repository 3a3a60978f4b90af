"""The choice of a method for some data."""

import dataclasses

from jotlight.errors import counted, plural
from jotlight.evaluation.color.color_data import BY_COLOR_NETWORK, check_taken, takes_sensor
from jotlight.evaluation.held_out import smooth_kernel_reason
from jotlight.evaluation.many_trials import takes_blend, trials_of
from jotlight.evaluation.methods import (
    BLEND_METHOD,
    COLOR_NETWORK,
    DEFAULT_METHOD,
    METHODS,
    find_method,
)
from jotlight.networks.loading import AnyNetwork
from jotlight.networks.network import Network
from jotlight.networks.planes_network import ColorNetwork
from jotlight.networks.precision import DEEP, F32, check_precision
from jotlight.networks.pretrained import uses_conditional
from jotlight.sensing.likelihood.reference import saturation_intensity
from jotlight.sensing.sensor import Sensor

OWN_NETWORK = "network"
"""Name of the method that runs a network from the caller."""

FILM_NETWORK = "network-film"
"""Name of the method that runs the film network, for films along a motion alone."""

TITLES = {
    OWN_NETWORK: "network, own",
    COLOR_NETWORK: "network, color",
    FILM_NETWORK: "network, film",
}
"""Names of the methods that are not in :data:`METHODS`, in tables and messages."""


def title_of(method: str, sensor: Sensor | None = None) -> str:
    """Return the name of a method in tables and messages.

    With a sensor, the name states whether a pretrained network is the one for its K alone.

    Examples
    --------
    >>> title_of("mle"), title_of("network-color")
    ('maximum likelihood', 'network, color')
    >>> title_of("network-two-layer", jl.Sensor(frames=16))
    'network, two-layer, for K = 16'
    >>> title_of("network-two-layer", jl.Sensor(frames=17))
    'network, two-layer'
    """
    if method in TITLES:
        return TITLES[method]
    found = find_method(method)
    if sensor is None or found.quality is None or uses_conditional(sensor, found.quality):
        return found.title
    return f"{found.title}, for K = {sensor.trials}"


@dataclasses.dataclass(frozen=True)
class Choice:
    """The method for some data, and the range of its estimate."""

    method: str
    """Key of :data:`METHODS`, :data:`OWN_NETWORK`, :data:`COLOR_NETWORK`, or
    :data:`FILM_NETWORK`."""
    title: str
    """Name of the method in tables and messages."""
    quality: str | None
    """Size of the pretrained network to load, or None for other methods."""
    max_intensity: float
    """Largest intensity S of the estimate."""
    has_fixed_range: bool
    """Whether the method is a network that was trained for one S."""
    saturation: float | None
    """Intensity at which the bits saturate, if a network's fixed S is below it; otherwise None."""
    recommended_for: str | None
    """What the method was recommended for, or None if the caller requested it."""
    notes: tuple[str, ...]
    """Assumptions to report."""
    is_color: bool = False
    """Whether the colors of an image are estimated together, by the color network or a blend."""

    @property
    def is_network(self) -> bool:
        """Whether the method is a network alone."""
        return self.quality is not None or self.method in TITLES

    @property
    def is_requested(self) -> bool:
        """Whether the caller requested the method."""
        return self.recommended_for is None

    @property
    def reason(self) -> str:
        """Why the method was chosen, as a text."""
        return "requested" if self.is_requested else f"recommended for {self.recommended_for}"

    def check_precision(self, precision: str | None, *, fallback: bool = False) -> None:
        """Check a precision, as :func:`check_precision_of` does."""
        check_precision_of(precision, self.method, self.quality, fallback=fallback)


def choose_method(
    sensor: Sensor,
    *,
    requested: str | None = None,
    network: AnyNetwork | None = None,
    is_range_known: bool = True,
    is_color: bool = False,
    demosaicing: str | None = None,
    trials: float | None = None,
    is_conditional: bool = False,
) -> Choice:
    """Return the method for some data: the requested one, or the best one for the sensor.

    Parameters
    ----------
    sensor : Sensor
        Sensor of the data.
    requested : str, optional
        Name of a method, as returned by
        :func:`jotlight.evaluation.requested_method.requested_method`. Default: the network
        `DEFAULT_METHOD`, or `BLEND_METHOD` if :func:`takes_blend` is true, or else `COLOR_NETWORK`
        for colors.
    network : Network or ColorNetwork, optional
        Network of the caller. It replaces the request.
    is_range_known : bool
        Whether the data or the user state the largest intensity S. Otherwise, with a box kernel, S
        rises to the saturation of the bits, if the method allows it.
    is_color : bool
        Whether the data are colors that the caller can estimate together.
    demosaicing : str, optional
        How planes become colors, as of :func:`jotlight.reconstruct`. "network" is the color network
        alone, also above `MAX_NETWORK_TRIALS`. Others are for planes.
    trials : float, optional
        What :func:`trials_of` returns for the sensor of the data, if this one is that of
        equivalent counts. Default: the same for this sensor.
    is_conditional : bool
        Whether a pretrained network is a K-conditioned one, as it falls back to other methods.

    Returns
    -------
    Choice

    Raises
    ------
    ValueError
        When a color network is requested for data that it does not take.

    Examples
    --------
    >>> choose_method(jl.Sensor(frames=16)).method
    'network-medium'
    >>> choose_method(jl.Sensor(frames=10_000)).method
    'held-out'
    """
    recommended_for = None
    if requested == COLOR_NETWORK or isinstance(network, ColorNetwork):
        check_taken(sensor, has_form=is_color)
    is_color = is_color and takes_sensor(sensor)
    if network is not None:
        method, quality, has_fixed_range = OWN_NETWORK, None, network.trials_range is None
    else:
        trials = trials_of(sensor) if trials is None else trials
        default = DEFAULT_METHOD
        if takes_blend(sensor, trials) and demosaicing != BY_COLOR_NETWORK:
            default = BLEND_METHOD
        elif is_color and demosaicing in (None, BY_COLOR_NETWORK):
            default = COLOR_NETWORK
        method = requested or default
        if requested is None:
            colors = "colors" if sensor.mosaic is None else "mosaics"
            each = f"{trials:,.0f} {plural(round(trials), 'trial')} per pixel"
            recommended_for = colors if method == COLOR_NETWORK else each
        quality = None if method == COLOR_NETWORK else METHODS[method].quality
        # K-conditioned networks serve any S. Networks for one K were trained for S = 1.
        has_fixed_range = quality is not None and not uses_conditional(sensor, quality)
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
        title_of(method, None if is_conditional else sensor),
        quality,
        max_intensity,
        has_fixed_range,
        limit,
        recommended_for,
        tuple(notes),
        is_color and method in (COLOR_NETWORK, BLEND_METHOD),
    )


def check_fallback(
    sensor: Sensor, method: str, quality: str | None, network: Network | None
) -> None:
    """Raise ValueError if a method cannot be blended with others on held-out bits.

    Parameters
    ----------
    sensor : Sensor
        Sensor of the data.
    method : str
        Name of the method.
    quality : str, optional
        Size of the method's network, if it is a pretrained one.
    network : Network, optional
        Network of the caller.

    Examples
    --------
    >>> check_fallback(jl.Sensor(), "mle", None, None)
    Traceback (most recent call last):
      ...
    ValueError: fallback: is for networks, but the method is mle
    """
    if (reason := smooth_kernel_reason(sensor)) is not None:
        raise ValueError(f"sensor: {reason}")
    if network is None and quality is None and method != BLEND_METHOD:
        raise ValueError(f"fallback: is for networks, but the method is {method}")
    if network is not None and network.trials_range is None:
        raise ValueError(
            "fallback: expected a K-conditioned network, because it runs on a part of the bits; "
            f"got one for {counted(network.sensor.trials, 'trial')} alone; "
            'quality="medium" selects one'
        )


def check_precision_of(
    precision: str | None, method: str, quality: str | None = None, *, fallback: bool = False
) -> None:
    """Raise ValueError if "bf16" is requested of anything but a network alone.

    The network itself refuses "bf16" if it has no layers for it.

    Parameters
    ----------
    precision : str, optional
        The requested precision.
    method : str
        Name of the method, or what estimates the image.
    quality : str, optional
        Size of the method's network, if it is a pretrained one.
    fallback : bool
        Whether the network falls back to other methods.

    Examples
    --------
    >>> check_precision_of("bf16", "network-large", "large")
    >>> check_precision_of("bf16", "mle")
    Traceback (most recent call last):
      ...
    ValueError: precision: expected f32 for mle, got bf16; leave it out, or take a deep network, ...
    """
    if precision is None:
        return
    check_precision(precision)
    if precision != F32 and (fallback or not (quality or method in TITLES)):
        what, advice = method, DEEP
        if fallback:
            what, advice = "a network with fallback", "leave out one of the two"
        raise ValueError(f"precision: expected {F32} for {what}, got {precision}; {advice}")
