"""Networks as text and as HTML."""

from jotlight.errors import counted
from jotlight.networks.figure import figure_of_layers
from jotlight.networks.inference.engine_backed import EngineBacked
from jotlight.notebook import card


def repr_of(network: EngineBacked) -> str:
    """Return the channels, the number of parameters, and the sensors of a network."""
    channels, parameters, purpose, *rotations = _facts(network).values()
    mean = f", mean of {rotations[0]} rotations" if rotations else ""
    kind = type(network).__name__
    return f"<{kind}: channels {channels}, {parameters} parameters, for {purpose}{mean}>"


def html_of(network: EngineBacked) -> str:
    """Return HTML that describes a network, for notebooks."""
    halo = {"halo": f"{network.halo} pixels"}
    drawing = figure_of_layers(network.layers).thumbnail()
    return card("Network", {**_facts(network), **halo}, drawing)


def _facts(network: EngineBacked) -> dict[str, object]:
    layers, trials_range = network.layers, network.trials_range
    served = trials_range and f"{counted(trials_range[0], 'trial')} per pixel or more"
    return {
        "channels": " -> ".join(str(layer.channels) for layer in layers),
        "parameters": sum(layer.parameter_count for layer in layers),
        "for": served or repr(network.sensor),
        **({"rotations": network.rotations} if network.rotations > 1 else {}),
    }
