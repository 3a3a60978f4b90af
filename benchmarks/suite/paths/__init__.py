"""The hot paths by name; each gives its cases, smaller ones where `quick` is true."""

from suite.paths import (
    counting,
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
    "training": training.cases,
    "sampling": sampling.cases,
}
