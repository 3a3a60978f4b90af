"""Errors for attributes of PyTorch modules that networks do not have."""

from typing import Any

_CALL = "network(counts) returns the estimate"
_MODULE = "jotlight.torch.Network(network) is a torch.nn.Module"

_HINTS = dict.fromkeys(("forward", "predict"), _CALL) | dict.fromkeys(
    ("eval", "train", "to", "cpu", "cuda", "half", "parameters", "state_dict"), _MODULE
)


class TorchHints:
    """A class whose missing attributes raise errors that say what to write instead.

    Examples
    --------
    >>> TorchHints().eval()
    Traceback (most recent call last):
      ...
    AttributeError: 'TorchHints' object has no attribute 'eval'; jotlight.torch.Network(network) ...
    """

    def __getattr__(self, name: str) -> Any:
        if name in _HINTS:
            text = f"{type(self).__name__!r} object has no attribute {name!r}; {_HINTS[name]}"
            raise AttributeError(text, name=name, obj=self)
        # Python also comes here after an AttributeError inside of a property. This raises it again.
        return object.__getattribute__(self, name)
