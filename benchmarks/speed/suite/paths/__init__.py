"""The hot paths by name; each gives its cases, smaller ones where `quick` is true."""

from functools import partial

from jotlight.networks.architectures import ARCHITECTURES
from suite.paths import (
    counting,
    deep,
    filtering,
    first_layer,
    reconstruction,
    sampling,
    splines,
    training,
)

PATHS = {
    "counting": counting.cases,
    "first-layer": first_layer.cases,
    "filter": filtering.cases,
    "splines": splines.cases,
    "network": reconstruction.cases,
    **{f"deep-{member}": partial(deep.cases, member) for member in ARCHITECTURES},
    "training": training.cases,
    "sampling": sampling.cases,
}
