"""Gate stacks: exact inversion of pile-up, lifetimes, and data sets."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.errors import MissingExtraError

TIMES = np.arange(12) * 0.7
LIFETIME = 2.3


def decay(light):
    """Return the expected detections of each gate of a decay, (G, 1, 1)."""
    return (light * np.exp(-TIMES / LIFETIME))[:, None, None]


@pytest.mark.parametrize("first_photon", [False, True])
def test_exact_fractions_are_inverted_exactly(first_photon):
    expected, cycles = decay(1.1), 2**40
    ones = -np.expm1(-expected)
    if first_photon:
        before = np.exp(-np.concatenate([[0], expected.cumsum()[:-1]]))[:, None, None]
        ones = ones * before
    counts = np.rint(cycles * ones)
    found, error = jl.gates.gate_detections(counts, cycles, first_photon=first_photon)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert (error < 1e-4).all()


@pytest.mark.parametrize("first_photon", [False, True])
def test_lifetimes_have_a_bias_below_one_percent_where_uncorrected_ones_are_off_by_twenty(
    first_photon,
):
    light, cycles, shape = (1.45 if not first_photon else 0.32), 20000, (40, 40)
    rng = np.random.default_rng(0)
    expected = np.broadcast_to(decay(light), (12, *shape))
    if first_photon:
        # Each cycle ends at its first photon: a multinomial distribution of gates.
        ones = -np.expm1(-expected[:, 0, 0])
        before = np.exp(-np.concatenate([[0], expected[:-1, 0, 0].cumsum()]))
        weights = np.append(ones * before, 0)
        weights[-1] = 1 - weights.sum()
        counts = rng.multinomial(cycles, weights, size=shape)[..., :-1].transpose(2, 0, 1)
    else:
        counts = rng.binomial(cycles, -np.expm1(-expected))
    detections, error = jl.gates.gate_detections(counts, cycles, first_photon=first_photon)
    corrected = jl.gates.decay_lifetime(detections, TIMES)
    uncorrected = jl.gates.decay_lifetime(counts, TIMES)
    assert abs(corrected.mean() / LIFETIME - 1) < 0.01
    assert abs(uncorrected.mean() / LIFETIME - 1) > 0.2
    # The standard error is that of the simulated detections.
    np.testing.assert_allclose(detections.std(axis=(1, 2)), error.mean(axis=(1, 2)), rtol=0.12)


def test_dark_counts_saturation_and_gates_without_cycles():
    counts = np.array([[3, 10], [0, 0], [7, 0]])
    found, _ = jl.gates.gate_detections(counts, 10, first_photon=True, dark_counts=0.1)
    assert found[0, 0] == pytest.approx(-np.log(0.7) - 0.1)
    assert found[0, 1] == np.inf
    assert found[1, 0] == 0
    assert np.isnan(found[1, 1])
    assert found[2, 0] == np.inf
    lifetime = jl.gates.decay_lifetime(found, np.arange(3.0))
    assert np.isnan(lifetime).all()
    rising = jl.gates.decay_lifetime([[1.0], [2.0]], [0.0, 1.0])
    assert np.isnan(rising).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jl.gates.gate_detections([[5]], 4), "at most the number of readings"),
        (
            lambda: jl.gates.gate_detections([[3], [2]], 4, first_photon=True),
            "cycles in all gates together",
        ),
        (lambda: jl.gates.gate_detections([[0.5]], 4), "expected whole numbers"),
        (lambda: jl.gates.gate_detections([[1]], 4, dark_counts=-1), "dark_counts: expected"),
        (lambda: jl.gates.decay_lifetime(np.ones((3, 2)), [0.0, 1.0]), "expected the time of each"),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_trials_may_belong_to_gates():
    counts = np.array([[[3, 1]], [[2, 5]]])
    found = jl.gates.gate_detections(counts, [10, 20])
    expected = jl.gates.gate_detections(counts, np.array([10, 20])[:, None, None])
    np.testing.assert_array_equal(found, expected)
    with pytest.raises(ValueError, match="one for each of the 2 gates"):
        jl.gates.gate_detections(counts, [10, 20, 30])


def test_data_sets_hold_all_results():
    pytest.importorskip("xarray")
    counts = np.random.default_rng(0).binomial(1000, -np.expm1(-decay(0.9)), (12, 5, 6))
    stack = jl.gates.gate_dataset(counts, 1000, gate_times=TIMES, frequency=80.0)
    found, error = jl.gates.gate_detections(counts, 1000)
    np.testing.assert_array_equal(stack.detections, found)
    np.testing.assert_array_equal(stack.standard_error, error)
    np.testing.assert_array_equal(stack.lifetime, jl.gates.decay_lifetime(found, TIMES))
    assert stack.detections.dims == ("H", "Y", "X")
    np.testing.assert_array_equal(stack.H, TIMES)
    assert stack.attrs == {"frequency": 80.0}
    with pytest.raises(ValueError, match="expected increasing times"):
        jl.gates.gate_dataset(counts, 1000, gate_times=TIMES[::-1])
    with pytest.raises(ValueError, match=r"expected shape \(G, H, W\)"):
        jl.gates.gate_dataset(counts[0], 1000, gate_times=TIMES)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xarray", None)
    with pytest.raises(MissingExtraError, match=r"jotlight\[lifetime\]"):
        jl.gates.gate_dataset(np.ones((2, 1, 1), int), 4, gate_times=[0.0, 1.0])
