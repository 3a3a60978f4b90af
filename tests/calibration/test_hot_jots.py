"""Hot jots of a scene: exact probabilities, photographs, stars, and bad input."""

import re

import numpy as np
import pytest
from scipy.special import gammainc, gammaincinv
from scipy.stats import beta, binom

import jotlight as jl
from jotlight.calibration import find_hot_jots
from jotlight.calibration.hot_jots import fewest_trials, hot_jots_of, hot_jots_unknown_reason
from jotlight.datasets import photograph


def expose(light, frames, seed=0):
    return np.random.default_rng(seed).binomial(frames, -np.expm1(-light)).astype(np.int32)


@pytest.mark.slow
def test_the_smallest_hot_count_follows_from_the_binomial_distribution():
    for around, frames, rate in ((0, 100, 1e-6), (3, 100, 1e-3), (40, 2000, 1e-6)):
        limit = beta.ppf(1 - rate / 2, 8 * around + 1, 8 * (frames - around))
        factor = 1.5 if around else 4  # a contrast with 0 is unlimited
        highest = 1 - (1 - limit) ** factor
        counts = np.full((9, 9), around)
        for count in range(frames + 1):
            counts[4, 4] = count
            found = find_hot_jots(counts, trials=frames, false_positive_rate=rate)
            light = -np.log1p(-np.array([min(count, frames - 0.5), around]) / frames)
            expected = (
                binom.sf(count - 1, frames, highest) <= rate / 2 and light[0] > factor * light[1]
            )
            assert found[4, 4] == expected, (around, count)
            assert found.sum() == found[4, 4]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frames", "threshold"),
    [(200, 1), (200, 3), (2000, 1), (2000, 3)],
)
def test_hot_jots_of_a_photograph_are_found_and_nothing_else(frames, threshold):
    rng = np.random.default_rng(0)
    image = photograph("camera")[::2, ::2]
    dark = np.where(rng.random(image.shape) < 0.003, 3.0, 0.0)
    sensor = jl.Sensor(
        frames=frames, gain=0.4 * frames * threshold, dark_counts=dark, threshold=threshold
    )
    found = find_hot_jots(sensor.expose(image, rng=0), threshold=threshold)
    assert not (found & (dark == 0)).any()
    strong = (dark > 0) & (image < 0.5)
    assert (found & strong).sum() > 0.7 * strong.sum()
    clean = sensor.replace(dark_counts=0).expose(image, rng=0)
    assert not find_hot_jots(clean, threshold=threshold).any()


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.65, 0.8, 1.5])
def test_stars_are_not_hot(sigma):
    rng = np.random.default_rng(0)
    rows, columns = np.indices((200, 200))
    light = np.full((200, 200), 1e-4)
    for row, column in rng.uniform(0, 199, (300, 2)):
        distance = (rows - row) ** 2 + (columns - column) ** 2
        light += rng.uniform(0.1, 2) * np.exp(-distance / (2 * sigma**2))
    assert not find_hot_jots(expose(light, 10**6), trials=10**6).any()


def test_lines_and_pairs():
    light = np.full((40, 40), 0.01)
    light[10, :] = light[:, 30] = 1.0
    assert not find_hot_jots(expose(light, 1000), trials=1000).any()
    light[25, 5:7] = 1.0
    found = find_hot_jots(expose(light, 1000), trials=1000)
    assert np.argwhere(found).tolist() == [[25, 5], [25, 6]]


def test_corners_edges_dead_jots_and_saturated_jots():
    light = np.full((20, 20), 0.01)
    mask = np.zeros((20, 20), bool)
    hot = [(0, 0), (0, 7), (19, 19), (10, 10), (10, 12)]
    for place in hot:
        light[place] = 50.0
    light[10, 11] = 5.0
    mask[10, 11] = True
    counts = expose(light, 500)
    found = find_hot_jots(counts, trials=500, mask=mask)
    assert [tuple(place) for place in np.argwhere(found)] == sorted(hot)
    assert not find_hot_jots(np.full((20, 20), 500), trials=500).any()
    alone = np.ones((1, 1), int)
    assert not find_hot_jots(alone, trials=1).any()


def test_a_jot_that_is_hot_in_one_color_is_hot():
    light = np.full((20, 20, 3), 0.01)
    light[5, 6, 1] = 1.0
    frames = np.random.default_rng(0).random((500, *light.shape)) < light
    assert np.argwhere(find_hot_jots(jl.Bits.from_array(frames))).tolist() == [[5, 6]]
    found = find_hot_jots(frames.sum(0), trials=500, channel_axis=-1)
    assert np.argwhere(found).tolist() == [[5, 6]]


@pytest.mark.parametrize(
    ("shape", "message"), [((9, 8, 4), "looks like color"), ((3, 9, 8), "expected one image")]
)
def test_counts_of_color_need_their_axis_and_stacks_are_refused(shape, message):
    with pytest.raises(ValueError, match=message):
        find_hot_jots(np.zeros(shape, int), trials=9)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({}, TypeError, "trials: expected the number of binary readings"),
        ({"trials": 4}, ValueError, "counts: expected at most 4 trials, got 5"),
        ({"trials": 0}, ValueError, "trials: expected at least 1"),
        ({"trials": 9, "false_positive_rate": 0.5}, ValueError, r"a number in \(0, 0.01\]"),
        ({"trials": 9, "false_positive_rate": "0"}, ValueError, r"in \(0, 0.01\], got '0'"),
        (
            {"trials": 9, "mask": np.zeros((3, 4), bool)},
            ValueError,
            r"mask: expected bool of shape",
        ),
        (
            {"trials": 9, "mask": np.zeros((4, 5), int)},
            ValueError,
            r"mask: expected bool of shape \(\d+, \d+\), got int",
        ),
    ],
)
def test_bad_input_is_refused(options, error, message):
    with pytest.raises(error, match=message):
        find_hot_jots(np.full((4, 4), 5), **options)


def test_weak_hot_jots_are_found_where_the_light_is_even():
    light = np.full((40, 40), 0.3)
    light[10, 8] = 1.0
    found = find_hot_jots(expose(light, 5000), trials=5000)
    assert np.argwhere(found).tolist() == [[10, 8]]
    light += 0.6 * (np.indices(light.shape)[0] % 3 == 0)
    assert not find_hot_jots(expose(light, 5000), trials=5000).any()


@pytest.mark.parametrize(("p", "threshold"), [(0.02, 1), (0.2, 1), (0.5, 1), (0.5, 3)])
def test_with_fewer_trials_four_times_the_light_explains_a_jot_that_always_reports_1(p, threshold):
    counts = np.full((9, 9), round(1000 * p))
    fewest = fewest_trials(counts, 1000, threshold=threshold)
    explained = gammainc(threshold, 4 * gammaincinv(threshold, p))
    assert explained**fewest <= 0.5e-6 < explained ** (fewest - 1)


def test_bits_use_the_threshold_and_the_mask_of_their_sensor():
    mask = np.zeros((16, 16), bool)
    mask[3, 4] = True
    dark_counts = np.where(np.arange(256).reshape(16, 16) == 200, 5.0, 0.0)
    dark_counts[3, 5] = 5.0
    sensor = jl.Sensor(frames=400, threshold=2, dark_counts=dark_counts, mask=mask)
    bits = sensor.expose(np.full((16, 16), 0.5), rng=0)
    found = find_hot_jots(bits)
    np.testing.assert_array_equal(found, find_hot_jots(bits, threshold=2, mask=mask))
    assert found.flat[200]
    assert not found[3, 4]


def test_where_all_jots_are_saturated_no_number_of_trials_suffices():
    assert fewest_trials(np.full((9, 9), 10**6), 10**6) > 10**7
    assert fewest_trials(np.zeros((9, 9), int), 100) == 1


BITS = jl.Bits.from_array(np.zeros((4, 8, 8), bool))


@pytest.mark.parametrize(
    ("data", "options", "reason"),
    [
        (BITS, {"threshold": [1, 2, 1, 2]}, "expected one threshold, .* got several; .*--mask"),
        (BITS, {"mosaic": "RGGB"}, "expected a gray sensor, .* different filters .*'RGGB'"),
        (None, {"bit_depth": 4, "oversampling": 2}, "expected single bits, .* of 4 bits; .*--mask"),
        (None, {"oversampling": 2}, "expected bits, .* counts of pixels of 2 x 2 jots"),
    ],
)
def test_why_hot_jots_cannot_be_searched(data, options, reason):
    assert re.match(reason, hot_jots_unknown_reason(data, jl.Sensor(frames=4, **options)))


@pytest.mark.parametrize(("data", "side"), [(BITS, 2), (BITS, 1), (None, 1)])
def test_hot_jots_can_be_searched_in_bits_and_in_counts_of_jots(data, side):
    assert hot_jots_unknown_reason(data, jl.Sensor(frames=4, oversampling=side)) is None


@pytest.mark.parametrize("channels", [(), (3,)])
def test_the_hot_jots_of_a_sensor_have_its_threshold_and_its_dead_jots(channels):
    counts = np.full((32, 32, *channels), 400)
    counts[5, 7] = counts[20, 20] = 1500
    mask = np.zeros((32, 32), bool)
    mask[20, 20] = True
    found = hot_jots_of(counts, 2000, jl.Sensor(frames=2000, mask=mask))
    assert np.argwhere(found).tolist() == [[5, 7]]
    # With a threshold of 20, the light of the jot is only 1.4 times that of its neighbors.
    assert not hot_jots_of(counts, 2000, jl.Sensor(frames=2000, threshold=20)).any()
