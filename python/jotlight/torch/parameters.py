"""The parameters of a network in PyTorch, from its layers and back."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from jotlight.networks.layer import Layer


def layer_parameters(layers: Sequence[Layer]) -> tuple[nn.ParameterList, nn.ParameterDict]:
    """Return copies of the filters of all layers, and of the coefficients by the layer's number.

    Those that training must not change need no gradients.

    Examples
    --------
    >>> filters, coefficients = layer_parameters(jl.Network.initial(jl.Sensor()).layers)
    >>> len(filters), list(coefficients)
    (2, ['0', '1'])
    """
    filters = nn.ParameterList(
        _parameter(layer.filters, layer.trainable != "nothing") for layer in layers
    )
    coefficients = nn.ParameterDict(
        {
            str(index): _parameter(layer.coefficients, layer.trainable == "all")
            for index, layer in enumerate(layers)
            if layer.coefficients is not None
        }
    )
    return filters, coefficients


def with_parameters(
    layers: Sequence[Layer], filters: nn.ParameterList, coefficients: nn.ParameterDict
) -> list[Layer]:
    """Return layers with copies of the parameters that :func:`layer_parameters` returned.

    Examples
    --------
    >>> layers = jl.Network.initial(jl.Sensor()).layers
    >>> again = with_parameters(layers, *layer_parameters(layers))
    >>> bool((again[0].filters == layers[0].filters).all())
    True
    """
    return [
        dataclasses.replace(
            layer,
            filters=_array(filters[index]),
            coefficients=None if layer.coefficients is None else _array(coefficients[str(index)]),
        )
        for index, layer in enumerate(layers)
    ]


def _parameter(array: npt.NDArray[np.float32], is_trainable: bool) -> nn.Parameter:
    return nn.Parameter(torch.from_numpy(array.copy()), requires_grad=is_trainable)


def _array(parameter: Tensor) -> npt.NDArray[np.float32]:
    # A copy, so that further training does not change the network.
    return np.array(parameter.detach().cpu().numpy(), np.float32)
