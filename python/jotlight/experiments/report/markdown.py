"""A report as a page of Markdown, with its curves, images, and data in files beside it."""

from collections.abc import Iterable

from jotlight.experiments.report.content import Claim, Report, Section, Table

_MAX_ROWS = 25
"""The longest table that the page shows. The rows of longer tables are in the data files."""


def render_markdown(report: Report) -> str:
    """Return the page of a report as Markdown.

    Examples
    --------
    >>> render_markdown(Report("Speed", "How fast it is.", [], [])).splitlines()[0]
    '# Speed'
    """
    lines = [f"# {report.title}", "", report.text]
    if report.facts:
        lines += ["", *(f"- {name}: {value}" for name, value in report.facts)]
    claims = [(section, claim) for section in report.sections for claim in section.claims]
    if claims:
        lines += ["", "## Claim by claim", ""]
        lines += ["| the paper | verdict | here | why |", "| --- | --- | --- | --- |"]
        lines += [_claim_row(section, claim) for section, claim in claims]
    for section in report.sections:
        lines += ["", *_section(section)]
    return "\n".join(lines) + "\n"


def _claim_row(section: Section, claim: Claim) -> str:
    verdict = f"{claim.verdict} ([{section.name}](#{heading_anchor(section.title)}))"
    return _row([claim.statement, verdict, claim.result, claim.reason])


def _section(section: Section) -> list[str]:
    lines = [f"## {section.title}", "", section.text]
    if section.command:
        files = "".join(f", [{path}]({path})" for path in section.data_files)
        lines[-1] += f" `{section.command}`{files}."
    for curve in section.curves:
        lines += ["", f"![{curve.title}]({curve.name}.svg)"]
    if section.image_file:
        lines += ["", f"![Bits and estimates, by every method]({section.image_file})"]
    for table in section.tables:
        if len(table.rows) <= _MAX_ROWS:
            lines += ["", *_table(table)]
    if section.notes:
        lines += ["", *(f"- {note}" for note in section.notes)]
    return lines


def _table(table: Table) -> list[str]:
    lines = [f"**{table.title}.**" + (f" {table.note}" if table.note else ""), ""]
    numbers = range(len(table.columns))
    lines.append(_row([column.title for column in table.columns]))
    lines.append(_row(["---:" if table.is_numeric(number) else "---" for number in numbers]))
    for row in range(len(table.rows)):
        cells = [table.cell(row, number) for number in numbers]
        lines.append(
            _row(
                f"**{cell}**" if table.is_best(row, number) else cell
                for number, cell in enumerate(cells)
            )
        )
    return lines


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def heading_anchor(title: str) -> str:
    """Return the anchor that common Markdown renderers make of a heading.

    Examples
    --------
    >>> heading_anchor("Figure 5: the descent")
    'figure-5-the-descent'
    """
    kept = "".join(letter for letter in title.lower() if letter.isalnum() or letter in " -")
    return kept.replace(" ", "-")
