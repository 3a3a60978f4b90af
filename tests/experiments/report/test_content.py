"""Cells of tables, their best values, and the Markdown of a report."""

from jotlight.experiments.report.content import Claim, Column, Curves, Report, Section, Table
from jotlight.experiments.report.markdown import heading_anchor, render_markdown


def test_a_cell_is_written_in_the_format_of_its_column():
    columns = [Column("a"), Column("b", ".1f"), Column("c", "{:,.0f}".format), Column("d", ".0%")]
    table = Table("", columns, [["x", 1.25, 1234.5, 0.5], [7, None, None, None]])
    assert [table.cell(0, column) for column in range(4)] == ["x", "1.2", "1,234", "50%"]
    assert [table.cell(1, column) for column in range(4)] == ["7", "–", "–", "–"]
    assert [table.is_numeric(column) for column in range(4)] == [False, True, True, True]


def test_values_that_look_equal_are_equally_good():
    table = Table("", [Column("a", ".1f", "highest")], [[1.04], [1.02], [0.9], [None]])
    assert [table.is_best(row, 0) for row in range(4)] == [True, True, False, False]
    low = Table("", [Column("a", ".1f", "lowest")], [[1.04], [1.02], [0.9], [None]])
    assert [low.is_best(row, 0) for row in range(4)] == [False, False, True, False]
    alone = Table("", [Column("a", ".1f", "highest")], [[1.0]])
    assert not alone.is_best(0, 0)


def test_markdown_has_claims_figures_tables_and_notes():
    section = Section(
        "part",
        "Part 1: a | b",
        "Text.",
        "command",
        ["part.csv"],
        claims=[Claim("says", "finds", "in part", "because")],
        tables=[Table("A table", [Column("x"), Column("y", ".2f", "highest")], [["a|b", 1.0]] * 2)],
        curves=[Curves("folder/curve", "A curve", "<svg/>")],
        notes=["a note"],
    )
    page = render_markdown(Report("Title", "Introduction.", [("name", "value")], [section]))
    assert page.startswith("# Title\n\nIntroduction.\n\n- name: value\n")
    assert "| says | in part ([part](#part-1-a--b)) | finds | because |" in page
    assert "Text. `command`, [part.csv](part.csv)." in page
    assert "![A curve](folder/curve.svg)" in page
    assert "| x | y |\n| --- | ---: |\n| a\\|b | **1.00** |" in page
    assert page.endswith("\n- a note\n")


def test_markdown_leaves_long_tables_to_the_data_files():
    long = Table("Long", [Column("x")], [[number] for number in range(26)])
    page = render_markdown(Report("Title", "", [], [Section("a", "A", "", tables=[long])]))
    assert "Long" not in page


def test_an_anchor_drops_punctuation():
    assert heading_anchor("Figure 6a: learning, 2 × 2") == "figure-6a-learning-2--2"
