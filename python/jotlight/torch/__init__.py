"""The networks of jotlight, their parts, and the sensor, for PyTorch (extra `torch`)."""

try:
    import torch  # noqa: F401
except ImportError as error:
    from jotlight.errors import MissingExtraError

    raise MissingExtraError(
        "deep networks are learned with PyTorch: pip install 'jotlight[torch]'"
    ) from error

from jotlight.torch.fine_tuning import fine_tune
from jotlight.torch.network import Network
from jotlight.torch.spline import Spline, spline
from jotlight.torch.training import train

__all__ = ["Network", "Spline", "fine_tune", "spline", "train"]
