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
    ones, activity = rng.uniform(0, 8, (2, 200_000))
    ratios = rng.normal(size=len(ones)) * (1 + ones + 3 * activity)
    model = tool.tabulate(np.zeros(28), ratios, ones, activity, np.ones(len(ones)))
    number, parts = tool.CLASSES
    edges, borders = (np.linspace(0, 8, size + 1) for size in (number, parts))
    assert model.low.shape == model.high.shape == (number, parts, len(tool.TAILS))
    for index in range(number):
        inside = (ones >= edges[index]) & (ones <= edges[index + 1])
        assert model.deviation[index] == pytest.approx(ratios[inside].std(), rel=0.02)
        for part in range(parts):
            cell = inside & (activity >= borders[part]) & (activity <= borders[part + 1])
            expected = np.quantile(ratios[cell], tool.TAILS)
            np.testing.assert_allclose(model.low[index, part, 3:], expected[3:], rtol=0.05)
            expected = np.quantile(ratios[cell], 1 - np.array(tool.TAILS))
            np.testing.assert_allclose(model.high[index, part, 3:], expected[3:], rtol=0.05)
    assert (np.diff(model.ones) > 0).all()
    assert (np.diff(model.activity) > 0).all()


def test_pixels_with_twice_the_weight_count_twice(tool):
    rng = np.random.default_rng(2)
    values, levels = rng.normal(size=5000), np.array([0.05, 0.5, 0.9])
    is_heavy = values > 0.3
    found = tool.weighted_quantiles(values, 1.0 + is_heavy, levels)
    twice = np.concatenate([values, values[is_heavy]])
    np.testing.assert_allclose(found, np.quantile(twice, levels), atol=0.01)
