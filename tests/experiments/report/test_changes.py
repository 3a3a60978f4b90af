"""Pages of results state which methods changed after the measurement."""

from jotlight.experiments.report.changes import CHANGES, changes_since


def test_changes_after_the_date_are_stated():
    last, text = CHANGES[-1]
    assert changes_since("2000-01-01").count(";") == len(CHANGES) - 1
    assert text in changes_since("2000-01-01")
    assert changes_since(last) == ""
