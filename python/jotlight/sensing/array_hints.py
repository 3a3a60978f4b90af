"""Errors for attributes of NumPy arrays that packed bits do not have."""

from typing import Any, NoReturn

import numpy as np

_HINTS = {
    "sum": "bits.counts(1) is the sum of the frames, computed without unpacking them",
    "mean": "bits.counts(1) / len(bits) is the mean of the frames, computed without unpacking them",
    "save": "jotlight.save(bits, path) writes them",
    "numpy": "np.asarray(bits) unpacks them",
    "to_numpy": "np.asarray(bits) unpacks them",
}


class ArrayHints:
    """A class whose missing attributes raise errors that say what to write instead.

    Examples
    --------
    >>> ArrayHints().sum()
    Traceback (most recent call last):
      ...
    AttributeError: 'ArrayHints' object has no attribute 'sum'; bits.counts(1) is the sum of ...
    """

    def __getattr__(self, name: str) -> NoReturn:
        hint = _HINTS.get(name)
        if hint is None and not name.startswith("_") and hasattr(np.ndarray, name):
            hint = f"np.asarray(bits).{name} is that of the unpacked bits"
        text = f"{type(self).__name__!r} object has no attribute {name!r}"
        details: dict[str, Any] = {"name": name, "obj": self}
        raise AttributeError(f"{text}; {hint}" if hint else text, **details)
