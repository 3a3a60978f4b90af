"""The tool that measures the errors of a network: the fit of the scale, and the quantiles."""

import importlib
from pathlib import Path

import numpy as np
import pytest

TOOLS = Path(__file__).parents[2] / "tools"


@pytest.fixture
def tool(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("calibrate_intervals")


def test_the_weights_of_laplace_errors_are_found(tool):
    rng = np.random.default_rng(0)
    terms = np.c_[np.ones(40_000), rng.normal(size=(40_000, 3))]
    weights = np.array([-2.0, 0.5, 0.0, -0.3])
    errors = rng.laplace(scale=np.exp(terms @ weights))
    np.testing.assert_allclose(tool.fit_weights(errors, terms), weights, atol=0.03)


def test_the_quantiles_are_those_of_each_class(tool):
    rng = np.random.default_rng(1)
    ones = rng.uniform(0, 8, 80_000)
    ratios = rng.normal(size=80_000) * (1 + ones)
    model = tool.tabulate(np.zeros(28), ratios, ones)
    edges = np.quantile(ones, np.linspace(0, 1, tool.CLASSES + 1))
    for index in range(tool.CLASSES):
        inside = (ones >= edges[index]) & (ones <= edges[index + 1])
        expected = np.quantile(ratios[inside], tool.TAILS)
        np.testing.assert_allclose(model.low[index], expected, rtol=0.01)
        assert model.deviation[index] == pytest.approx(ratios[inside].std(), rel=0.02)
    assert (np.diff(model.ones) > 0).all()
