"""A correction network as a PyTorch module, for its training."""

from typing import cast

from torch import Tensor

from jotlight.networks.correction_network import CorrectionNetwork as EngineCorrectionNetwork
from jotlight.networks.layer import Layer
from jotlight.torch.network import Network


class CorrectionNetwork(Network):
    """A correction network whose parameters PyTorch can train.

    Its data are the planes of a color network or a film network, (N, P, H, W), and it returns
    P(b = 1) of each output channel, (N, C, H, W).

    Parameters
    ----------
    source : jotlight.networks.correction_network.CorrectionNetwork
        The network to start from.
    device : torch.device, str, or int, optional
        Device of the parameters. Default: the CPU.

    Examples
    --------
    >>> import torch
    >>> from jotlight import ColorNetwork
    >>> network = CorrectionNetwork(ColorNetwork.initial("small", rng=0))
    >>> network(torch.zeros(1, 11, 8, 8), trials=16).shape
    torch.Size([1, 3, 8, 8])
    """

    def forward(self, data: Tensor, trials: int) -> Tensor:  # type: ignore[override]
        """Return P(b = 1) of each output channel, (N, C, H, W), for planes and K = `trials`."""
        return self.run_layers(data, trials)

    def first_sums(self, data: Tensor, filters: Tensor) -> Tensor:
        """Return the planes, which the network reads as they are."""
        return data

    def rebuild(self, layers: list[Layer]) -> EngineCorrectionNetwork:  # type: ignore[override]
        """Return a network of the same kind for the engine, with other layers."""
        origin = cast(EngineCorrectionNetwork, self.origin)
        return type(origin)(layers, origin.history, trials_range=origin.trials_range)
