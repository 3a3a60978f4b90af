"""Networks for planes as PyTorch modules, for their training."""

from typing import cast

from torch import Tensor

from jotlight.networks.layer import Layer
from jotlight.networks.loading import load_network
from jotlight.networks.planes_network import PlanesNetwork as EnginePlanesNetwork
from jotlight.torch.network import Network


class PlanesNetwork(Network):
    """A network for planes, such as a color network, whose parameters PyTorch can train.

    Its data are the planes, (N, P, H, W), and it returns P(b = 1) of each output, (N, C, H, W).

    Parameters
    ----------
    source : jotlight.networks.planes_network.PlanesNetwork or path
        The network to start from, or its file.
    device : torch.device, str, or int, optional
        Device of the parameters. Default: the CPU.

    Examples
    --------
    >>> import torch
    >>> network = PlanesNetwork(jl.ColorNetwork.initial("small", rng=0))
    >>> network(torch.zeros(1, 11, 8, 8), trials=16).shape
    torch.Size([1, 3, 8, 8])
    """

    load_network = staticmethod(load_network)  # type: ignore[assignment]

    def forward(self, data: Tensor, trials: int) -> Tensor:  # type: ignore[override]
        """Return P(b = 1) of each output, (N, C, H, W), for planes and K = `trials`."""
        return self.run_layers(data, trials)

    def first_sums(self, data: Tensor, filters: Tensor) -> Tensor:
        """Return the planes, which the network reads as they are."""
        return data

    def rebuild(self, layers: list[Layer]) -> EnginePlanesNetwork:  # type: ignore[override]
        """Return a network of the engine with other layers."""
        origin = cast(EnginePlanesNetwork, self.origin)
        return type(origin)(layers, origin.history, trials_range=origin.trials_range)
