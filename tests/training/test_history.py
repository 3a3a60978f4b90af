"""The records of a run."""

import pytest

from jotlight.training import History, Record


@pytest.mark.parametrize("number", [0, -3, 1.5, "many"])
def test_a_history_without_records_is_no_subsample(number):
    history = History([Record(step, 1.0, 1.0, None) for step in range(5)])
    with pytest.raises((TypeError, ValueError), match="max_records: expected"):
        history.subsample(number)
