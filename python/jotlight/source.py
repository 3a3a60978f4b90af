"""Where data are from: what a file was taken for, what was assumed, and what it was made of."""

import dataclasses
from collections.abc import Iterator
from typing import Any, Self

_MOST_NOTES = 64
_LONGEST = 1000
_MOST_STEPS = 16
"""Conversions that are remembered, the last ones."""


@dataclasses.dataclass(frozen=True)
class Source:
    r"""Where bits are from.

    Parameters
    ----------
    format : str
        The format's name, as ``jotlight.open(..., format=)`` takes it.
    name : str
        The name of the file or folder.
    notes : tuple of str
        What was assumed or done when reading, in words.
    origin : Source, optional
        What the file was converted from, where it tells.

    Examples
    --------
    >>> raw = Source("swissspad2", "a.bin", ("the least significant bit first",))
    >>> print(*Source("npy", "a.npy", origin=raw).with_note("frames 0 to 16").told(), sep="\n")
    npy: frames 0 to 16
    npy: converted from a.bin
    swissspad2: the least significant bit first
    """

    format: str
    name: str
    notes: tuple[str, ...] = ()
    origin: "Source | None" = None

    def with_note(self, *notes: str) -> Self:
        """The same with more notes."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))

    def told(self) -> list[str]:
        """All of it in words, one line each, from this file back to the first."""
        lines = []
        for step in self.steps():
            lines += [f"{step.format}: {note}" for note in step.notes]
            if step.origin is not None:
                lines.append(f"{step.format}: converted from {step.origin.name}")
        return lines

    def steps(self) -> Iterator["Source"]:
        """The file itself, what it was converted from, and so on."""
        step: Source | None = self
        while step is not None:
            yield step
            step = step.origin

    def to_json(self) -> dict[str, Any]:
        """An object that JSON can hold."""
        own = {"format": self.format, "name": self.name, "notes": list(self.notes)}
        return own if self.origin is None else {**own, "origin": self.origin.to_json()}

    @classmethod
    def from_json(cls, value: Any, steps: int = _MOST_STEPS) -> Self:
        """Undo :meth:`to_json`; of what is before so many `steps` nothing is kept.

        Raises
        ------
        ValueError
            When it is no such object.
        """
        keys = {"format", "name", "notes"}
        if not isinstance(value, dict) or value.keys() - {"origin"} != keys:
            raise ValueError("source: expected an object with format, name and notes")
        texts = [value["format"], value["name"]]
        texts += value["notes"] if isinstance(value["notes"], list) else [None]
        if len(texts) > _MOST_NOTES or not all(
            isinstance(text, str) and len(text) <= _LONGEST for text in texts
        ):
            raise ValueError("source: expected short texts, and a list of them for notes")
        known = "origin" in value and steps > 1
        origin = cls.from_json(value["origin"], steps - 1) if known else None
        return cls(texts[0], texts[1], tuple(texts[2:]), origin)
