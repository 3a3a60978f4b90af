"""The command that repeats an experiment."""

import dataclasses
from pathlib import Path

import pytest

from jotlight.experiments import EXPERIMENTS
from jotlight.experiments.tables import read_results

RESULTS = Path(__file__).parents[2] / "docs/results"


@pytest.fixture(scope="module")
def stored():
    return read_results(RESULTS, lambda _: None)


@pytest.mark.parametrize("name", EXPERIMENTS)
@pytest.mark.slow
def test_each_section_states_the_options_that_its_run_had(stored, name):
    # A run without them has other results.
    results = stored[name]
    assert EXPERIMENTS[name].section(results).command == f"jotlight reproduce {name}"
    settings = {**results.settings, "quick": True, "methods": {"mine:f": "", "mine:g": ""}}
    section = EXPERIMENTS[name].section(dataclasses.replace(results, settings=settings))
    assert section.command == f"jotlight reproduce {name} --quick --method mine:f --method mine:g"
