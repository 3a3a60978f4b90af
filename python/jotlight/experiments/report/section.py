"""What a report is made of: claims, tables, curves and pictures, apart from how they are shown."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

Value = str | float | int | None
"""A cell of a table: words, a number, or nothing."""

Verdict = Literal["reproduced", "better", "in part", "not reproduced", "not tested"]
"""In part: from some of the starts that the paper leaves open, and not from others."""


@dataclasses.dataclass(frozen=True)
class Claim:
    """What the paper says, and what was measured here."""

    said: str
    """The paper's claim, with its figures."""
    found: str
    """What came out here, with its figures."""
    verdict: Verdict
    why: str = ""
    """The reason, where the verdict needs one."""


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a table."""

    title: str
    digits: int | None = None
    """Digits after the point; None for words and whole numbers."""
    best: Literal["highest", "lowest"] | None = None
    """Which of the numbers to set in bold."""


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows of words and numbers; in a page it can be sorted by each column."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Value]]
    note: str = ""

    def cell(self, row: int, column: int) -> str:
        """Give a cell as it is shown, with an en dash for nothing.

        Examples
        --------
        >>> Table("", [Column("PSNR, dB", 2)], [[25.0], [None]]).cell(0, 0)
        '25.00'
        """
        value, digits = self.rows[row][column], self.columns[column].digits
        if value is None:
            return "–"
        if isinstance(value, str) or digits is None:
            return str(value)
        return f"{value:.{digits}f}"

    def is_best(self, row: int, column: int) -> bool:
        """Whether a cell holds the best number of its column, as it is shown."""
        best = self.columns[column].best
        if best is None or len(self.rows) < 2:
            return False
        numbers = [
            float(self.cell(index, column))
            for index, cells in enumerate(self.rows)
            if isinstance(cells[column], int | float)
        ]
        value = self.rows[row][column]
        if not isinstance(value, int | float):
            return False
        extreme = max(numbers) if best == "highest" else min(numbers)
        return float(self.cell(row, column)) == extreme


@dataclasses.dataclass(frozen=True)
class Curves:
    """A drawing of curves."""

    name: str
    """Of its file, without ending."""
    title: str
    svg: str
    note: str = ""


@dataclasses.dataclass(frozen=True)
class Picture:
    """What one method made of a scene."""

    title: str
    subtitle: str
    file: bytes
    """A PNG, JPEG or WebP; all of a scene show the same part of it, whatever their size."""


@dataclasses.dataclass(frozen=True)
class Scene:
    """Pictures of one scene, to be laid over each other and beside each other."""

    title: str
    size: tuple[int, int]
    """Height and width of the scene in pixels."""
    crop: tuple[int, int, int, int]
    """Top, left, height and width of the part to be shown enlarged, in pixels of the scene."""
    pictures: Sequence[Picture]


@dataclasses.dataclass(frozen=True)
class Section:
    """One experiment."""

    name: str
    title: str
    words: str
    """What was done and how, in one paragraph."""
    command: str
    """The command that makes it; empty where it is made of other sections."""
    claims: Sequence[Claim] = ()
    tables: Sequence[Table] = ()
    curves: Sequence[Curves] = ()
    scenes: Sequence[Scene] = ()
    picture: str = ""
    """File of one scene's pictures side by side, where there are scenes."""


@dataclasses.dataclass(frozen=True)
class Report:
    """All of them."""

    title: str
    words: str
    facts: Sequence[tuple[str, str]]
    """Names and values of what was used: versions, processor, settings, times."""
    sections: Sequence[Section]
