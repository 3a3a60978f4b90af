"""docs/results/speed.md follows from the JSON beside it."""

from pathlib import Path

import matplotlib as mpl
import pytest

from suite.claims import claims
from suite.curves import curves
from suite.page import page
from suite.paths import PATHS
from suite.record import PAGE, read

RESULTS = Path(__file__).parents[2] / "docs/results"


@pytest.fixture(scope="module")
def found():
    return read(RESULTS)


def test_the_page_is_made_of_the_json(found):
    assert page(found) == (RESULTS / PAGE).read_text("utf-8")


def test_the_figures_are_made_of_the_json(found):
    for name, svg in curves(found).items():
        kept = (RESULTS / "speed" / f"{name}.svg").read_text("utf-8")
        if f"Matplotlib v{mpl.__version__}" not in kept:
            pytest.skip("another Matplotlib drew them, whose lines may lie elsewhere")
        assert svg == kept, name


def test_every_hot_path_and_part_was_measured(found):
    assert set(PATHS) <= {path["name"] for path in found["paths"]}
    assert {"scaling", "latency"} <= set(found)


def test_all_rivals_were_there(found):
    assert [path["left_out"] for path in found["paths"] if path["left_out"]] == []


def test_every_claim_has_a_row_with_its_verdict(found):
    rows = (RESULTS / PAGE).read_text("utf-8").splitlines()
    for claim in claims(found):
        busy = claim.bound.startswith("the machine was busy")
        assert claim.verdict in (("not measured",) if busy else ("met", "not met"))
        (row,) = (row for row in rows if row.startswith(f"| {claim.said} |"))
        assert f"| {claim.verdict} |" in row
        assert claim.verdict == "met" or claim.bound
