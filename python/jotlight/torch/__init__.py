"""PyTorch versions of the networks and of the sensor, and their training (extra `torch`).

In reading order: `network` (a network as a module), `splines`, `filter_bank`, `padding`, and
`parameters` (its parts), `estimates` (from its outputs to intensities), `data_checks` (of its
input), `sensing` and `response` (the sensor as a differentiable layer), `training`,
`image_trainer`, `patches`, `precision`, `optimizers`, and `muon` (training on images),
`planes_network`, `color_patches`, and `film_patches` (networks of colors and of films),
`fine_tuning`, `bit_splitting`, and `blind_spots` (training on a capture), `trainer`, `ahead`, and
`distributed` (the loop of all), and `deepinv` (adapters for that library, extra `deepinv`).

Examples
--------
>>> import torch
>>> import jotlight as jl
>>> sensor = jl.Sensor(oversampling=4)
>>> network = Network(jl.Network.residual(sensor, "small", rng=0))
>>> image = torch.full((1, 1, 24, 32), 0.5)
>>> network(Sensing(sensor)(image)).shape
torch.Size([1, 1, 24, 32])
"""

from jotlight.errors import needs_module

with needs_module(
    "torch", "training of deep networks needs PyTorch: pip install 'jotlight[torch]'"
):
    import torch  # noqa: F401

from jotlight.torch.fine_tuning import fine_tune
from jotlight.torch.muon import Muon
from jotlight.torch.network import Network
from jotlight.torch.precision import fastest_precision
from jotlight.torch.sensing import Sensing
from jotlight.torch.splines import Spline, spline
from jotlight.torch.training import train

__all__ = [
    "Muon",
    "Network",
    "Sensing",
    "Spline",
    "fastest_precision",
    "fine_tune",
    "spline",
    "train",
]


def __dir__() -> list[str]:
    return __all__
