"""Facts about the runs of experiments, which may be damaged."""

import json

import pytest

import jotlight as jl
from jotlight.experiments.report.report import read_report
from jotlight.experiments.tables import read_results, write_facts, write_table

SETTINGS = {"quick": True, "BM3D": "4.0.3"}
FACTS = {
    "seconds": "1",
    "date": "2026-01-01",
    "machine": "a",
    "settings": json.dumps(SETTINGS),
}


def write_results(folder, facts, name="fig5"):
    write_facts(folder / "run.csv", {name: facts, "whole": FACTS})
    for each in ("fig5", "whole"):
        write_table(folder / f"{each}.csv", [{"psnr": 1.5}])


@pytest.mark.parametrize(
    "changes",
    [
        *({"settings": text} for text in ("", "nope", "{}", "[]", "null", "[" * 100_000)),
        {"settings": json.dumps({"quick": True})},
        {"settings": json.dumps({**SETTINGS, "BM3D": None})},
        {"settings": json.dumps({**SETTINGS, "quick": "no"})},
        *({"seconds": text} for text in ("", "x", "nan", "1e400", "-1")),
        *({"date": text} for text in ("", "yesterday", "<script>alert(1)</script>")),
    ],
)
def test_experiments_with_damaged_facts_are_left_out(tmp_path, changes):
    write_results(tmp_path, {**FACTS, **changes})
    with pytest.warns(jl.JotlightWarning, match=r"^fig5 is left out: .*; run it again"):
        results = read_results(tmp_path, lambda name: None)
    assert list(results) == ["whole"]
    assert results["whole"].settings == SETTINGS


@pytest.mark.parametrize("fact", FACTS)
def test_experiments_without_a_fact_are_left_out(tmp_path, fact):
    write_results(tmp_path, {name: text for name, text in FACTS.items() if name != fact})
    with pytest.warns(jl.JotlightWarning, match="fig5 is left out"):
        assert list(read_results(tmp_path, lambda name: None)) == ["whole"]


def test_the_name_of_an_experiment_is_no_path(tmp_path):
    (tmp_path / "inner").mkdir()
    write_table(tmp_path / "secret.csv", [{"psnr": 1.5}])
    write_results(tmp_path / "inner", FACTS, name="../secret")
    with pytest.warns(jl.JotlightWarning, match="secret is left out"):
        assert list(read_results(tmp_path / "inner", lambda name: None)) == ["whole"]


def test_a_report_needs_the_results_of_an_experiment(tmp_path):
    write_results(tmp_path, {**FACTS, "settings": "{}"})
    with (
        pytest.warns(jl.JotlightWarning, match="fig5 is left out"),
        pytest.raises(ValueError, match="expected the results of an experiment"),
    ):
        read_report(tmp_path)
