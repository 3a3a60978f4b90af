"""Errors for attributes of NumPy arrays that bits and readings do not have."""

from typing import Any, NoReturn

import numpy as np

_HINTS = {
    "bits": {
        "sum": "bits.counts(1) is the sum of the frames, computed without unpacking them",
        "mean": "bits.counts(1) / len(bits) is the mean of the frames, computed without unpacking "
        "them",
        "dtype": "np.asarray(bits).dtype is that of an array of them, and bits.to_dask() is a lazy "
        "array of the packed bits for dask",
    },
    "readings": {
        "counts": "readings.sum() is the sum of the frames",
        "mean": "readings.sum() / len(readings) is the mean of the frames",
    },
}
"""What to write instead, for each class and attribute."""


class ArrayHints:
    """A class whose missing attributes raise errors that say what to write instead.

    Examples
    --------
    >>> class Bits(ArrayHints): ...
    >>> Bits().sum()
    Traceback (most recent call last):
      ...
    AttributeError: 'Bits' object has no attribute 'sum'; bits.counts(1) is the sum of ...
    """

    def __getattr__(self, name: str) -> NoReturn:
        own = type(self).__name__.lower()
        hint = _HINTS.get(own, {}).get(name)
        if name == "save":
            hint = f"jotlight.save({own}, path) writes them"
        elif name in ("numpy", "to_numpy"):
            hint = f"np.asarray({own}) is an array of them"
        elif hint is None and not name.startswith("_") and hasattr(np.ndarray, name):
            hint = f"np.asarray({own}).{name} is that of an array of them"
        text = f"{type(self).__name__!r} object has no attribute {name!r}"
        details: dict[str, Any] = {"name": name, "obj": self}
        raise AttributeError(f"{text}; {hint}" if hint else text, **details)
