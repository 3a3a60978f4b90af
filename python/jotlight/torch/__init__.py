"""The networks of jotlight, their parts, and the sensor, for PyTorch (extra `torch`).

What deepinv needs of them is in :mod:`jotlight.torch.deepinv` (extra `deepinv`).

Examples
--------
>>> import jotlight, torch
>>> sensor = jotlight.Sensor(oversampling=4)
>>> network = Network(jotlight.Network.residual(sensor, "small", rng=0))
>>> image = torch.full((1, 1, 24, 32), 0.5)
>>> network(Sensing(sensor)(image)).shape
torch.Size([1, 1, 24, 32])
"""

try:
    import torch  # noqa: F401
except ImportError as error:
    from jotlight.errors import MissingExtraError

    raise MissingExtraError(
        "deep networks are learned with PyTorch: pip install 'jotlight[torch]'"
    ) from error

from jotlight.torch.fine_tuning import fine_tune
from jotlight.torch.network import Network
from jotlight.torch.sensing import Sensing
from jotlight.torch.spline import Spline, spline
from jotlight.torch.training import train

__all__ = ["Network", "Sensing", "Spline", "fine_tune", "spline", "train"]
