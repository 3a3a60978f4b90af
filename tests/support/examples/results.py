"""Examples of the results of experiments."""

from examples.reader import Reader
from jotlight.experiments.tables import read_results, write_facts, write_table


def _results(path):
    path.mkdir()
    write_table(path / "fig5.csv", [{"image": "a", "psnr": 1.5}, {"image": "b", "psnr": 2}])
    write_facts(path / "run.csv", {"fig5": {"settings": "{}"}})


def _read_results(path):
    return read_results(path, lambda name: None)


RESULTS = {
    "results-facts": Reader("a", _read_results, (_results,), file="a/run.csv"),
    "results-table": Reader("a", _read_results, (_results,), file="a/fig5.csv"),
}
"""Readers of results, by the file that is damaged."""
