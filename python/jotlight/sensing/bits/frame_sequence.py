"""What bits and readings have in common as sequences of frames."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NoReturn, Self

import numpy as np
import numpy.typing as npt

from jotlight.chunks import windows

_MAX_VALUES = 1 << 25
"""Maximum number of values that are compared at once."""

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
"""What to write instead of attributes of NumPy arrays, for each class and attribute."""


class FrameSequence:
    """Frames and their sensor, compared by their values, which may lie in files.

    Two are equal if all of their values are, and their sensors, wherever they come from. The
    comparison stops at the first frames that differ. Errors for attributes of NumPy arrays that
    they do not have say what to write instead.
    """

    if TYPE_CHECKING:

        @property
        def shape(self) -> tuple[int, ...]: ...  # noqa: D102

    def __len__(self) -> int:
        """Return the number of frames."""
        return int(self.shape[0])

    def windows(self, window: int, step: int | None = None) -> Iterator[Self]:
        """Return an iterator over windows of frames, which begin every `step` frames.

        Parameters
        ----------
        window : int
            Number of frames of a window, from 1 to T.
        step : int, optional
            Frames from one window to the next. Default: the size of a window.

        Raises
        ------
        TypeError, ValueError
            When a number is not whole, or out of range.

        Examples
        --------
        >>> bits = jl.Bits.from_array(np.zeros((10, 4, 4), bool))
        >>> [len(part) for part in bits.windows(4, 3)]
        [4, 4, 4]
        """
        own: Any = self
        return (own[frames] for frames in windows(len(self), window, step))

    def __contains__(self, frame: object) -> bool:
        """Return whether one of the frames equals an array (H, W) or (H, W, C)."""
        name, array = type(self).__name__.lower(), np.asarray(frame)
        if array.shape != self.shape[1:]:
            raise ValueError(
                f"{name}: expected a frame of shape {self.shape[1:]}, got {array.shape}"
            )
        axes = tuple(range(1, len(self.shape)))
        return any((part == array).all(axis=axes).any() for part in self._parts())

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return NotImplemented
        if self is other:
            return True
        mine, theirs = vars(self)["sensor"], vars(other)["sensor"]
        if self.shape != other.shape or mine != theirs:
            return False
        pairs = zip(self._parts(), other._parts(), strict=True)
        return all(np.array_equal(*pair) for pair in pairs)

    def __hash__(self) -> int:
        return hash(self.shape)  # a subclass may equal its base class

    def _parts(self) -> Iterator[npt.NDArray[Any]]:
        """Yield the values in parts of some frames."""
        own: Any = self
        length = max(1, _MAX_VALUES // int(np.prod(self.shape[1:])))
        for start in range(0, self.shape[0], length):
            yield own[start : start + length].to_array()

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
