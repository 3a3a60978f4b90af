"""docs/results/speed.md follows from the JSON beside it."""

import re
from pathlib import Path

import matplotlib as mpl
import pytest

from jotlight.experiments.report.markdown import render_markdown
from suite.comparisons import alternatives
from suite.page import build_report
from suite.record import PAGE_FILE, read
from suite.tasks import TASKS

RESULTS = Path(__file__).parents[2] / "docs/results"


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run():
    return read(RESULTS)


def test_the_page_follows_from_the_json(run):
    assert render_markdown(build_report(run)) == (RESULTS / PAGE_FILE).read_text("utf-8")


def test_the_curves_follow_from_the_json(run):
    for section in build_report(run).sections:
        for curves in section.curves:
            kept = (RESULTS / f"{curves.name}.svg").read_text("utf-8")
            if f"Matplotlib v{mpl.__version__}" not in kept:
                pytest.skip("another version of Matplotlib drew the curves")
            assert without_ids(curves.svg) == without_ids(kept), curves.name


def without_ids(svg):
    """Return a drawing without the ids of its clip paths. Their rectangles stay."""
    return re.sub(r"\bp[0-9a-f]{10}\b", "clip", svg)


def test_every_task_and_part_was_measured(run):
    assert set(TASKS) <= {task["name"] for task in run["tasks"]}
    assert {"scaling", "latency"} <= set(run)


def test_every_program_was_installed(run):
    assert [task["left_out"] for task in run["tasks"] if task["left_out"]] == []


def test_every_task_has_an_alternative(run):
    for task in run["tasks"]:
        if "2048" not in task["name"]:
            assert set(alternatives(task)) & set(task["seconds"]["1"]), task["name"]


def test_every_result_agrees_within_its_tolerance(run):
    for task in run["tasks"]:
        assert all(value <= task["tolerance"] for value in task["differences"].values())
        assert all(value <= 1e-4 for value in task["level_differences"].values())
