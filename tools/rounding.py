"""Parameters of float16, which halve the files of networks."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from jotlight.networks.layer import Layer


def round_layers(layers: Sequence[Layer]) -> list[Layer]:
    """Return layers whose trained parameters are numbers of float16."""
    rounded = []
    for layer in layers:
        if layer.trainable != "nothing":
            layer = dataclasses.replace(layer, filters=_rounded(layer.filters))
        if layer.trainable == "all" and layer.coefficients is not None:
            layer = dataclasses.replace(layer, coefficients=_rounded(layer.coefficients))
        rounded.append(layer)
    return rounded


def _rounded(array: np.ndarray) -> np.ndarray:
    return array.astype(np.float16).astype(np.float32)
