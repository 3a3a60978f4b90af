"""Frames of a film, by their numbers."""

import dataclasses

from jotlight.formats.capture import CountStack
from jotlight.sensing.bits.bits import Bits


@dataclasses.dataclass(frozen=True)
class FilmFrames:
    """The frames of a film that are known: some in succession.

    Examples
    --------
    >>> known = FilmFrames(jl.Bits.from_array([[[0]], [[1]], [[1]]]), first=10)
    >>> known.numbers, known.part(range(11, 13)).shape
    (range(10, 13), (2, 1, 1))
    """

    data: Bits | CountStack
    first: int
    """The number of the first frame."""

    @property
    def numbers(self) -> range:
        """The numbers of the frames."""
        return range(self.first, self.first + len(self.data))

    def part(self, numbers: range) -> Bits | CountStack:
        """Return the frames with some numbers."""
        return self.data[numbers.start - self.first : numbers.stop - self.first]
