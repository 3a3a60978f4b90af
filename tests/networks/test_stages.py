"""The stages of a network's history."""

import pytest

import jotlight as jl
from jotlight.networks.stages import last_run, stages_of, stored_history, with_run, with_stage


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


def test_the_only_run_in_a_file_is_a_stage():
    stored = {"start": "random", "run": {"seed": 1}, "records": {}, "trained on": "photos"}
    stage = {"kind": "train", "data": "photos", "run": {"seed": 1}, "records": {}}
    assert stored_history(stored) == {"start": "random", "stages": [stage]}
    for history in ({"start": "random"}, {"stages": ["by hand"]}, []):
        assert stored_history(history) is history


def test_damaged_histories_are_refused(tmp_path):
    with pytest.raises(ValueError, match="history: expected a list of stages, got 3"):
        stages_of({"stages": 3})
    with pytest.raises(ValueError, match="history: expected a stage that is a training run"):
        last_run({"stages": ["by hand"]})
    layers, sensor = jl.Network.initial(jl.Sensor()).layers, jl.Sensor()
    damaged = {"stages": 3, "run": {}, "records": {}}
    jl.Network(layers, sensor, damaged).save(tmp_path / "a.safetensors")
    with pytest.raises(
        ValueError, match=r"a\.safetensors: damaged network file: history: expected"
    ):
        jl.Network.load(tmp_path / "a.safetensors")
