"""Networks as text and as HTML."""

from collections.abc import Sequence

from jotlight.networks.figure import figure_of_layers
from jotlight.networks.graph import halo_radius
from jotlight.networks.layer import Layer
from jotlight.notebook import card
from jotlight.sensing.sensor import Sensor


def repr_of(layers: Sequence[Layer], sensor: Sensor, trials_range: tuple[int, int] | None) -> str:
    """Return the channels, the number of parameters, and the sensors of a network."""
    channels, parameters, purpose = _facts(layers, sensor, trials_range).values()
    return f"<Network: channels {channels}, {parameters} parameters, for {purpose}>"


def html_of(layers: Sequence[Layer], sensor: Sensor, trials_range: tuple[int, int] | None) -> str:
    """Return HTML that describes a network, for notebooks."""
    halo = {"halo": f"{halo_radius(layers)} pixels"}
    drawing = figure_of_layers(layers).thumbnail()
    return card("Network", {**_facts(layers, sensor, trials_range), **halo}, drawing)


def _facts(
    layers: Sequence[Layer], sensor: Sensor, trials_range: tuple[int, int] | None
) -> dict[str, object]:
    served = trials_range and f"{trials_range[0]} trials per pixel or more"
    return {
        "channels": " -> ".join(str(layer.channels) for layer in layers),
        "parameters": sum(layer.parameter_count for layer in layers),
        "for": served or repr(sensor),
    }
