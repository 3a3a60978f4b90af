"""The parts of a report: claims, tables, curves, and images, independent of how they are shown."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal

Value = str | float | int | None
"""A cell of a table: text, a number, or nothing."""

Verdict = Literal["reproduced", "better", "in part", "not reproduced", "not tested"]
"""What the measurements say about a claim.

"in part" means that the claim holds for some of the choices that the paper leaves open.
"""


@dataclasses.dataclass(frozen=True)
class Claim:
    """A statement of the paper beside what was measured."""

    statement: str
    """The paper's claim, with its numbers."""
    result: str
    """What was measured, with its numbers."""
    verdict: Verdict
    reason: str = ""
    """The explanation, where the verdict needs one."""


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a table."""

    title: str
    format: str | Callable[[float], str] = ""
    """How numbers are written: a format specification such as ".2f", or a function."""
    best: Literal["highest", "lowest"] | None = None
    """Which number is set in bold."""

    def text(self, value: Value) -> str:
        """Return a value as this column shows it, with an en dash for None."""
        if value is None:
            return "–"
        if isinstance(value, str):
            return value
        return format(value, self.format) if isinstance(self.format, str) else self.format(value)


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows of text and numbers. The HTML page can sort them by each column."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Value]]
    note: str = ""

    def cell(self, row: int, column: int) -> str:
        """Return a cell as text, with an en dash for None.

        Examples
        --------
        >>> Table("", [Column("PSNR, dB", ".2f")], [[25.0], [None]]).cell(0, 0)
        '25.00'
        """
        return self.columns[column].text(self.rows[row][column])

    def is_best(self, row: int, column: int) -> bool:
        """Return whether a cell shows the best number of its column."""
        best = self.columns[column].best
        if best is None or len(self.rows) < 2:
            return False
        value = self.rows[row][column]
        if not isinstance(value, int | float):
            return False
        numbers = [cells[column] for cells in self.rows if isinstance(cells[column], int | float)]
        extreme = max(numbers) if best == "highest" else min(numbers)  # type: ignore[type-var]
        return self.cell(row, column) == self.columns[column].text(extreme)

    def is_numeric(self, column: int) -> bool:
        """Return whether a column holds numbers and no text."""
        values = [cells[column] for cells in self.rows if cells[column] is not None]
        return bool(values) and not any(isinstance(value, str) for value in values)


@dataclasses.dataclass(frozen=True)
class Curves:
    """A drawing of curves."""

    name: str
    """The path of its file relative to the Markdown page, without the extension."""
    title: str
    svg: str
    note: str = ""


@dataclasses.dataclass(frozen=True)
class SceneImage:
    """The image that one method made of a scene."""

    title: str
    subtitle: str
    file: bytes
    """A PNG, JPEG, or WebP. All images of a scene show the same area, whatever their size."""


@dataclasses.dataclass(frozen=True)
class Scene:
    """Images of one scene, which the page overlays and shows side by side."""

    title: str
    size: tuple[int, int]
    """Height and width of the scene in pixels."""
    crop: tuple[int, int, int, int]
    """Top, left, height, and width of the enlarged area, in pixels of the scene."""
    images: Sequence[SceneImage]


@dataclasses.dataclass(frozen=True)
class Section:
    """One experiment, or another part of a report under a heading of its own."""

    name: str
    """A short name without spaces, unique in the report."""
    title: str
    text: str
    """What was done and how, in one paragraph."""
    command: str = ""
    """The command that makes the section. It is empty for a section made of other sections."""
    data_files: Sequence[str] = ()
    """Paths of the measured data, relative to the Markdown page."""
    claims: Sequence[Claim] = ()
    tables: Sequence[Table] = ()
    curves: Sequence[Curves] = ()
    scenes: Sequence[Scene] = ()
    image_file: str = ""
    """The file with the images of one scene side by side, where the section has scenes."""
    notes: Sequence[str] = ()
    """A list of remarks after the tables."""


@dataclasses.dataclass(frozen=True)
class Report:
    """A title, an introduction, facts about the run, and sections."""

    title: str
    text: str
    facts: Sequence[tuple[str, str]]
    """Names and values of what was used: versions, processor, settings, times."""
    sections: Sequence[Section]
