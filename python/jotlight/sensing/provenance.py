"""Where data are from: what a file was taken for, what was assumed, and what it was made of."""

import dataclasses
from collections.abc import Iterator
from typing import Any, Self

_MOST_NOTES = 64
_LONGEST = 1000
_MOST_STEPS = 16
"""Conversions that are remembered, the last ones."""
_TURNS = [[quarters, mirrored] for quarters in range(4) for mirrored in (False, True)]


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
    turned : (int, bool), optional
        Quarter turns anticlockwise since the file was read first, 0 to 3, and whether left and
        right were exchanged after that. None where it is not known.
    origin : Source, optional
        What the file was converted from, where it tells.

    Examples
    --------
    >>> raw = Source("swissspad2", "a.bin", ("the least significant bit first",))
    >>> source = Source("npy", "a.npy").converted_from(raw).with_note("frames 0:16 of 64")
    >>> print(source)
    a.npy (npy; frames 0:16 of 64)
    >>> print(*source.describe(), sep="\n")
    npy: frames 0:16 of 64
    npy: converted from a.bin
    swissspad2: the least significant bit first
    """

    format: str
    name: str
    notes: tuple[str, ...] = ()
    turned: tuple[int, bool] | None = (0, False)
    origin: "Source | None" = None

    def __str__(self) -> str:
        return f"{self.name} ({'; '.join((self.format, *self.notes))})"

    def with_note(self, *notes: str) -> Self:
        """The same with more notes."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))

    def turned_by(self, quarters: int, flip: str | None) -> Self:
        """The same, turned anticlockwise and then mirrored once more.

        Examples
        --------
        >>> Source("npy", "cube.npy").turned_by(1, "vertical").turned_by(3, None).turned
        (0, True)
        """
        if self.turned is None:
            return self
        before, mirrored = self.turned
        # Top and bottom exchanged is left and right exchanged after half a turn, and a turn that
        # comes after a mirror is the opposite turn before it.
        after = quarters + 2 * (flip == "vertical")
        now = (before - after if mirrored else before + after) % 4
        return dataclasses.replace(self, turned=(now, mirrored ^ (flip is not None)))

    def converted_from(self, origin: "Source | None") -> Self:
        """The same with what the file was converted from, which may have been turned."""
        if origin is None:
            return self
        return dataclasses.replace(self, origin=origin, turned=origin.turned)

    def how_turned(self) -> str:
        """How, in words."""
        if self.turned is None:
            return "turned in a way that is not known"
        quarters, mirrored = self.turned
        words = [f"rotated by {90 * quarters} degrees"] if quarters else []
        words += ["mirrored left to right"] if mirrored else []
        return " and ".join(words) or "not turned"

    def describe(self) -> list[str]:
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
        told: dict[str, Any] = {"format": self.format, "name": self.name, "notes": list(self.notes)}
        if self.turned is not None:
            told["turned"] = list(self.turned)
        if self.origin is not None:
            told["origin"] = self.origin.to_json()
        return told

    @classmethod
    def from_json(cls, value: Any, steps: int = _MOST_STEPS) -> Self:
        """Undo :meth:`to_json`; of what is before so many `steps` nothing is kept.

        Raises
        ------
        ValueError
            When it is no such object.
        """
        optional = {"turned", "origin"}
        if not isinstance(value, dict) or value.keys() - optional != {"format", "name", "notes"}:
            raise ValueError(
                "source: expected an object with format, name, notes, turned and origin"
            )
        turned = value.get("turned")
        if turned is not None and turned not in _TURNS:
            raise ValueError(f"source: expected quarter turns and whether mirrored, got {turned!r}")
        texts = [value["format"], value["name"]]
        texts += value["notes"] if isinstance(value["notes"], list) else [None]
        if len(texts) > _MOST_NOTES or not all(
            isinstance(text, str) and len(text) <= _LONGEST for text in texts
        ):
            raise ValueError("source: expected short texts, and a list of them for notes")
        known = None if turned is None else (int(turned[0]), bool(turned[1]))
        traced = "origin" in value and steps > 1
        origin = cls.from_json(value["origin"], steps - 1) if traced else None
        return cls(texts[0], texts[1], tuple(texts[2:]), known, origin)
