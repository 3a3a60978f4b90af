"""Where data are from: what a file was taken for, and what was assumed."""

import dataclasses
from typing import Any, Self

_MOST_NOTES = 64
_LONGEST = 1000
_TURNS = [[quarters, mirrored] for quarters in range(4) for mirrored in (False, True)]


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
    turned : (int, bool), optional
        Quarter turns anticlockwise since the file was read first, 0 to 3, and whether left and
        right were exchanged after that. None where it is not known.

    Examples
    --------
    >>> print(Source("npz", "cubes.npz", ("the array dark",)).with_note("frames 0:16 of 64"))
    cubes.npz (npz; the array dark; frames 0:16 of 64)
    """

    format: str
    name: str
    notes: tuple[str, ...] = ()
    turned: tuple[int, bool] | None = (0, False)

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

    def how_turned(self) -> str:
        """How, in words."""
        if self.turned is None:
            return "turned in a way that is not known"
        quarters, mirrored = self.turned
        words = [f"rotated by {90 * quarters} degrees"] if quarters else []
        words += ["mirrored left to right"] if mirrored else []
        return " and ".join(words) or "not turned"

    def to_json(self) -> dict[str, Any]:
        """An object that JSON can hold."""
        told = {"format": self.format, "name": self.name, "notes": list(self.notes)}
        return told if self.turned is None else {**told, "turned": list(self.turned)}

    @classmethod
    def from_json(cls, value: Any) -> Self:
        """Undo :meth:`to_json`.

        Raises
        ------
        ValueError
            When it is no such object.
        """
        if not isinstance(value, dict) or value.keys() - {"turned"} != {"format", "name", "notes"}:
            raise ValueError("source: expected an object with format, name, notes and turned")
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
        return cls(texts[0], texts[1], tuple(texts[2:]), known)
