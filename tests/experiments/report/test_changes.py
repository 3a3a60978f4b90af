"""Pages of results state which methods changed after the measurement."""

from jotlight.evaluation.methods import METHODS
from jotlight.experiments.report.changes import CHANGES, changes_since, row_title


def test_changes_after_the_date_are_stated():
    last = CHANGES[-1]
    assert changes_since("2000-01-01").count(";") == len(CHANGES) - 1
    assert last.text in changes_since("2000-01-01")
    assert changes_since(last.day) == ""


def test_rows_of_methods_that_changed_are_marked():
    assert row_title("TV", "noniterative-tv", "2026-11-25") == "TV (changed since)"
    assert row_title("TV", "noniterative-tv", "2026-11-28") == "TV"
    assert row_title("large", "network-large", "2026-11-25", only_time=True) == "large"
    assert row_title("TV", "noniterative-tv", "2026-11-25", only_time=True) == "TV (changed since)"
    assert row_title("mle", "mle", "2000-01-01") == "mle"


def test_changes_name_methods_that_exist():
    assert {name for change in CHANGES for name in change.methods} <= METHODS.keys()
