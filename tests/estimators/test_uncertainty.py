import numpy as np
import pytest
from scipy import stats

import jotlight as jl
from jotlight.sensing.likelihood.reference import saturation_intensity
from jotlight.sensing.parameters.response import detection_probability

LIGHT_LEVELS = [0.0, 0.003, 0.05, 0.4, 1.5, 4.0, 9.0]


def coverage(sensor, light, level=0.95):
    """Return the exact probability that the interval contains the truth: a sum over all counts."""
    bits = sensor.trials
    counts = np.arange(bits + 1)
    result = jl.uncertainty(counts[None], sensor, confidence_level=level, method="mle")
    probability = float(
        detection_probability(sensor.threshold, sensor.efficiency * light + sensor.dark_counts)
    )
    truth = np.float32(light * bits / sensor.gain)
    contains = (result.low[0] <= truth) & (truth <= result.high[0])
    return float(stats.binom.pmf(counts, bits, probability)[contains].sum())


@pytest.mark.parametrize(
    "bits", [16, *(pytest.param(bits, marks=pytest.mark.slow) for bits in (1, 2, 5, 64, 256))]
)
@pytest.mark.parametrize("threshold", [1, 2, 5])
@pytest.mark.parametrize(
    "dark", [0.02, *(pytest.param(dark, marks=pytest.mark.slow) for dark in (0.0, 0.5))]
)
def test_the_coverage_reaches_the_confidence_level_at_any_light(bits, threshold, dark):
    sensor = jl.Sensor(
        frames=bits, threshold=threshold, dark_counts=dark, efficiency=0.8, max_intensity=20.0
    )
    for level in (0.5, 0.95, 0.999):
        assert min(coverage(sensor, light, level) for light in LIGHT_LEVELS) >= level - 1e-9


def test_the_coverage_is_close_to_the_confidence_level_with_many_bits():
    sensor = jl.Sensor(frames=256, max_intensity=20.0)
    covered = [coverage(sensor, light) for light in np.linspace(0.3, 2, 30)]
    assert np.mean(covered) < 0.975


def test_the_interval_is_the_exact_binomial_interval():
    counts = np.arange(21)
    result = jl.uncertainty(
        counts[None], jl.Sensor(frames=20, max_intensity=9.0), confidence_level=0.9, method="mle"
    )
    for count in counts:
        exact = stats.binomtest(int(count), 20).proportion_ci(0.9, method="exact")
        assert -np.expm1(-result.low[0, count]) == pytest.approx(exact.low, abs=1e-6)
        if count < 20:
            assert -np.expm1(-result.high[0, count]) == pytest.approx(exact.high, abs=1e-6)


def test_for_a_threshold_of_1_the_standard_error_has_its_closed_form():
    sensor = jl.Sensor(oversampling=2, frames=25, gain=40.0, max_intensity=20.0)
    counts = np.arange(1, 100)[None]
    light = -np.log1p(-counts / 100)
    expected = np.sqrt(np.expm1(light) / 100) * 100 / 40
    result = jl.uncertainty(counts, sensor, method="mle")
    np.testing.assert_allclose(result.standard_error, expected, rtol=1e-6)


@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_with_many_bits_the_standard_error_is_the_spread_of_the_estimates(threshold):
    sensor = jl.Sensor(
        frames=4000, threshold=threshold, dark_counts=0.1, efficiency=0.7, max_intensity=30.0
    )
    probability = float(detection_probability(threshold, 0.7 * 2.0 + 0.1))
    number = 8000
    counts = np.random.default_rng(threshold).binomial(4000, probability, (1, number))
    spread = jl.mle(counts, sensor).std()
    # Four standard errors of a standard deviation: one run in 16,000 fails by chance.
    predicted = np.median(jl.uncertainty(counts, sensor, method="mle").standard_error)
    assert abs(spread / predicted - 1) < 4 / np.sqrt(2 * number) + 0.005


def unequal_jots(rng):
    dark = rng.uniform(0, 0.3, (8, 8)).astype(np.float32)
    efficiency = rng.uniform(0.2, 1, (8, 8)).astype(np.float32)
    mask = rng.random((8, 8)) < 0.2
    mask[:2, :2] = True
    return jl.Sensor(
        oversampling=2, frames=6, dark_counts=dark, efficiency=efficiency, mask=mask,
        max_intensity=6.0,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("threshold", [1, 3])
def test_the_coverage_reaches_the_confidence_level_where_jots_of_a_pixel_differ(threshold):
    sensor = unequal_jots(np.random.default_rng(0)).replace(threshold=threshold)
    covered = np.zeros((4, 4))
    runs = 150
    for light in (0.0, 0.2, 2.0):
        covered[:] = 0
        for seed in range(runs):
            bits = sensor.expose(np.full((4, 4), light), rng=seed)
            result = jl.uncertainty(bits, method="mle", confidence_level=0.9)
            covered += (result.low <= light) & (light <= result.high)
        assert result.dead[0, 0]
        assert result.dead.sum() == 1
        # 15 pixels at the 1e-6 quantile of a binomial with 0.9: one run in 20,000 fails by chance.
        assert covered.min() >= stats.binom.ppf(1e-6, runs, 0.9)


def test_intervals_contain_their_estimate_where_jots_of_a_pixel_differ():
    rng = np.random.default_rng(8)
    sensor = jl.Sensor(
        oversampling=2,
        frames=2,
        gain=16.0,
        dark_counts=rng.uniform(0, 0.6, (128, 128)),
        efficiency=rng.uniform(0.05, 1, (128, 128)),
        mask=rng.random((128, 128)) < 0.02,
    )
    bits = sensor.expose(rng.uniform(0, 1, (64, 64)), rng=9)
    estimate = jl.mle(bits)
    result = jl.uncertainty(bits, confidence_level=0.5, method="mle")
    assert ((result.low <= estimate) & (estimate <= result.high)).all()


def test_jots_that_differ_negligibly_have_the_uncertainty_of_equal_jots():
    rng = np.random.default_rng(1)
    dark = np.full((8, 8), 0.1, np.float32)
    dark[::2] += np.float32(1e-6)
    bits = jl.Bits.from_array(rng.random((20, 8, 8)) < 0.4)
    options = {"oversampling": 2, "frames": 20, "max_intensity": 4.0}
    one = jl.uncertainty(bits, jl.Sensor(dark_counts=dark, **options), method="mle")
    other = jl.uncertainty(bits, jl.Sensor(dark_counts=0.1, **options), method="mle")
    for name in ("standard_error", "low", "high"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=2e-5)


def test_flags_mark_unlit_saturated_and_dead_pixels():
    mask = np.array([[False, False, False, True]])
    sensor = jl.Sensor(frames=10, dark_counts=0.2, mask=mask, max_intensity=3.0)
    result = jl.uncertainty(np.array([[2, 7, 10, 0]]), sensor, method="mle")
    assert result.flags().tolist() == [[1, 0, 2, 4]]
    assert result.low[0, 0] == 0
    assert result.high[0, 2] == 3
    assert (result.low[0, 3], result.high[0, 3]) == (0, 3)
    assert np.isinf(result.standard_error[0, 3])
    assert np.isfinite(result.standard_error[0, :3]).all()


@pytest.mark.filterwarnings("ignore:.*brighter than the largest intensity")
def test_bits_that_tell_nothing_have_an_infinite_standard_error():
    result = jl.uncertainty(
        np.array([[0, 6, 12]]), jl.Sensor(frames=12, gain=1e-6, threshold=16), method="mle"
    )
    assert np.isinf(result.standard_error).all()
    assert (result.low.tolist(), result.high.tolist()) == ([[0, 1, 1]], [[1, 1, 1]])


def test_the_units_are_those_of_estimates():
    sensor = jl.Sensor(frames=9, gain=18.0, exposure_time=1e-3)
    counts = np.array([[0, 4, 9]])
    intensity = jl.uncertainty(counts, sensor, method="mle").arrays()
    for units, scale in (("photons", 2), ("photons-per-second", 2000)):
        found = jl.uncertainty(counts, sensor, units=units, method="mle").arrays()
        for name in ("standard_error", "low", "high"):
            np.testing.assert_allclose(found[name], scale * intensity[name], rtol=1e-6)
    with pytest.raises(ValueError, match="units: expected one of intensity, photons"):
        jl.uncertainty(counts, sensor, units="lux", method="mle")


def test_color_channels_are_independent():
    sensor = jl.Sensor(frames=9)
    counts = np.random.default_rng(0).integers(0, 10, (3, 4, 3))
    result = jl.uncertainty(counts, sensor, channel_axis=-1, method="mle")
    one = jl.uncertainty(counts[..., 1], sensor, method="mle")
    assert (result.low[..., 1] == one.low).all()
    assert result.flags().shape == (3, 4, 3)
    bits = sensor.expose(np.full((3, 4, 3), 0.5), rng=0, channel_axis=-1)
    of_counts = jl.uncertainty(bits.counts(), sensor, channel_axis=-1, method="mle")
    assert (jl.uncertainty(bits, sensor, method="mle").high == of_counts.high).all()


@pytest.mark.parametrize("level", [0.4, 1.0, float("nan")])
def test_a_confidence_level_out_of_range_is_refused(level):
    with pytest.raises(ValueError, match=r"0\.5 to below 1"):
        jl.uncertainty(np.zeros((1, 1), int), jl.Sensor(), confidence_level=level, method="mle")


def test_counts_are_refused_where_jots_of_a_pixel_differ():
    with pytest.raises(ValueError, match="expected bits, because"):
        jl.uncertainty(
            np.zeros((1, 1), int),
            jl.Sensor(oversampling=2, dark_counts=np.array([[0.0, 0.1], [0.0, 0.0]])),
            method="mle",
        )


@pytest.mark.parametrize("options", [{}, {"threshold": 3}, {"dark_counts": 0.3, "gain": 2.0}])
def test_the_saturation_intensity_clips_only_saturated_pixels(options):
    sensor = jl.Sensor(frames=50, **options)
    sensor = sensor.replace(max_intensity=saturation_intensity(sensor))
    estimates = jl.mle(np.array([[48, 49, 50]]), sensor)[0]
    assert estimates[0] < estimates[1] < estimates[2] == np.float32(sensor.max_intensity)


@pytest.mark.parametrize("dark", [0.0, 0.5])
def test_a_largest_intensity_far_above_the_scene_changes_no_interval_of_unequal_jots(dark):
    rng = np.random.default_rng(0)
    efficiency = rng.uniform(0.05, 1, (8, 8))
    sensor = jl.Sensor(
        oversampling=2, frames=12, max_intensity=9.0, efficiency=efficiency, dark_counts=dark
    )
    bits = sensor.expose(np.full((4, 4), 0.7), rng=0)
    expected, found = (
        jl.uncertainty(bits, sensor.replace(max_intensity=largest), method="mle")
        for largest in (9.0, 1e18)
    )
    assert expected.high.max() < 9
    np.testing.assert_allclose(found.low, expected.low, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found.high, expected.high, rtol=1e-5)


def test_an_uncertainty_is_no_single_array():
    result = jl.uncertainty(np.ones((2, 3), int), jl.Sensor(frames=4))
    with pytest.raises(TypeError, match=r"got Uncertainty; .* such as uncertainty\.standard_error"):
        np.asarray(result)
