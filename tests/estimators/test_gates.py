"""Gate stacks: exact inversion of pile-up, lifetimes, and data sets."""

import numpy as np
import pytest
from scipy import optimize, stats

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


def lifetime_of_maximum(log_likelihood):
    """Return the lifetime at the maximum of a function of the light of each gate, by SciPy."""

    def cost(point):
        return -log_likelihood(np.exp(point[0] - TIMES / np.exp(point[1])))

    options = {"xatol": 1e-9, "fatol": 1e-9, "maxiter": 2000}
    found = optimize.minimize(cost, [-1.0, 0.5], method="Nelder-Mead", options=options)
    return np.exp(found.x[1])


@pytest.mark.parametrize(("cycles", "dark"), [(100, 0.0), (100, 0.02), (30, 0.1)])
def test_lifetimes_maximize_the_binomial_likelihood(cycles, dark):
    expected = np.broadcast_to(decay(0.9)[..., 0], (12, 4))
    counts = np.random.default_rng(1).binomial(cycles, -np.expm1(-expected - dark))
    found = jl.gates.decay_lifetime(counts, TIMES, trials=cycles, dark_counts=dark)
    for ones, lifetime in zip(counts.T, found, strict=True):
        oracle = lifetime_of_maximum(
            lambda light, ones=ones: stats.binom.logpmf(
                ones, cycles, -np.expm1(-light - dark)
            ).sum()
        )
        assert lifetime == pytest.approx(oracle, rel=1e-5)


def first_photon_chances(expected):
    """Return the probability that a cycle ends in each gate, and that it has no photon."""
    before = np.exp(-np.concatenate([[0], expected.cumsum()]))
    return np.append(-np.diff(before), before[-1])


def test_lifetimes_of_first_photons_maximize_the_multinomial_likelihood():
    cycles, dark = 300, 0.01
    chances = first_photon_chances(decay(0.8)[:, 0, 0] + dark)
    drawn = np.random.default_rng(2).multinomial(cycles, chances, size=4)
    found = jl.gates.decay_lifetime(
        drawn[:, :-1].T, TIMES, trials=cycles, first_photon=True, dark_counts=dark
    )
    for ones, lifetime in zip(drawn, found, strict=True):
        oracle = lifetime_of_maximum(
            lambda light, ones=ones: stats.multinomial.logpmf(
                ones, cycles, first_photon_chances(light + dark)
            )
        )
        assert lifetime == pytest.approx(oracle, rel=1e-5)


def test_lifetimes_of_photons_maximize_the_poisson_likelihood():
    photons = np.random.default_rng(3).poisson(np.broadcast_to(decay(8.0)[..., 0], (12, 4)))
    found = jl.gates.decay_lifetime(photons, TIMES)
    for drawn, lifetime in zip(photons.T, found, strict=True):
        oracle = lifetime_of_maximum(
            lambda light, drawn=drawn: stats.poisson.logpmf(drawn, light).sum()
        )
        assert lifetime == pytest.approx(oracle, rel=1e-5)
    # The unit of the detections does not matter, and gates without a number are left out.
    np.testing.assert_allclose(jl.gates.decay_lifetime(photons / 1e5, TIMES), found, rtol=1e-6)
    lacking = photons.astype(float)
    lacking[0], lacking[7] = np.inf, np.nan
    rest = np.delete(np.arange(12), [0, 7])
    expected = jl.gates.decay_lifetime(photons[rest], TIMES[rest])
    np.testing.assert_allclose(jl.gates.decay_lifetime(lacking, TIMES), expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("light", "cycles", "dark", "first_photon"),
    [(0.2, 100, 0.0, False), (0.2, 100, 0.02, False), (0.8, 2000, 0.02, True), (1.2, 30, 0, False)],
)
def test_lifetimes_of_few_readings_have_little_bias(light, cycles, dark, first_photon):
    rng, expected = np.random.default_rng(4), decay(light)[:, 0, 0] + dark
    if first_photon:
        counts = rng.multinomial(cycles, first_photon_chances(expected), size=4000)[:, :-1].T
    else:
        counts = rng.binomial(cycles, -np.expm1(-expected)[:, None], (12, 4000))
    options = {"first_photon": first_photon, "dark_counts": dark}
    found = jl.gates.decay_lifetime(counts, TIMES, trials=cycles, **options)
    # The standard error of the median is below 0.01. Weights of the detections are off by 0.06
    # to 0.65 here.
    assert np.median(found) == pytest.approx(LIFETIME, abs=0.04)


def test_lifetimes_without_a_finite_maximum_are_nan():
    # All ones in the first gate and none later, only ones, one gate with ones, none, and a rise.
    counts = np.array([[5, 0, 0], [5, 5, 5], [0, 3, 0], [0, 0, 0], [1, 2, 3], [5, 5, 0]]).T
    found = jl.gates.decay_lifetime(counts, np.arange(3.0), trials=5)
    assert np.isnan(found).all()
    # Dark counts explain all ones.
    assert np.isnan(jl.gates.decay_lifetime([2, 3, 1], np.arange(3.0), trials=9, dark_counts=9.0))


def test_dark_counts_saturation_and_gates_without_cycles():
    counts = np.array([[3, 10], [0, 0], [7, 0]])
    found, _ = jl.gates.gate_detections(counts, 10, first_photon=True, dark_counts=0.1)
    assert found[0, 0] == pytest.approx(-np.log(0.7) - 0.1)
    assert found[0, 1] == np.inf
    assert found[1, 0] == -0.1
    assert np.isnan(found[1, 1])
    assert found[2, 0] == np.inf
    lifetime = jl.gates.decay_lifetime(found, np.arange(3.0))
    assert np.isnan(lifetime).all()
    rising = jl.gates.decay_lifetime([[1.0], [2.0]], [0.0, 1.0])
    assert np.isnan(rising).all()


def test_averages_of_detections_over_dark_counts_have_no_bias():
    times, dark = np.arange(50) * 0.25, 0.02
    light = 0.2 * np.exp(-times / 2)
    chances = -np.expm1(-light - dark)[:, None]
    counts = np.random.default_rng(0).binomial(200, chances, (50, 4096))
    found, error = jl.gates.gate_detections(counts, 200, dark_counts=dark)
    assert found.min() == -dark
    # The bias of -log(1 - L/n) itself is about λ/2n. Detections cut off at 0 are off by 0.0036.
    noise = 4 * error.mean(axis=1) / np.sqrt(4096)
    assert (np.abs(found.mean(axis=1) - light) < noise + (light + dark) / 200).all()
    assert jl.gates.decay_lifetime(found.mean(axis=1), times) == pytest.approx(2, rel=0.01)
    assert np.median(jl.gates.decay_lifetime(found, times)) == pytest.approx(2, rel=0.01)


def test_lifetimes_of_negative_detections_have_their_sum_and_their_mean_time():
    detections, times = np.random.default_rng(5).normal(size=(6, 2000)), np.arange(6.0)
    detections[0, ::2] = np.nan
    found = jl.gates.decay_lifetime(detections, times)
    for column, lifetime in zip(detections.T, found, strict=True):
        own = times[np.isfinite(column)]
        usable = column[np.isfinite(column)]
        center = usable @ own / usable.sum()
        decays = usable.sum() > 0 and own[0] < center < own.mean()
        assert np.isfinite(lifetime) == decays
        if decays:
            light = np.exp(-own / lifetime)
            assert light @ own / light.sum() == pytest.approx(center, abs=1e-6)


@pytest.mark.parametrize("values", [[3, -2], [-3, -2], [3, -3], [1, 2, -3], [-1, 3, 2], [3, 2, -1]])
def test_negative_detections_without_a_decay_have_no_lifetime(values):
    assert np.isnan(jl.gates.decay_lifetime(values, np.arange(len(values))))


def test_single_bits_are_counts_of_one_reading():
    bits = jl.Sensor(frames=12).expose(np.full((3, 4), 0.8), rng=0)
    ones = np.asarray(bits).astype(int)
    for one_bit in (bits, np.asarray(bits)):
        for each, expected in zip(
            jl.gates.gate_detections(one_bit, 1), jl.gates.gate_detections(ones, 1), strict=True
        ):
            np.testing.assert_array_equal(each, expected)
        np.testing.assert_array_equal(
            jl.gates.decay_lifetime(one_bit, TIMES, trials=1),
            jl.gates.decay_lifetime(ones, TIMES, trials=1),
        )


def test_lifetimes_over_a_map_of_dark_counts_have_no_bias():
    dark = np.random.default_rng(1).gamma(0.5, 0.1, (60, 60))
    counts = np.random.default_rng(0).binomial(1000, -np.expm1(-decay(0.5) - dark))
    found = jl.gates.decay_lifetime(counts, TIMES, trials=1000, dark_counts=dark)
    assert np.median(found) == pytest.approx(LIFETIME, abs=0.02)
    mean = jl.gates.decay_lifetime(counts, TIMES, trials=1000, dark_counts=dark.mean())
    assert np.nanmedian(mean) != pytest.approx(LIFETIME, abs=0.1)


def test_data_sets_hold_all_results():
    pytest.importorskip("xarray")
    counts = np.random.default_rng(0).binomial(1000, -np.expm1(-decay(0.9)), (12, 5, 6))
    stack = jl.gates.gate_dataset(counts, 1000, gate_times=TIMES, frequency=80.0)
    found, error = jl.gates.gate_detections(counts, 1000)
    np.testing.assert_array_equal(stack.detections, found)
    np.testing.assert_array_equal(stack.standard_error, error)
    lifetime = jl.gates.decay_lifetime(counts, TIMES, trials=1000)
    np.testing.assert_array_equal(stack.lifetime, lifetime)
    assert {name: each.attrs["units"] for name, each in stack.variables.items()} == {
        "detections": "per gate and reading",
        "standard_error": "per gate and reading",
        "counts": "1",
        "lifetime": "ns",
        "H": "ns",
    }
    assert stack.detections.dims == ("H", "Y", "X")
    np.testing.assert_array_equal(stack.H, TIMES)
    assert stack.attrs == {"frequency": 80.0}
    # Programs for phasors take the array alone.
    assert stack.detections.attrs["frequency"] == 80.0
    assert not np.shares_memory(stack.counts, counts)
    np.testing.assert_array_equal(stack.counts, counts)
    unknown = jl.gates.gate_dataset(counts, 1000, gate_times=TIMES)
    assert "frequency" not in unknown.attrs | unknown.detections.attrs
    with pytest.raises(ValueError, match="expected finite, increasing times"):
        jl.gates.gate_dataset(counts, 1000, gate_times=TIMES[::-1])
    with pytest.raises(ValueError, match=r"expected shape \(G, H, W\)"):
        jl.gates.gate_dataset(counts[0], 1000, gate_times=TIMES)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xarray", None)
    with pytest.raises(MissingExtraError, match=r"jotlight\[lifetime\]"):
        jl.gates.gate_dataset(np.ones((2, 1, 1), int), 4, gate_times=[0.0, 1.0])
