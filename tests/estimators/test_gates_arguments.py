"""Gate stacks: arguments that are refused, and the shapes of trials and dark counts."""

import numpy as np
import pytest

import jotlight as jl

TIMES_OF_THREE = [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jl.gates.gate_detections([[5]], 4), "at most the number of readings"),
        (
            lambda: jl.gates.gate_detections([[3], [2]], 4, first_photon=True),
            "cycles in all gates together",
        ),
        (
            lambda: jl.gates.gate_detections([[0.5]], 4),
            r"counts: expected whole numbers, got 0\.5;",
        ),
        (lambda: jl.gates.gate_detections(3, 4), r"counts: expected those of each gate \(G, ...\)"),
        (lambda: jl.gates.gate_detections([[1]], 4, dark_counts=-1), "dark_counts: expected"),
        (lambda: jl.gates.gate_detections([[1]], 4, dark_counts=2e6), "dark_counts: expected at"),
        (lambda: jl.gates.gate_detections([[1]], 4, dark_counts=np.nan), "dark_counts: expected"),
        (lambda: jl.gates.decay_lifetime(np.ones((3, 2)), [0.0, 1.0]), "expected the time of each"),
        (lambda: jl.gates.decay_lifetime([3, 2], [0.0, 0.0]), "expected finite, increasing times"),
        (lambda: jl.gates.decay_lifetime([3, 2], [0.0, np.nan]), "expected finite, increasing"),
        (lambda: jl.gates.decay_lifetime([3, 2], [0.0, 1.0], trials=2), "at most the number of re"),
        (
            lambda: jl.gates.decay_lifetime([3, 2], [0.0, 1.0], dark_counts=0.1),
            "trials: expected the number of readings",
        ),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("trials", [None, 9])
@pytest.mark.parametrize(
    ("values", "error", "message"),
    [
        (np.ma.masked_array([4, 2, 1], [0, 1, 0]), TypeError, "expected a plain array, got a mask"),
        (np.array([4, 2, 1j]), ValueError, "expected .* numbers"),
        (["a", "b", "c"], ValueError, "expected .* numbers"),
        ([[4, 2], [1]], ValueError, "expected rows of the same length"),
    ],
)
def test_detections_that_are_no_numbers_are_refused_with_and_without_trials(
    values, error, message, trials
):
    name = "detections" if trials is None else "counts"
    with pytest.raises(error, match=f"{name}: {message}"):
        jl.gates.decay_lifetime(values, TIMES_OF_THREE, trials=trials)
    if trials is None:
        with pytest.raises(error, match=f"gate_times: {message}"):
            jl.gates.decay_lifetime([4, 2, 1], values)


def test_masked_arrays_are_refused_with_advice_that_works():
    pytest.importorskip("xarray")
    mask = np.broadcast_to(np.eye(2, dtype=bool), (3, 2, 2))
    ones = np.array([[[8, 7], [7, 8]], [[4, 3], [3, 4]], [[2, 1], [1, 2]]])
    masked = np.ma.array(ones, mask=mask)
    for call in (
        jl.gates.gate_detections,
        lambda counts, trials: jl.gates.decay_lifetime(counts, TIMES_OF_THREE, trials=trials),
        lambda counts, trials: jl.gates.gate_dataset(counts, trials, gate_times=TIMES_OF_THREE),
    ):
        with pytest.raises(TypeError, match=r"counts: .* pass trials of 0 where it is masked"):
            call(masked, 9)
        with pytest.raises(TypeError, match=r"trials: .* fill it with 0: such counts are left out"):
            call(ones, masked)
    found = jl.gates.gate_dataset(masked.filled(0), np.where(mask, 0, 9), gate_times=TIMES_OF_THREE)
    np.testing.assert_array_equal(np.isnan(found.lifetime), mask[0])
    np.testing.assert_array_equal(np.isnan(found.detections), mask)


@pytest.mark.parametrize("times", [[-1.7e308, 0, 1.7e308], [0, 1e-320, 1.0], [0, 1.0, 1 + 1e-13]])
def test_times_whose_steps_vanish_in_their_span_are_refused(times):
    with pytest.raises(ValueError, match=r"gate_times: expected a span of at most .* and steps of"):
        jl.gates.decay_lifetime([4, 2, 1], times)


def test_the_largest_span_of_times_has_finite_lifetimes():
    lifetime = jl.gates.decay_lifetime([4, 2, 1], [0, 5e299, 1e300])
    assert lifetime == pytest.approx(5e299 / np.log(2), rel=1e-6)


@pytest.mark.parametrize(
    "values", [20, [20, 30, 40], [[20, 30], [40, 50]], np.arange(20, 32).reshape(3, 2, 2)]
)
@pytest.mark.parametrize("first_photon", [False, True])
def test_trials_and_dark_counts_belong_to_gates_to_pixels_or_to_counts(values, first_photon):
    counts = np.array([[[9, 8], [8, 9]], [[4, 5], [5, 4]], [[3, 2], [1, 2]]])
    array = np.asarray(values)
    full = np.broadcast_to(array[:, None, None] if array.ndim == 1 else array, counts.shape)
    kind = {"first_photon": first_photon}
    found = jl.gates.gate_detections(counts, values, dark_counts=array / 500, **kind)
    expected = jl.gates.gate_detections(counts, full, **kind)
    np.testing.assert_allclose(found[0], expected[0] - full / 500, rtol=1e-12)
    np.testing.assert_array_equal(found[1], expected[1])
    found = jl.gates.decay_lifetime(
        counts, TIMES_OF_THREE, trials=values, dark_counts=array / 500, **kind
    )
    for row, column in np.ndindex(2, 2):
        at = (slice(None), row, column)
        one = jl.gates.decay_lifetime(
            counts[at], TIMES_OF_THREE, trials=full[at], dark_counts=full[at] / 500, **kind
        )
        assert found[row, column] == pytest.approx(one, rel=1e-6, nan_ok=True)


@pytest.mark.parametrize("name", ["trials", "dark_counts"])
@pytest.mark.parametrize(
    ("counts", "shape"),
    [
        ((8, 3, 4), (4,)),
        ((8, 3, 4), (1,)),
        ((8, 3, 4), (3,)),
        ((8, 3, 4), (8, 1, 1)),
        ((8, 3, 4), (1, 4)),
        ((8, 4), (4,)),
        ((8, 4), (1, 4)),
        ((8,), (1,)),
    ],
)
def test_other_shapes_of_trials_and_dark_counts_are_refused(name, counts, shape):
    options = {"trials": 1000, name: np.full(shape, 1000.0)}
    with pytest.raises(ValueError, match=f"{name}: expected one number, one for each of the 8 gat"):
        jl.gates.gate_detections(np.ones(counts, int), **options)
    with pytest.raises(ValueError, match=f"{name}: expected one number, one for each of the 8 gat"):
        jl.gates.decay_lifetime(np.ones(counts, int), np.arange(8.0), **options)
