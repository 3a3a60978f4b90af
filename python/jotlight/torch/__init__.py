"""The networks of jotlight, their parts, and the sensor, for PyTorch (extra `torch`)."""

from jotlight.torch.network import Network
from jotlight.torch.spline import Spline, spline
from jotlight.torch.training import train

__all__ = ["Network", "Spline", "spline", "train"]
