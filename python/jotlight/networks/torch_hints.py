"""Errors for attributes of PyTorch modules that networks do not have."""

from typing import NoReturn

_CALLS = "forward", "predict"
_MODULE = "eval", "train", "to", "cpu", "cuda", "half", "parameters", "state_dict"


class TorchHints:
    """A class whose missing attributes raise errors that say what to write instead.

    Examples
    --------
    >>> TorchHints().eval()
    Traceback (most recent call last):
      ...
    AttributeError: 'TorchHints' object has no attribute 'eval'; jotlight.torch.Network(network) ...
    """

    def __getattr__(self, name: str) -> NoReturn:
        text = f"{type(self).__name__!r} object has no attribute {name!r}"
        if name in _CALLS:
            text += "; network(counts) returns the estimate"
        elif name in _MODULE:
            text += "; jotlight.torch.Network(network) is a torch.nn.Module"
        raise AttributeError(text, name=name, obj=self)
