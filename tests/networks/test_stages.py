"""The stages of a network's history."""

import pytest

from jotlight.networks.stages import last_run, stages_of, with_run, with_stage


def test_stages_stay_in_order_and_do_not_change_the_history_before():
    first = with_run({"start": "random"}, "train", {"seed": 1}, {"loss": [1]})
    second = with_run(with_stage(first, "by hand"), "fine-tune", {"seed": 2}, {"loss": [2]})
    assert second["start"] == "random"
    assert [stage if isinstance(stage, str) else stage["kind"] for stage in stages_of(second)] == [
        "train",
        "by hand",
        "fine-tune",
    ]
    assert last_run(with_stage(second, "by hand again"))["run"] == {"seed": 2}
    assert len(stages_of(first)) == 1


def test_damaged_histories_are_refused():
    with pytest.raises(ValueError, match="history: expected a list of stages, got 3"):
        stages_of({"stages": 3})
    with pytest.raises(ValueError, match="history: expected a stage that is a training run"):
        last_run({"stages": ["by hand"]})
