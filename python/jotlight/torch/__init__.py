"""The networks of jotlight, their parts, and the sensor, for PyTorch (extra `torch`)."""

from jotlight.torch.fine_tuning import fine_tune
from jotlight.torch.network import Network
from jotlight.torch.spline import Spline, spline

__all__ = ["Network", "Spline", "fine_tune", "spline"]
