"""Calibration: what is stated of its errors holds, and what is planted is found."""

import numpy as np
import pytest
from scipy.stats import beta, binom

import jotlight as jl
from flat_captures import SHAPE, counts, flat_scene
from jotlight.calibration import fit_bulk
from jotlight.calibration.dead_jots import MIN_RESPONSE
from jotlight.calibration.jot_counts import JotCounts

MAPS = 12
CLEAN = {
    "one rate, few counts": (lambda rng: np.full(SHAPE, 0.0005), 1000),
    "nearly no counts": (lambda rng: np.full(SHAPE, 1e-6), 200),
    "few counts, rates differ much": (lambda rng: rng.gamma(1, 2e-4, SHAPE), 1000),
    "one rate": (lambda rng: np.full(SHAPE, 0.008), 1000),
    "rates differ": (lambda rng: rng.gamma(4, 0.002, SHAPE), 1000),
    "rates differ much": (lambda rng: rng.gamma(1, 0.008, SHAPE), 1000),
    "many counts": (lambda rng: rng.gamma(4, 0.005, SHAPE), 20_000),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["rates differ", "few counts, rates differ much"]
    + [name for name in CLEAN if name not in ("rates differ", "few counts, rates differ much")],
)
def test_clean_dark_maps_have_false_positives_at_the_stated_rate_at_most(name):
    rates, frames = CLEAN[name]
    rng = np.random.default_rng(0)
    found = sum(
        int(jl.calibrate(counts(rng, rates(rng), frames), frames=frames).hot.sum())
        for _ in range(MAPS)
    )
    trials = MAPS * SHAPE[0] * SHAPE[1]
    # So many or more have a chance of 1e-3 at the stated rate of 1e-4.
    assert found <= binom.isf(1e-3, trials, 1e-4)
    # The exact (Clopper-Pearson) interval reaches down to a rate that is not above the stated one.
    lowest = beta.ppf(1e-3, found, trials - found + 1) if found else 0
    assert lowest <= 1e-4


@pytest.mark.filterwarnings("ignore:dark. no jot is called hot")
@pytest.mark.parametrize(
    ("chance", "frames"),
    [(0.01, 1)]
    + [
        pytest.param(*case, marks=pytest.mark.slow)
        for case in ((0.05, 2), (0.2, 4), (0.5, 8), (0.9, 16), (0.5, 16))
    ],
)
def test_too_few_frames_call_no_jot_hot_by_chance(chance, frames):
    rng = np.random.default_rng(21)
    maps = [jl.calibrate(rng.binomial(frames, chance, SHAPE), frames=frames) for _ in range(MAPS)]
    trials = MAPS * SHAPE[0] * SHAPE[1]
    assert sum(int(found.hot.sum()) for found in maps) <= binom.isf(1e-3, trials, 1e-4)
    enough = chance**frames <= 1e-4
    assert all((found.insufficient_frames_reason() is None) == enough for found in maps)
    assert all(found.hot_probability <= 1e-4 for found in maps)
    expected = np.mean([found.bulk.tail_probability(frames) for found in maps])
    assert expected == pytest.approx(chance**frames, rel=0.2)


@pytest.mark.parametrize("frames", [1, 2, 4])
def test_the_warning_about_too_few_frames_states_the_reason(frames):
    ones = np.random.default_rng(22).binomial(frames, 0.2, SHAPE)
    with pytest.warns(jl.JotlightWarning, match=f"{frames} of {frames} bits are ones by chance in"):
        found = jl.calibrate(ones, frames=frames)
    assert not found.hot.any()
    assert not found.mask.any()


@pytest.mark.slow
def test_the_threshold_is_not_far_above_what_the_rate_asks_for():
    rng = np.random.default_rng(1)
    found = [
        jl.calibrate(
            counts(rng, rng.gamma(4, 0.002, SHAPE), 1000), frames=1000, false_positive_rate=1e-2
        ).hot.mean()
        for _ in range(4)
    ]
    low, high = binom.interval(0.999, 4 * SHAPE[0] * SHAPE[1], 0.01)
    assert 0.7 * low < sum(found) * SHAPE[0] * SHAPE[1] < 1.1 * high


@pytest.mark.parametrize("share", [0.002, 0.05, 0.2])
def test_hot_jots_are_found_and_do_not_pull_at_the_bulk(share):
    rng = np.random.default_rng(2)
    hot = rng.random(SHAPE) < share
    rates = rng.gamma(4, 0.002, SHAPE)
    rates[hot] += 10 ** rng.uniform(-0.9, 0.7, hot.sum())
    ones = counts(rng, rates, 1000)
    calibration = jl.calibrate(ones, frames=1000)
    assert calibration.hot[hot].all()
    assert (calibration.hot & ~hot).sum() <= binom.isf(1e-3, hot.size, 1e-4)
    alone = fit_bulk(ones[~hot], 1000)
    assert calibration.bulk.mean == pytest.approx(alone.mean, rel=0.02)


def test_dark_counts_of_hot_jots_are_most_likely_and_finite():
    ones = np.full((16, 16), 3)
    ones[0, 0], ones[0, 1], ones[0, 2] = 1000, 600, 400
    for threshold in (1, 2):
        calibration = jl.calibrate(ones, frames=1000, threshold=threshold)
        sensor = jl.Sensor(threshold=threshold, dark_counts=calibration.dark_counts)
        again = sensor.probability(np.zeros((16, 16))) * 1000
        np.testing.assert_allclose(np.delete(again, 0), np.delete(ones, 0), atol=1e-3)
        assert again[0, 0] == pytest.approx(999.5, abs=0.01)
        assert calibration.mask[0, 0]


@pytest.mark.parametrize("frames", [100, 1000, 20_000])
def test_dark_counts_of_ordinary_jots_are_better_than_their_mean_and_their_counts(frames):
    rng = np.random.default_rng(0)
    rates = rng.gamma(4, 0.002, (96, 96))
    sensor = jl.Sensor(dark_counts=rates)
    ones = rng.binomial(frames, sensor.probability(np.zeros((96, 96))))
    found = jl.calibrate(ones, frames=frames)
    ordinary = ~found.hot
    truth, raw = rates[ordinary], JotCounts(ones, frames, 1).detections()[ordinary]
    error = np.square(found.dark_counts[ordinary] - truth).mean()
    assert error < np.square(raw - truth).mean()
    assert error < np.square(truth.mean() - truth).mean()
    again = sensor.replace(dark_counts=found.dark_counts).probability(np.zeros((96, 96)))
    assert again[ordinary].sum() * frames == pytest.approx(ones[ordinary].sum(), rel=1e-3)


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize("threshold", [1, 2, 3])
@pytest.mark.parametrize("frames", [1, 2, 100])
def test_missed_hot_jots_do_not_make_ordinary_ones_worse_than_their_counts(threshold, frames):
    rng = np.random.default_rng(1)
    rates, hot = rng.gamma(2, 0.0005, (96, 96)), rng.random((96, 96)) < 0.01
    rates[hot] = rng.uniform(0.02, 0.5, hot.sum())
    sensor = jl.Sensor(threshold=threshold, dark_counts=rates)
    ones = rng.binomial(frames, sensor.probability(np.zeros((96, 96))))
    found = jl.calibrate(ones, frames=frames, threshold=threshold)
    assert (hot & ~found.hot).any()
    raw = JotCounts(ones, frames, threshold).detections()
    error, error_raw = (np.square(d - rates)[~hot].mean() for d in (found.dark_counts, raw))
    assert error <= error_raw * (1 + 1e-6)


def test_a_short_dark_capture_is_no_worse_than_one_number():
    rng = np.random.default_rng(0)
    dark, light = rng.gamma(4, 0.00025, (96, 96)), 0.002
    calibration = jl.calibrate(rng.binomial(200, -np.expm1(-dark)), frames=200)
    counts = rng.binomial(20_000, -np.expm1(-dark - light))
    error = {}
    for name, known in (("map", calibration.dark_counts), ("number", float(dark.mean()))):
        sensor = jl.Sensor(frames=20_000, gain=20_000.0, dark_counts=known)
        error[name] = np.square(jl.mle(counts, sensor) - light).mean()
    assert error["map"] < 1.05 * error["number"]


def test_hot_jots_that_are_not_too_hot_are_used():
    ones = np.random.default_rng(20).poisson(3, (16, 16))
    ones[2, 3], ones[4, 5] = 60, 300
    calibration = jl.calibrate(ones, frames=1000, max_dark=0.1)
    assert np.argwhere(calibration.hot).tolist() == [[2, 3], [4, 5]]
    assert np.argwhere(calibration.mask).tolist() == [[4, 5]]


@pytest.mark.slow
@pytest.mark.parametrize("threshold", [1, 2])
@pytest.mark.parametrize("spread", [0.0, 0.02, 0.1])
def test_the_response_is_found_without_the_noise_of_counting(spread, threshold):
    rng = np.random.default_rng(3)
    _, light, relative, dark = flat_scene(rng, spread)
    ones = counts(rng, dark, 4000, threshold)
    flat = counts(rng, dark + 2 * light * relative, 4000, threshold)
    calibration = jl.calibrate(ones, flat, frames=4000, threshold=threshold)
    if spread:
        real = relative.std()
        assert abs(calibration.prnu - real) < 4 * calibration.prnu_error + 0.02 * real
    else:
        assert calibration.prnu < 4 * calibration.prnu_error
    assert calibration.efficiency.max() == 1
    found = calibration.efficiency * calibration.scale
    error = np.std((found - relative)[~calibration.mask])
    best = spread * calibration.flat_noise / np.hypot(spread, calibration.flat_noise)
    assert error == pytest.approx(best, rel=0.15, abs=5e-3)


def test_dead_and_stuck_jots_are_found_alone_and_in_clusters():
    rng = np.random.default_rng(4)
    ones, light, relative, dark = flat_scene(rng, 0.1)
    dead = rng.random(SHAPE) < 0.01
    dead[40:49, 60:69] = True
    relative[dead] = 0
    flat = counts(rng, dark + light * relative, 4000)
    flat[100, 7] = 4000
    dead[100, 7] = True
    calibration = jl.calibrate(ones, flat, frames=4000)
    np.testing.assert_array_equal(calibration.dead, dead)
    assert calibration.mask[dead].all()


@pytest.mark.slow
def test_jots_at_the_least_response_are_called_dead_at_the_stated_rate_at_most():
    rng = np.random.default_rng(5)
    ones, light, relative, dark = flat_scene(rng, 0.02, frames=200)
    weak = rng.random(SHAPE) < 0.2
    relative[weak] = MIN_RESPONSE
    # The median is that of all jots, a little below that of the good ones.
    flat = counts(rng, dark + light * relative, 200)
    calibration = jl.calibrate(ones, flat, frames=200, false_positive_rate=0.01)
    assert calibration.dead.sum() <= binom.isf(1e-3, weak.sum(), 0.01)


@pytest.mark.slow
def test_a_flat_capture_that_is_short_brings_little_noise():
    rng = np.random.default_rng(6)
    ones, light, relative, dark = flat_scene(rng, 0.05)
    flat = counts(rng, dark + light * relative, 100)
    calibration = jl.calibrate(ones, flat, frames=4000, flat_frames=100)
    assert calibration.flat_noise > 0.1
    assert (calibration.efficiency * calibration.scale - relative).std() < 1.02 * relative.std()


@pytest.mark.slow
@pytest.mark.parametrize("clear", [3.5, 2, 0.5, 0.3])
def test_a_clear_outlier_keeps_the_response_that_was_counted(clear):
    rng = np.random.default_rng(8)
    relative = 1 + 0.05 * rng.standard_normal(SHAPE)
    # One in each square of 10 x 10 jots, at a random place: regular ones look like a mosaic.
    corners = np.mgrid[0 : SHAPE[0] - 9 : 10, 0 : SHAPE[1] - 9 : 10].reshape(2, -1)
    is_clear = np.zeros(SHAPE, bool)
    is_clear[tuple(corners + np.random.default_rng(9).integers(0, 7, corners.shape))] = True
    relative[is_clear] = clear
    dark = counts(rng, np.full(SHAPE, 0.002), 4096)
    flat = counts(rng, 0.002 + 0.4 * relative, 512)
    calibration = jl.calibrate(dark, flat, frames=4096, flat_frames=512)
    # No more than counting blurs it: no outlier is drawn to the ordinary jots.
    found = calibration.efficiency[is_clear] * calibration.scale
    good = ~calibration.mask[is_clear]
    assert good.mean() > 0.99
    chance = 1 - np.exp(-0.4 * clear)
    blur = np.sqrt(chance / (1 - chance) / 512) / 0.4
    assert np.mean(found[good]) == pytest.approx(clear, rel=0.06)
    assert np.sqrt(np.mean((found - clear)[good] ** 2)) < 1.4 * blur
    # Nor do they pull at what the others are.
    assert calibration.prnu == pytest.approx(0.05, abs=4 * calibration.prnu_error)
    error = (calibration.efficiency * calibration.scale - relative)[~is_clear].std()
    assert error < 0.044


GOOD = np.full((16, 16), 3)


@pytest.mark.parametrize(
    ("given", "options", "words"),
    [
        ((GOOD,), {}, "dark holds counts, and their number of frames is unknown"),
        ((GOOD,), {"frames": 2}, "at least the largest of the dark counts, 3"),
        ((GOOD,), {"frames": 9, "false_positive_rate": 0.5}, r"expected a number in \(0, 0.01\]"),
        ((jl.Bits.from_array(np.zeros((4, 8, 8), bool)),), {"frames": "4"}, "bits, got '4'"),
        ((GOOD,), {"frames": "9"}, "frames: expected a whole number, .* 3, got '9'"),
        ((GOOD,), {"frames": 9.5}, "frames: expected a whole number, .* 3, got 9.5"),
        ((GOOD,), {"frames": 9, "false_positive_rate": "0"}, r"number in \(0, 0.01\], got '0'"),
        ((GOOD,), {"frames": 9, "max_dark": "1"}, "max_dark: expected a finite number .*, got '1'"),
        ((GOOD,), {"frames": 9, "max_dark": 0}, "max_dark: expected a finite number"),
        ((GOOD[:2, :2],), {"frames": 9}, "expected 64 jots or more"),
        ((np.full((16, 16), 9),), {"frames": 9}, "some jots that do not report 1 in every frame"),
        ((GOOD, GOOD[:8]), {"frames": 9}, "flat: expected the dark capture's 16 x 16 jots"),
        ((GOOD, np.full((16, 16), 9)), {"frames": 9}, "record it with less light"),
        ((GOOD, GOOD), {"frames": 9}, "more ones than in the dark capture"),
        ((np.full((16, 16, 3), 3),), {"frames": 9}, r"one channel \(H, W\)"),
        ((jl.Bits.from_array(np.zeros((4, 8, 8, 3), bool)),), {}, "frames of one channel, got 3"),
        ((jl.Bits.from_array(np.zeros((4, 8, 8), bool)),), {"frames": 5}, "the 4 of the dark bits"),
    ],
)
@pytest.mark.filterwarnings("ignore:dark. no jot is called hot")
def test_captures_that_contradict_the_arguments_are_refused(given, options, words):
    with pytest.raises(ValueError, match=words):
        jl.calibrate(*given, **options)


def test_a_real_dark_map(data):
    path = data / "real" / "spcimager" / "counts.npz"
    ones = jl.open(path, key="bframee")
    calibration = jl.calibrate(ones, frames=4096)
    assert calibration.mask[ones == 4096].all()
    assert calibration.hot[ones > 100].all()
    assert not calibration.hot[ones < 20].any()
    # Nearly a fifth is not of the bulk; a third of these is too hot to be used.
    assert 0.17 < calibration.hot.mean() < 0.2
    assert 0.055 < calibration.mask.mean() < 0.075


@pytest.mark.slow
def test_a_real_flat_field(data):
    path = data / "real" / "spcimager" / "counts.npz"
    dark, flat = jl.open(path, key="bframee"), jl.open(path, key="tempframe_lo")
    # The hot jots have about a quarter of their dark counts in the frames of the flat capture.
    with pytest.warns(jl.JotlightWarning, match="do not have the dark counts"):
        calibration = jl.calibrate(dark, flat, frames=4096, flat_frames=1024)
    assert 0.2 < calibration.prnu < 0.24
    assert calibration.dead.mean() < 0.005
    # A dark map of some jots with nearly none.
    few = jl.open(data / "real" / "spad64x32" / "count_dark.npy", counts=True)
    assert 0.01 < jl.calibrate(few, frames=60_000).hot.mean() < 0.05


def test_paths_in_place_of_captures_are_named():
    with pytest.raises(TypeError, match=r"got the path 'c\.npy'; pass jotlight\.open\(path\)"):
        jl.calibrate("c.npy", frames=8)


def test_readings_of_several_bits_are_refused_with_advice():
    readings = jl.Sensor(frames=3, bit_depth=4).expose(np.full((4, 5), 0.5), rng=0)
    with pytest.raises(ValueError, match=r"dark: expected single bits .*, got readings of 4 bits"):
        jl.calibrate(readings)
