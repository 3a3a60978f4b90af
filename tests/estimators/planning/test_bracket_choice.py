"""The choice of the numbers of frames of each exposure and threshold."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.planning.bracket_choice import FrameDivision, _moves, divide_frames
from jotlight.estimators.planning.bracketing import snr_bound
from jotlight.estimators.planning.planned_estimates import PlannedEstimates

LEVELS = np.geomspace(0.1, 50.0, 9)
SETTINGS = [(1.0, 1), (0.25, 1), (0.25, 3), (1 / 32, 1)]


def test_all_frames_are_divided_so_that_the_lowest_sum_is_high():
    squares = np.array([[4.0, 0.0, 1.0], [0.0, 2.0, 1.0]])
    numbers = divide_frames(squares, 9)
    assert numbers.sum() == 9
    each = [np.min([first, 9 - first] @ squares) for first in range(10)]
    assert np.min(numbers @ squares) >= max(each) - squares.max() / 2


def test_the_bound_is_that_of_a_sensor_with_these_frames():
    sensor = jl.Sensor(frames=10, oversampling=2, efficiency=0.6, dark_counts=0.03)
    numbers = np.array([4, 3, 2, 1])
    choice = FrameDivision(sensor, SETTINGS, LEVELS)
    exposures, thresholds = np.repeat(SETTINGS, numbers, axis=0).T
    own = sensor.replace(gain=4 * exposures, threshold=thresholds.astype(int))
    np.testing.assert_allclose(choice.bound(numbers), snr_bound(own, LEVELS))


def test_no_single_move_of_a_frame_improves_a_choice():
    choice = FrameDivision(jl.Sensor(frames=12), SETTINGS, LEVELS)
    best = choice.best(12)
    lowest = np.minimum(choice.snr(best), choice.bound(best)).min()
    for source in np.flatnonzero(best):
        for target in range(len(SETTINGS)):
            moved = best.copy()
            moved[source] -= 1
            moved[target] += 1
            quality = np.minimum(choice.snr(moved), choice.bound(moved)).min()
            assert quality <= lowest + 0.02


def test_the_best_single_setting_is_the_best():
    choice = FrameDivision(jl.Sensor(frames=12), SETTINGS, LEVELS)
    single = choice.best_single(12)
    lowest = []
    for index in range(len(SETTINGS)):
        numbers = np.zeros(len(SETTINGS), int)
        numbers[index] = 12
        lowest.append(np.minimum(choice.snr(numbers), choice.bound(numbers)).min())
    assert single[np.argmax(lowest)] == 12


@pytest.mark.slow
def test_the_first_move_is_the_best_of_all_and_needs_few_levels(monkeypatch):
    start, levels = np.array([4, 4, 2, 2]), np.geomspace(0.1, 50.0, 49)
    choice = FrameDivision(jl.Sensor(frames=12), SETTINGS, levels)
    computed = []
    monkeypatch.setattr(
        PlannedEstimates, "bias_and_mse", counted(PlannedEstimates.bias_and_mse, computed)
    )
    found = choice._move_frame(start)
    assert len(computed) < 200
    moves = list(_moves(start))
    assert len(moves) * len(levels) > 500
    lowest = [np.minimum(choice.snr(moved), choice.bound(moved)).min() for moved in moves]
    np.testing.assert_array_equal(found, moves[np.argmax(lowest)])


def counted(function, calls):
    def call(*arguments):
        calls.append(arguments)
        return function(*arguments)

    return call
