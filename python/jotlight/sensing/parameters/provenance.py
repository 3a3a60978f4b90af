"""Provenance of data: their file, the assumptions of its reader, and earlier conversions."""

import dataclasses
from collections.abc import Iterator
from typing import Any, Self

_MAX_TEXTS = 64
"""Maximum number of texts (format, name and notes) that are read from JSON."""

_MAX_LENGTH = 1000
"""Maximum length of a text that is read from JSON."""

_MAX_CONVERSIONS = 16
"""Maximum number of files in a chain of conversions that is read from JSON: the latest ones."""

SIMULATION = "simulation"
"""Format of the origin of simulated bits. Its name is that of the photograph.

It has two notes: how the bits were simulated, and the SHA-256 of the photograph.
"""

_ORIENTATIONS = [[quarters, mirrored] for quarters in range(4) for mirrored in (False, True)]
"""All orientations, as JSON stores them."""


@dataclasses.dataclass(frozen=True)
class Provenance:
    r"""The file that bits or counts come from, and the files from which it was converted.

    Parameters
    ----------
    format : str
        The format's name, as ``jotlight.open(..., format=)`` takes it, or `SIMULATION`.
    name : str
        The name of the file or folder.
    notes : tuple of str
        Sentences about what was assumed or done on reading.
    orientation : (int, bool), optional
        The number of quarter turns counterclockwise, 0 to 3, since the first file was read, and
        whether left and right were exchanged afterward. None if this is unknown.
    origin : Provenance, optional
        The provenance of the file from which this one was converted, if known.

    Examples
    --------
    >>> raw = Provenance("swissspad2", "a.bin", ("the least significant bit first",))
    >>> cube = Provenance("npy", "a.npy").converted_from(raw).with_notes("frames 0:16 of 64")
    >>> print(cube)
    a.npy (npy; frames 0:16 of 64)
    >>> print(*cube.describe(), sep="\n")
    npy: frames 0:16 of 64
    npy: converted from a.bin
    swissspad2: the least significant bit first
    """

    format: str
    name: str
    notes: tuple[str, ...] = ()
    orientation: tuple[int, bool] | None = (0, False)
    origin: "Provenance | None" = None

    def __str__(self) -> str:
        return f"{self.name} ({'; '.join((self.format, *self.notes))})"

    def with_notes(self, *notes: str) -> Self:
        """Return the provenance with additional notes."""
        return dataclasses.replace(self, notes=(*self.notes, *notes))

    def reoriented(self, quarters: int, flip: str | None) -> Self:
        """Return the provenance after another rotation counterclockwise, and then a mirroring.

        Examples
        --------
        >>> turned = Provenance("npy", "cube.npy").reoriented(1, "vertical").reoriented(3, None)
        >>> turned.orientation
        (0, True)
        """
        if self.orientation is None:
            return self
        before, mirrored = self.orientation
        # To exchange top and bottom is to turn by 180 degrees and then exchange left and right.
        # A turn after a mirroring equals the opposite turn before the mirroring.
        after = quarters + 2 * (flip == "vertical")
        total = (before - after if mirrored else before + after) % 4
        return dataclasses.replace(self, orientation=(total, mirrored ^ (flip is not None)))

    def converted_from(self, origin: "Provenance | None") -> Self:
        """Return the provenance with an origin. The orientation becomes that of the origin."""
        if origin is None:
            return self
        return dataclasses.replace(self, origin=origin, orientation=origin.orientation)

    def describe_orientation(self) -> str:
        """Return the orientation in words."""
        if self.orientation is None:
            return "turned in a way that is not known"
        quarters, mirrored = self.orientation
        words = [f"rotated by {90 * quarters} degrees"] if quarters else []
        words += ["mirrored left to right"] if mirrored else []
        return " and ".join(words) or "not turned"

    def describe(self, *, checksums: bool = False) -> list[str]:
        """Return all notes and conversions, one line each, from this file back to the first.

        With `checksums`, the lines also state the SHA-256 of the photograph of simulated bits.

        Examples
        --------
        >>> drawn = Provenance(SIMULATION, "a.png", ("simulated from a.png", "SHA-256 of a.png: 1"))
        >>> Provenance("npy", "a.npy").converted_from(drawn).describe()
        ['simulated from a.png']
        """
        lines: list[str] = []
        for step in self.lineage():
            if step.format == SIMULATION:
                lines += step.notes if checksums else step.notes[:1]
                continue
            lines += [f"{step.format}: {note}" for note in step.notes]
            if step.origin is not None and step.origin.format != SIMULATION:
                lines.append(f"{step.format}: converted from {step.origin.name}")
        return lines

    def lineage(self) -> Iterator["Provenance"]:
        """Yield this provenance, its origin, the origin's origin, and so on."""
        step: Provenance | None = self
        while step is not None:
            yield step
            step = step.origin

    def to_json(self) -> dict[str, Any]:
        """Return the provenance as an object of JSON."""
        value: dict[str, Any] = {
            "format": self.format,
            "name": self.name,
            "notes": list(self.notes),
        }
        if self.orientation is not None:
            value["orientation"] = list(self.orientation)
        if self.origin is not None:
            value["origin"] = self.origin.to_json()
        return value

    @classmethod
    def from_json(cls, value: Any, max_conversions: int = _MAX_CONVERSIONS) -> Self:
        """Return the provenance from an object of :meth:`to_json`. It drops the oldest origins.

        Raises
        ------
        ValueError
            When the object does not describe a provenance.
        """
        optional = {"orientation", "origin"}
        if not isinstance(value, dict) or value.keys() - optional != {"format", "name", "notes"}:
            raise ValueError(
                "provenance: expected an object with format, name, notes, orientation and origin"
            )
        stored = value.get("orientation")
        if stored is not None and stored not in _ORIENTATIONS:
            raise ValueError(
                f"provenance: expected quarter turns and whether mirrored, got {stored!r}"
            )
        texts = [value["format"], value["name"]]
        texts += value["notes"] if isinstance(value["notes"], list) else [None]
        if len(texts) > _MAX_TEXTS or not all(
            isinstance(text, str) and len(text) <= _MAX_LENGTH for text in texts
        ):
            raise ValueError("provenance: expected short texts, and a list of them for notes")
        orientation = None if stored is None else (int(stored[0]), bool(stored[1]))
        has_origin = "origin" in value and max_conversions > 1
        origin = cls.from_json(value["origin"], max_conversions - 1) if has_origin else None
        return cls(texts[0], texts[1], tuple(texts[2:]), orientation, origin)
