"""docs/results/reproduction.md follows from the tables in docs/results."""

import re
from pathlib import Path

import matplotlib as mpl
import pytest

from jotlight.experiments import EXPERIMENTS
from jotlight.experiments.report.markdown import render_markdown
from jotlight.experiments.report.report import read_report
from jotlight.experiments.tables import read_results

RESULTS = Path(__file__).parents[2] / "docs/results"


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report():
    return read_report(RESULTS)


def test_the_page_is_made_of_the_tables(report):
    assert render_markdown(report) == (RESULTS / "reproduction.md").read_text("utf-8")


def test_the_tables_are_those_of_a_full_run():
    results = read_results(RESULTS, lambda _: None)
    assert list(results) == list(EXPERIMENTS)
    for name, found in results.items():
        settings = dict(found.settings)
        assert settings.pop("quick") is False
        assert settings.pop("BM3D") != "not installed"
        settings.pop("jotlight")
        assert settings.pop("data").keys() == set(EXPERIMENTS[name].datasets)
        assert settings == EXPERIMENTS[name].full_settings


@pytest.mark.parametrize(
    "words",
    [
        # Section 4, sentence by sentence.
        "Cost and gradient norm decrease along the iterations, with minor oscillations",
        "PSNR increases by learning for all K (figure 6a)",
        "PSNR improves naturally for large oversampling values",
        "The largest gain is 1.7 dB, for K = 9",
        "PSNR increases by learning for all K (figure 6b)",
        "more prominent than on the synthetic scenes",
        "The largest gain is 3.2 dB, for K = 9",
        "comparable with the non-iterative method with BM3D",
        "better preserves the scene's structure",
        "the network is 5.25 times as fast",
        "MLE takes 52 ms",
    ],
)
def test_every_claim_of_section_4_has_a_row_with_a_verdict(words):
    page = (RESULTS / "reproduction.md").read_text("utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ") and words in line]
    assert len(rows) == 1
    said, verdict, found = (cell.strip() for cell in re.split(r"(?<!\\)\|", rows[0])[1:4])
    assert words in said
    assert re.search(r"\d", found)
    assert verdict.split(" (")[0] in ("reproduced", "better", "in part", "not reproduced")


def test_the_drawings_are_made_of_the_tables(report):
    for section in report.sections:
        for curve in section.curves:
            kept = (RESULTS / f"{curve.name}.svg").read_text("utf-8")
            if f"Matplotlib v{mpl.__version__}" not in kept:
                pytest.skip("another Matplotlib drew them, whose lines may lie elsewhere")
            assert curve.svg == kept, curve.name
