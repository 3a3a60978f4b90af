"""The networks that the experiments train."""

import numpy as np

import jotlight as jl
from jotlight.experiments import training_runs
from jotlight.experiments.experiment import Data, RunContext
from jotlight.training import ProjectedGradient


def test_the_papers_descent_has_the_papers_settings(tmp_path, monkeypatch):
    used = {}

    def train(start, scenes, **options):
        used.update(options, start=start)
        options["checkpoint"].touch()
        return start, None

    monkeypatch.setattr(training_runs, "train", train)
    context = RunContext(
        {"steps": 7, "batch": 128, "learning_rate": 5e-6, "seed": 0}, tmp_path, Data()
    )
    training_runs.train_as_paper(
        context, "name", jl.datasets.uniform_scenes, lambda share: None, 16, 0.5
    )
    assert not used["start"].tied
    assert used["start"].sensor.trials == 16
    assert used["start"].layers[1].filters.shape == (1, 1, 15, 15)
    assert all(layer.coefficients.shape == (1, 150) for layer in used["start"].layers)
    expected = jl.Network.initial(jl.Sensor(oversampling=4), sigma=0.5, tied=False)
    np.testing.assert_array_equal(used["start"].layers[1].filters, expected.layers[1].filters)
    assert used["optimizer"] == ProjectedGradient(5e-6)
    assert (used["steps"], used["batch"]) == (7, 128)
