"""A color network as a PyTorch module, for its training."""

from torch import Tensor

from jotlight.networks.color_network import ColorNetwork as EngineColorNetwork
from jotlight.networks.layer import Layer
from jotlight.torch.network import Network


class ColorNetwork(Network):
    """A color network whose parameters PyTorch can train.

    Its data are the planes of :mod:`jotlight.networks.color_planes`, (N, 11, H, W), and it returns
    P(b = 1) of red, green, and blue, (N, 3, H, W).

    Parameters
    ----------
    source : jotlight.networks.color_network.ColorNetwork or path
        The network to start from, or its file.
    device : torch.device, str, or int, optional
        Device of the parameters. Default: the CPU.

    Examples
    --------
    >>> import torch
    >>> network = ColorNetwork(EngineColorNetwork.initial("small", rng=0))
    >>> network(torch.zeros(1, 11, 8, 8), trials=16).shape
    torch.Size([1, 3, 8, 8])
    """

    load_network = staticmethod(EngineColorNetwork.load)  # type: ignore[assignment]

    def forward(self, data: Tensor, trials: int) -> Tensor:  # type: ignore[override]
        """Return P(b = 1) of red, green, and blue, (N, 3, H, W), for planes and K = `trials`."""
        return self.run_layers(data, trials)

    def first_sums(self, data: Tensor, filters: Tensor) -> Tensor:
        """Return the planes, which the network reads as they are."""
        return data

    def rebuild(self, layers: list[Layer]) -> EngineColorNetwork:  # type: ignore[override]
        """Return a color network of the engine with other layers."""
        origin = self.origin
        assert origin.trials_range is not None, "color networks are K-conditioned"
        return EngineColorNetwork(layers, origin.history, trials_range=origin.trials_range)
