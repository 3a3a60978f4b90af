"""A report as a page of Markdown, with its figures and tables in files beside it."""

from collections.abc import Sequence

from jotlight.experiments.report.section import Claim, Report, Section, Table

_MOST_ROWS = 20
"""Of a table that is shown; longer ones are in the CSV."""


def markdown(report: Report) -> str:
    """Return the page; ``NAME.csv``, the curves' ``.svg`` and the scenes' ``.jpg`` are beside it."""
    lines = [f"# {report.title}", "", report.words, ""]
    lines += [f"- {name}: {value}" for name, value in report.facts]
    claims = [(section, claim) for section in report.sections for claim in section.claims]
    if claims:
        lines += ["", "## Claim by claim", ""]
        lines += ["| the paper | here | verdict | why |", "| --- | --- | --- | --- |"]
        lines += [_claim(section, claim) for section, claim in claims]
    for section in report.sections:
        lines += ["", *_section(section)]
    return "\n".join(lines) + "\n"


def _claim(section: Section, claim: Claim) -> str:
    return _row(
        [
            claim.said,
            claim.found,
            f"{claim.verdict} ([{section.name}](#{_anchor(section.title)}))",
            claim.why,
        ]
    )


def _section(section: Section) -> list[str]:
    lines = [f"## {section.title}", "", section.words]
    if section.command:
        rows = f"[{section.name}.csv]({section.name}.csv)"
        lines[-1] += f" `{section.command}`, {rows}."
    for curve in section.curves:
        lines += ["", f"![{curve.title}]({curve.name}.svg)"]
    if section.picture:
        lines += ["", f"![Bits and pictures, by every method]({section.picture})"]
    for table in section.tables:
        if len(table.rows) <= _MOST_ROWS:
            lines += ["", f"**{table.title}.**" + (f" {table.note}" if table.note else ""), ""]
            lines += _table(table)
    return lines


def _table(table: Table) -> list[str]:
    lines = [_row([column.title for column in table.columns])]
    words = [
        any(isinstance(row[number], str) for row in table.rows)
        for number in range(len(table.columns))
    ]
    lines.append(_row(["---" if is_words else "---:" for is_words in words]))
    for number in range(len(table.rows)):
        cells = [table.cell(number, column) for column in range(len(table.columns))]
        for column, cell in enumerate(cells):
            if table.is_best(number, column):
                cells[column] = f"**{cell}**"
        lines.append(_row(cells))
    return lines


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _anchor(title: str) -> str:
    """The place of a heading, as the usual renderers make it."""
    kept = "".join(letter for letter in title.lower() if letter.isalnum() or letter in " -")
    return kept.replace(" ", "-")
