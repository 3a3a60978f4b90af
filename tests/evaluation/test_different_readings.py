"""Methods on readings that differ, through equivalent counts."""

import numpy as np
import pytest

import jotlight as jl
import jotlight.evaluation.uncertainty as intervals
from jotlight.datasets import photograph
from jotlight.estimators.merge_readings import merge_joint
from jotlight.estimators.readings.merge_near import Merging
from jotlight.evaluation.choice import choose_method
from jotlight.evaluation.intervals.widened_intervals import widen_intervals
from jotlight.sensing.likelihood.joint_likelihood import joint_likelihood
from jotlight.sensing.likelihood.reference import saturation_intensity

BRACKET = jl.Sensor(frames=48, gain=np.repeat([1 / 32, 1 / 4, 2.0], 16), max_intensity=60.0)


def wide_scene(side=128):
    """A photograph whose light rises by a factor of 900 from left to right."""
    step = 512 // side
    image = photograph("camera").astype(np.float64)[::step, ::step]
    return np.maximum(image, 0.02) * np.geomspace(1 / 30, 30, side)


def error(estimate, truth):
    """The root mean square of the error of the logarithm."""
    return float(np.sqrt(np.mean(np.log(np.maximum(estimate, 1e-3) / truth) ** 2)))


@pytest.fixture(scope="module")
def captured():
    truth = wide_scene()
    return truth, BRACKET.expose(truth, rng=0)


def test_a_network_reconstructs_the_whole_range_of_a_bracket(captured):
    truth, bits = captured
    estimate, info = jl.reconstruct(bits, quality="small", return_info=True)
    assert info.method == "network-small"
    assert error(estimate, truth) < 0.4 * error(jl.mle(bits), truth)
    single = BRACKET.replace(gain=BRACKET.gain.sum())
    of_one = jl.reconstruct(single.expose(truth, rng=0), quality="small")
    # With the same light in equal exposures, only the dark part is as good.
    assert error(estimate[:, 112:], truth[:, 112:]) < 0.5 * error(of_one[:, 112:], truth[:, 112:])


@pytest.mark.slow
def test_networks_get_better_counts_than_those_of_merge_readings(captured):
    truth, bits = captured
    direct = jl.reconstruct(bits, quality="small")
    network = jl.pretrained(BRACKET, "small")
    np.testing.assert_array_equal(jl.reconstruct(bits, method=network), direct)
    merged = network.reconstruct(jl.merge_readings(bits))
    assert error(direct, truth) < error(merged, truth)


def test_networks_warn_once_about_dead_pixels_of_readings():
    sensor = jl.Sensor(frames=4, gain=12.0, bit_depth=4, mask=np.eye(24, dtype=bool))
    readings = sensor.expose(np.full((24, 24), 0.5), rng=0)
    for run in (jl.reconstruct, jl.uncertainty):
        with pytest.warns(jl.JotlightWarning) as caught:
            run(readings)
        assert [str(each.message).split(" ")[0] for each in caught] == ["24"]


@pytest.mark.parametrize(("frames", "photons", "largest"), [(1, 12.0, 0.08), (8, 18.0, 0.16)])
def test_mostly_saturated_readings_of_two_bits_are_hardly_too_dark(frames, photons, largest):
    # About half of the pixels have only the largest readings. The likelihood of 8 of them is nearly
    # the same from 11 to 18 photons.
    truth = photograph("camera")[100:356:2, 100:356:2].astype(np.float64)
    sensor = jl.Sensor(frames=frames, gain=frames * photons, bit_depth=2)
    estimate = jl.reconstruct(sensor.expose(truth, rng=0))
    assert estimate.mean() == pytest.approx(truth.mean(), rel=largest)


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0]),
        pytest.param(jl.Sensor(frames=3, gain=[0.5, 2.0, 8.0]), marks=pytest.mark.slow),
        jl.Sensor(bit_depth=2, gain=6.0),
        pytest.param(jl.Sensor(frames=4, gain=8.0, threshold=[1, 1, 1, 5]), marks=pytest.mark.slow),
        pytest.param(
            jl.Sensor(frames=4, gain=4.0, bit_depth=2, read_noise=0.3), marks=pytest.mark.slow
        ),
    ],
    ids=repr,
)
def test_the_default_has_no_bias_for_a_few_readings(sensor):
    truth = photograph("camera")[100:356:2, 100:356:2].astype(np.float64)
    bits = sensor.expose(truth, rng=0)
    estimate = jl.reconstruct(bits)
    assert estimate.mean() == pytest.approx(truth.mean(), rel=0.03)
    classical = jl.reconstruct(bits, method="admm-tv")
    assert jl.metrics.psnr(estimate, truth) > jl.metrics.psnr(classical, truth) + 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "method"),
    [
        (jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0]), "noniterative-tv"),
        (jl.Sensor(frames=2, gain=3.0, threshold=[1, 2]), "noniterative-gaussian"),
        (jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0]), "admm-tv"),
    ],
    ids=repr,
)
def test_classical_methods_have_no_bias_for_a_few_readings(sensor, method):
    truth = photograph("camera")[100:356:2, 100:356:2].astype(np.float64)
    bits = sensor.expose(truth, rng=0)
    estimate = jl.reconstruct(bits, method=method)
    if method != "admm-tv":  # its prior darkens images
        assert estimate.mean() == pytest.approx(truth.mean(), rel=0.05)
    # Counts at the maximum of each pixel make them worse.
    before = jl.reconstruct(jl.merge_readings(bits), method=method)
    assert jl.metrics.psnr(estimate, truth) > jl.metrics.psnr(before, truth) + 0.9


@pytest.mark.slow
def test_the_interval_of_a_network_covers_the_range(captured):
    truth, bits = captured
    result = jl.uncertainty(bits, quality="small")
    contains = (result.low <= truth) & (truth <= result.high)
    assert 0.9 < contains.mean() < 0.995
    for part in np.array_split(contains, 4, axis=1):
        assert part.mean() > 0.85
    estimate = jl.reconstruct(bits, quality="small")
    known = jl.uncertainty(bits, quality="small", estimate=estimate)
    np.testing.assert_array_equal(known.low, result.low)


def test_mle_and_functions_of_the_caller_get_the_bits(captured):
    _, bits = captured
    estimate, info = jl.reconstruct(bits, method="mle", return_info=True)
    np.testing.assert_array_equal(estimate, jl.mle(bits))
    assert info.method == "mle"
    seen = []

    def mean(data, sensor):
        seen.append(sensor)
        return data.counts() / 48

    jl.reconstruct(bits, method=mean)
    assert seen == [BRACKET]


def test_the_choice_of_a_network_is_one_for_any_number_of_trials():
    sensor = jl.Sensor(frames=16, gain=np.repeat([0.5, 1.5], 8))
    assert choose_method(sensor).method == "network-medium"
    assert jl.pretrained(sensor, "small").trials_range is not None
    # Their reference sensor is that of a network for one K, which takes no other trials.
    bits = sensor.replace(gain=np.repeat([1.0, 8.0], 8)).expose(np.full((16, 16), 0.5), rng=0)
    assert jl.reconstruct(bits, quality="small").shape == (16, 16)


def test_the_saturation_is_that_of_the_least_sensitive_readings():
    least = jl.Sensor(frames=16, gain=16 / 32)
    assert saturation_intensity(BRACKET) == pytest.approx(saturation_intensity(least))


def merge_near_neighbors(joint):
    return Merging(joint).near_neighbors()


@pytest.mark.parametrize(
    ("method", "merge"),
    [
        pytest.param("noniterative-tv", merge_near_neighbors, marks=pytest.mark.slow),
        ("network-initial", merge_near_neighbors),
        ("mle-iterative", merge_joint),
    ],
)
def test_other_methods_run_on_equivalent_counts(method, merge):
    bits = BRACKET.expose(wide_scene(32), rng=0)
    merged = merge(joint_likelihood(bits, BRACKET, None))
    estimate = jl.reconstruct(bits, method=method)
    np.testing.assert_array_equal(estimate, jl.reconstruct(merged, method=method))
    of_counts = jl.uncertainty(merged, method=method)
    expected = widen_intervals(of_counts, estimate, BRACKET)
    np.testing.assert_array_equal(jl.uncertainty(bits, method=method).low, expected.low)


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(
            frames=6, gain=18.0, dark_counts=0.02, bit_depth=4, read_noise=0.3, max_intensity=4.0
        ),
        jl.Sensor(
            frames=6,
            gain=[0.1, 0.1, 1.0, 1.0, 8.0, 8.0],
            dark_counts=0.1,
            read_noise=0.25,
            max_intensity=40.0,
        ),
    ],
    ids=["one gain", "bracket"],
)
def test_iterative_maximum_likelihood_of_dark_noisy_readings_is_that_of_all_readings(sensor):
    # The equivalent counts of some of these pixels have less than half a one.
    readings = sensor.expose(np.full((64, 64), 0.02), rng=1)
    found = jl.reconstruct(readings, method="mle-iterative")
    np.testing.assert_allclose(found, jl.mle(readings), atol=1e-6, rtol=1e-5)


def test_a_network_for_one_number_of_trials_refuses_and_says_what_to_do(captured):
    network = jl.Network.initial(jl.Sensor(frames=16))
    with pytest.raises(ValueError, match=r"sensor: .*pass the data to jotlight.reconstruct"):
        jl.reconstruct(captured[1], method=network)


@pytest.mark.slow
def test_many_readings_are_blended_on_held_out_bits():
    truth = wide_scene()
    sensor = jl.Sensor(frames=1200, gain=np.repeat([1 / 32, 1 / 4, 2.0], 400), max_intensity=60.0)
    bits = sensor.expose(truth, rng=0)
    estimate, info = jl.reconstruct(bits, return_info=True)
    assert info.method == "held-out"
    assert sum(info.shares.values()) == pytest.approx(1)
    by_mle = jl.mle(bits)
    assert error(estimate, truth) < 0.75 * error(by_mle, truth)
    for part in np.array_split(np.argsort(truth, axis=None), 8):
        own = truth.flat[part]
        assert error(estimate.flat[part], own) < error(by_mle.flat[part], own)


@pytest.mark.slow
def test_networks_serve_maps_whose_neighbors_say_very_different_amounts():
    truth = jl.datasets.photograph("camera")[::4, ::4].astype(float)
    board = np.where(np.indices(truth.shape).sum(axis=0) % 2, 1, 8)
    sensor = jl.Sensor(frames=16, gain=16 * 8, threshold=board)
    bits = sensor.expose(truth, rng=0)
    network = jl.metrics.psnr(truth, jl.reconstruct(bits))
    classical = jl.metrics.psnr(truth, jl.reconstruct(bits, method="admm-tv"))
    assert network > classical > 20


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sensor", "bias"),
    [
        (jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0], mosaic="RGGB"), 0.05),
        (jl.Sensor(bit_depth=2, gain=6.0, mosaic="RGGB"), 0.12),
    ],
    ids=repr,
)
def test_a_few_readings_behind_a_mosaic_have_little_bias(sensor, bias):
    truth = photograph("astronaut", gray=False)[100:228, 100:228].astype(np.float64)
    estimate = jl.reconstruct(sensor.expose(truth, rng=0))
    # With counts at the most likely intensities, the means are 0.26 and 0.5 too large.
    assert estimate.mean() == pytest.approx(truth.mean(), rel=bias)


@pytest.mark.slow
def test_three_channels_of_a_few_readings_have_no_bias():
    truth = photograph("astronaut", gray=False)[100:228, 100:228].astype(np.float64)
    sensor = jl.Sensor(frames=4, gain=[1.0, 2.0, 3.0, 4.0])
    estimate = jl.reconstruct(sensor.expose(truth, rng=0, channel_axis=-1))
    assert estimate.mean() == pytest.approx(truth.mean(), rel=0.02)


def test_mostly_saturated_readings_have_little_bias():
    truth = photograph("camera")[100:356:2, 100:356:2].astype(np.float64)
    sensor = jl.Sensor(frames=8, gain=96.0, bit_depth=2)
    estimate = jl.reconstruct(sensor.expose(truth, rng=0))
    assert estimate.mean() == pytest.approx(truth.mean(), rel=0.04)


@pytest.mark.parametrize("gains", [[1.0, 1e6], [1e-6, 1e6], [1e-12, 1e12]], ids=repr)
def test_exposures_of_any_range_find_darkness(gains):
    sensor = jl.Sensor(frames=2, gain=gains)
    bits = sensor.expose(np.zeros((16, 16)), rng=0)
    # The most sensitive readings see less than a photon.
    assert (jl.reconstruct(bits) * gains[1]).max() < 0.1


@pytest.mark.parametrize("gains", [[1.0, 1e6], [1e-6, 1e6]], ids=repr)
def test_exposures_of_a_wide_range_find_dim_light(gains):
    sensor = jl.Sensor(frames=2, gain=gains)
    bits = sensor.expose(np.full((64, 64), 1e-6), rng=0)
    assert jl.reconstruct(bits).mean() == pytest.approx(1e-6, rel=0.1)


@pytest.mark.parametrize("channels", [(), (3,)])
def test_intervals_of_many_readings_are_not_those_of_a_network_alone(monkeypatch, channels):
    # Four readings of 8 bits say as much as thousands of trials. Their reference sensor has four.
    sensor = jl.Sensor(frames=4, bit_depth=8, gain=800.0)
    image = np.full((16, 16, *channels), 0.4, np.float32)
    readings = sensor.expose(image, rng=0, channel_axis=-1 if channels else None)
    _, info = jl.reconstruct(readings, return_info=True)
    assert info.method == "held-out"
    find, found = intervals.find_intervals, []

    def note(*arguments, is_own, **options):
        found.append(is_own)
        return find(*arguments, is_own=is_own, **options)

    monkeypatch.setattr(intervals, "find_intervals", note)
    jl.uncertainty(readings, estimate=image)
    assert found == [False]


@pytest.mark.parametrize(
    "options",
    [{"gain": np.tile([1.0, 8.0], 8)}, {"bit_depth": 3, "gain": 160.0}, {"read_noise": 0.2}],
)
def test_intervals_of_saturated_readings_end_at_the_largest_intensity(options):
    sensor = jl.Sensor(frames=16, max_intensity=60.0, **options)
    image = np.full((24, 24), 0.05)
    image[:, 12:] = 50
    found = jl.uncertainty(sensor.expose(image, rng=0))
    assert found.saturated[:, 12:].all()
    assert not found.saturated[:, :12].any()
    assert (found.high[:, 13:] == 60).all()
    assert found.high[:, :11].max() < 10


@pytest.mark.slow
def test_a_large_largest_intensity_does_not_spoil_the_estimate():
    # Saturated readings agree with any bright light, so held-out ones must not prefer S.
    image = 0.2 + 1.6 * jl.datasets.photograph("camera", gray=True)[::2, ::2][32:160, 32:160]
    sensor = jl.Sensor(frames=16, gain=320.0, threshold=[19, 21] * 8, max_intensity=10.0)
    bits = sensor.expose(image, rng=0)
    for method in ("held-out", None):
        estimate = jl.reconstruct(bits, method=method)
        assert 10 * np.log10(1.6**2 / np.mean((estimate - image) ** 2)) > 22
