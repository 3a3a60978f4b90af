"""Where data are from: what a file was taken for, and what was assumed."""

import dataclasses
from typing import Any, Self

_MOST_NOTES = 64
_LONGEST = 1000


@dataclasses.dataclass(frozen=True)
class Source:
    """Where bits are from.

    Parameters
    ----------
    format : str
        The format's name, as ``jotlight.open(..., format=)`` takes it.
    name : str
        The name of the file or folder.
    notes : tuple of str
        What was assumed or done when reading, in words.

    Examples
    --------
    >>> Source("npy", "cube.npy", ("most significant bit first",)).with_note("frames 0:16 of 64")
    Source(format='npy', name='cube.npy', notes=('most significant bit first', 'frames 0:16 of 64'))
    """

    format: str
    name: str
    notes: tuple[str, ...] = ()

    def with_note(self, *notes: str) -> Self:
        """The same with more notes."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))

    def to_json(self) -> dict[str, Any]:
        """An object that JSON can hold."""
        return {"format": self.format, "name": self.name, "notes": list(self.notes)}

    @classmethod
    def from_json(cls, value: Any) -> Self:
        """Undo :meth:`to_json`.

        Raises
        ------
        ValueError
            When it is no such object.
        """
        if not isinstance(value, dict) or value.keys() != {"format", "name", "notes"}:
            raise ValueError("source: expected an object with format, name and notes")
        texts = [value["format"], value["name"]]
        texts += value["notes"] if isinstance(value["notes"], list) else [None]
        if len(texts) > _MOST_NOTES or not all(
            isinstance(text, str) and len(text) <= _LONGEST for text in texts
        ):
            raise ValueError("source: expected short texts, and a list of them for notes")
        return cls(texts[0], texts[1], tuple(texts[2:]))
