"""Both parts of the fuzzing campaign read libFuzzer's output and write rows for the page."""

import sys
from argparse import ArgumentParser
from pathlib import Path

import pytest

from damage.page import build_page
from damage.record import facts, read_rows

FUZZ = Path(__file__).parents[2] / "fuzz"

OUTPUT = """INFO: Running with entropic power schedule (0xFF, 100).
#2\tINITED cov: 52 ft: 53 corp: 1/1b exec/s: 0 rss: 30Mb
#4000\tDONE   cov: 61 ft: 80 corp: 12/40b lim: 96 exec/s: 4000 rss: 31Mb
thread '<unnamed>' panicked at count.rs:1:2:
stat::number_of_executed_units: 4000
stat::average_exec_per_sec:     4000
"""
"""What libFuzzer prints, shortened."""


@pytest.fixture
def campaign(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(FUZZ)
    module = pytest.importorskip("campaign")
    monkeypatch.setattr(module, "FOUND", tmp_path / "found")
    return module


@pytest.mark.parametrize("part", ["readers", "engine"])
def test_rows_of_fuzzing_appear_on_the_page(part, campaign, monkeypatch, tmp_path, capsys):
    def fuzz(name):
        result = campaign.Result(name, seconds=2.0)
        result.add_statistics(OUTPUT)
        if name == "second":
            result.add_finding(OUTPUT)
        return result

    arguments = ["all", "--runs", "4000", "--jobs", "2", "--output", str(tmp_path / "a.jsonl")]
    monkeypatch.setattr(sys, "argv", ["program", *arguments])
    parser = ArgumentParser()
    parser.add_argument("name")
    options = campaign.parse_options(parser, "target")
    with pytest.raises(SystemExit, match="True"):
        campaign.run_targets(
            part, ["first", "second"], fuzz, options, {"libraries": {"rustc": "1.90"}}
        )
    printed = capsys.readouterr().out
    assert "== second\nthread '<unnamed>' panicked at count.rs:1:2:\n" in printed
    assert "#2" not in printed
    lines = build_page(read_rows(tmp_path)).splitlines()
    title = {"readers": "Python", "engine": "Rust"}[part]
    commit = facts("")["commit"]
    assert f"| {title}: first | {commit} | 4,000 | 2 | 2,000 | 61 | 0 | – |" in lines
    assert f"| {title}: second | {commit} | 4,000 | 2 | 2,000 | 61 | 1 | – |" in lines
    (run,) = (line for line in lines if line.startswith(f"| {part} | 8,000 | 1 |"))
    assert f"rustc 1.90 | `python fuzz/{part}.py {' '.join(arguments)}` |" in run


def test_the_inputs_that_remain_are_run(campaign, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["program", "--runs", "5000"])
    options = campaign.parse_options(ArgumentParser(), "target")
    words = campaign.libfuzzer_options(campaign.Result("a", inputs=4000), options)
    assert "-runs=1000" in words
    assert not [word for word in words if word.startswith("-max_total_time")]


def test_a_target_is_fuzzed_for_a_minute_by_default(campaign, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["program"])
    options = campaign.parse_options(ArgumentParser(), "target")
    words = campaign.libfuzzer_options(campaign.Result("a"), options)
    assert "-max_total_time=60" in words
    assert not [word for word in words if word.startswith("-runs")]
