"""What bits and readings have in common as sequences of frames."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from jotlight.sensing.bits.array_hints import ArrayHints

_MAX_VALUES = 1 << 25
"""Maximum number of values that are compared at once."""


class FrameSequence(ArrayHints):
    """Frames and their sensor, compared by their values, which may lie in files.

    Two are equal if all of their values are, and their sensors, wherever they come from. The
    comparison stops at the first frames that differ.
    """

    if TYPE_CHECKING:

        @property
        def shape(self) -> tuple[int, ...]: ...  # noqa: D102

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
