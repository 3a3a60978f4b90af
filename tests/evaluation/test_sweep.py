"""Every method and pretrained network on adversarial bits: a part of the sweep of `tools/`."""

import itertools
import re

import numpy as np
import pytest

from sweep.cases import (
    GAINS,
    LONG,
    PATTERNS,
    SENSORS,
    SHAPES,
    THRESHOLDS,
    Case,
    build_cases,
)
from sweep.measure import check, measure
from sweep.methods import SweptMethod, build_methods

pytestmark = pytest.mark.slow

METHODS = build_methods()
CASE = Case({"oversampling": 2, "max_intensity": 0.7}, (3, 4), "half", channels=1)


def assert_no_violations(name, stride, *, first=0):
    method = METHODS[name]
    cases = [case for case in build_cases(method.trials) if np.prod(case.shape) < LONG]
    chosen = cases[first::stride]
    assert len(chosen) > 3
    found = {str(case): check(method, case)[0] for case in chosen}
    assert {case: violation for case, violation in found.items() if violation} == {}


@pytest.mark.parametrize("name", [name for name in METHODS if METHODS[name].stride == 1])
def test_adversarial_bits_lead_to_estimates_between_0_and_the_largest_intensity(name):
    assert_no_violations(name, 701)


@pytest.mark.parametrize("pattern", ["all", "alternating", "half"])
def test_steps_that_overflow_between_unequal_jots_lead_to_no_warning(pattern):
    sensor = {"oversampling": 2, "frames": 3, "gain": 1e6, **SENSORS["all maps"]}
    assert check(METHODS["uncertainty (low)"], Case(sensor, (7, 11), pattern)) == ("", False)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.exhaustive] if METHODS[name].stride == 1 else [])
        for name in METHODS
    ],
)
def test_more_adversarial_bits_lead_to_such_estimates(name):
    assert_no_violations(name, 101 * METHODS[name].stride, first=5)


@pytest.mark.parametrize(
    ("run", "violation"),
    [
        (lambda bits, sensor: np.full((3, 4), np.nan, np.float32), "12 values are not finite"),
        (lambda bits, sensor: np.full((3, 4), np.inf, np.float32), "12 values are not finite"),
        (lambda bits, sensor: np.full((3, 4), -1e-30, np.float32), "values from -1e-30"),
        (lambda bits, sensor: np.full((3, 4), 0.70001, np.float32), "values from 0.70001"),
        (lambda bits, sensor: np.zeros((3, 4)), "float64 of shape"),
        (lambda bits, sensor: np.zeros((4, 3), np.float32), r"float32 of shape \(4, 3\)"),
        (lambda bits, sensor: np.float32([1]) / np.float32(0), "RuntimeWarning: divide by zero"),
        (lambda bits, sensor: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_the_sweep_finds_violations(run, violation):
    found, refused = check(SweptMethod(run), CASE)
    assert not refused
    assert re.match(violation, found)


def test_the_sweep_counts_refused_sensors_apart():
    network = METHODS["network small-k9"]
    assert check(network, CASE) == ("", True)
    assert check(network, Case({"oversampling": 3}, (3, 4), "half")) == ("", False)


def test_the_cases_hold_all_combinations_that_the_sweep_states():
    cases = list(build_cases(None))
    settings = {(x.sensor.get("gain"), x.sensor["threshold"], x.pattern) for x in cases}
    assert settings >= set(itertools.product(GAINS, THRESHOLDS, PATTERNS))
    for trials in (None, 16):
        shapes = {(x.shape, x.pattern) for x in build_cases(trials) if "gain" not in x.sensor}
        assert shapes >= set(itertools.product(SHAPES, PATTERNS))


@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_patterns_are_bits_of_the_whole_sensor(pattern):
    bits, sensor = Case({"oversampling": 2, "frames": 3}, (5, 7), pattern, channels=3).make()
    assert bits.shape == (3, 10, 14, 3)
    assert (sensor.oversampling, sensor.frames) == (2, 3)
    means = bits.to_array().mean((0, 1, 2))
    np.testing.assert_allclose(means[1:], 1 - means[0])
    expected = {"no": 0, "all": 1, "single": 1 / 420, "row": 0.1, "sparse": 0.01}
    assert means[0] == pytest.approx(expected.get(pattern, 0.5), abs=0.05)


def test_a_quick_sweep_reports_a_row_for_each_method():
    (row,) = measure(quick=True, only="mle-iterative (newton)")
    assert (row["part"], row["violations"]) == ("sweep", [])
    assert row["runs"] > 40
    assert row["refused"] == 0
