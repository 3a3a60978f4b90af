"""The tasks by name. Each function yields cases, and smaller ones if `quick` is true."""

from functools import partial

from jotlight.networks.architectures import ARCHITECTURES
from suite.tasks import (
    counting,
    deep_networks,
    exposure,
    filtering,
    first_layer,
    splines,
    training,
    two_layer_network,
)

TASKS = {
    "counting": counting.cases,
    "first-layer": first_layer.cases,
    "filter": filtering.cases,
    "splines": splines.cases,
    "network-two-layer": two_layer_network.cases,
    **{f"network-{size}": partial(deep_networks.cases, size) for size in ARCHITECTURES},
    "training": training.cases,
    "exposure": exposure.cases,
}
