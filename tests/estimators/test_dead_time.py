"""Free-running pixels with a dead time: counts, maximum likelihood, and intervals."""

import mpmath as mp
import numpy as np
import pytest
from scipy import optimize, stats

import jotlight as jl

PIXELS = [
    jl.FreeRunning(dead_time=0.3),
    jl.FreeRunning(dead_time=0.02, efficiency=0.5, dark_counts=2.0),
    jl.FreeRunning(dead_time=1.0),
]


def at_least(pixel, count, light):
    """Return P(N ≥ n), as an integral of the density of n exponential times."""
    rate = mp.mpf(pixel.efficiency) * light + mp.mpf(pixel.dark_counts)
    rest = 1 - (count - 1) * mp.mpf(str(pixel.dead_time))
    if count == 0:
        return mp.mpf(1)
    return mp.gammainc(count, 0, rate * rest, regularized=True) if rest > 0 else mp.mpf(0)


@pytest.mark.parametrize("pixel", PIXELS)
@pytest.mark.parametrize("light", [0.01, 1.0, 30.0, 300.0])
def test_probabilities_agree_with_mpmath(pixel, light):
    for count in range(min(pixel.max_count, 20) + 1):
        with mp.workdps(340):  # the difference of two numbers close to 1
            expected = at_least(pixel, count, light) - at_least(pixel, count + 1, light)
        own = float(pixel.probability(count, light))
        assert own == pytest.approx(float(expected), rel=1e-10, abs=1e-290)


@pytest.mark.parametrize("pixel", PIXELS)
def test_probabilities_sum_to_one_and_the_mean_is_theirs(pixel):
    counts = np.arange(pixel.max_count + 1)
    for light in (0.0, 0.5, 20.0, 1e4):
        weights = pixel.probability(counts, light)
        assert weights.sum() == pytest.approx(1)
        assert pixel.mean(light) == pytest.approx(weights @ counts)


def test_counts_are_those_of_a_process_of_photons():
    # Photons one after another: a false alarm of the exact tests once in 10^6 seeds.
    pixel, light, number = jl.FreeRunning(dead_time=0.15, dark_counts=1.0), 6.0, 40000
    rng = np.random.default_rng(0)
    counts = np.zeros(number, int)
    for index in range(number):
        time = rng.exponential(1 / 7.0)
        while time < 1:
            counts[index] += 1
            time += 0.15 + rng.exponential(1 / 7.0)
    for drawn in (counts, pixel.draw(np.full(number, light), rng=1)):
        found = np.bincount(drawn, minlength=pixel.max_count + 1)
        weights = pixel.probability(np.arange(pixel.max_count + 1), light)
        low = stats.binom.cdf(found, number, weights)
        high = stats.binom.sf(found - 1, number, weights)
        assert np.minimum(low, high).min() > 1e-6 / 2 / len(found) / 2


@pytest.mark.slow
@pytest.mark.parametrize("pixel", PIXELS[:2])
def test_the_maximum_is_that_of_brute_force(pixel):
    for count in range(1, min(pixel.max_count - 1, 30)):
        own = float(pixel.mle(count))
        if own == 0:  # darker than the dark counts
            assert pixel.probability(count, 0.0) > pixel.probability(count, 0.1)
            continue

        def cost(v, count=count):
            return -np.log(pixel.probability(count, np.exp(v)))

        middle = np.log(own)
        found = optimize.minimize_scalar(
            cost, bounds=(middle - 2, middle + 2), method="bounded", options={"xatol": 1e-10}
        )
        assert own == pytest.approx(np.exp(found.x), rel=1e-4)


def test_saturation_and_no_counts_are_the_ends():
    pixel = jl.FreeRunning(dead_time=0.3)
    assert pixel.max_count == 4
    assert pixel.mle([0, 4]).tolist() == [0, np.inf]
    low, high = pixel.interval([0, 4])
    assert low[0] == 0
    assert high[1] == np.inf
    assert pixel.draw(np.full(5, 1e12), rng=0).tolist() == [4] * 5
    short = jl.FreeRunning(dead_time=1e-6)
    np.testing.assert_allclose(short.mle([1, 100]), [1, 100], rtol=1e-3)


@pytest.mark.parametrize("periods", [2, 3, 10, 1e3, 1e6, 1e6 + 3e-4, 3e6, 1e7])
def test_the_largest_count_is_the_last_with_time_to_be_reached(periods):
    pixel = jl.FreeRunning(dead_time=1 / periods)
    last = pixel.max_count
    assert pixel.at_least([last, last + 1], 1e30).tolist() == [1, 0]


def test_the_shortest_dead_times_have_the_light_of_the_advice():
    pixel = jl.FreeRunning(dead_time=1e-7)
    counts = np.array([1, 10, 1000, 10**5, 10**6, 5 * 10**6, 9 * 10**6])
    light = counts / (1 - counts * 1e-7)
    np.testing.assert_allclose(pixel.mle(counts), light, rtol=1e-6)
    np.testing.assert_allclose(pixel.mean(light), counts, rtol=1e-6)
    np.testing.assert_allclose(pixel.information(light), (1 - counts * 1e-7) / light, rtol=1e-4)
    low, high = pixel.interval(pixel.draw(light, rng=0))
    assert ((low < light) & (light < high)).all()


@pytest.mark.parametrize("pixel", PIXELS)
def test_the_coverage_of_the_interval_is_exact(pixel):
    counts = np.arange(pixel.max_count + 1)
    low, high = pixel.interval(counts, 0.9)
    for light in np.geomspace(0.05, 200, 60):
        covered = (low <= light) & (light <= high)
        assert pixel.probability(counts, light) @ covered >= 0.9 - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("pixel", PIXELS[:2])
def test_the_information_is_the_mean_of_the_squared_slope(pixel):
    counts, step = np.arange(pixel.max_count + 1), 1e-5
    for light in (0.5, 5.0, 40.0):
        weights = pixel.probability(counts, light)
        above, below = (pixel.probability(counts, light + way) for way in (step, -step))
        usable = weights > 1e-9
        expected = np.sum(((above - below) / 2 / step)[usable] ** 2 / weights[usable])
        assert pixel.information(light) == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_corrected_counts_have_little_bias_where_uncorrected_ones_are_far_off():
    pixel = jl.FreeRunning(dead_time=0.01)
    counts = pixel.draw(np.full(20000, 60.0), rng=0)
    assert counts.mean() < 40
    assert pixel.mle(counts).mean() == pytest.approx(60.0, rel=0.01)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jl.FreeRunning(dead_time=0.0), "dead_time: expected a number from 1e-07 to 1"),
        (lambda: jl.FreeRunning(dead_time=2.0), "dead_time: expected a number from 1e-07 to 1"),
        (lambda: jl.FreeRunning(dead_time=0.1, efficiency=0), "efficiency: expected a number"),
        (lambda: PIXELS[0].mle([5]), "counts: expected whole numbers from 0 to 4"),
        (lambda: PIXELS[0].mle([0, 5]), "counts: expected .* of 0.3 exposures, got 5$"),
        (lambda: PIXELS[0].mle([0.5]), "counts: expected whole numbers, got float64; cast"),
        (lambda: PIXELS[0].mle(np.full((3, 3), 7.0)), "got float64; cast rounded floats with ast"),
        (lambda: PIXELS[0].mle([-1]), "counts: expected whole numbers from 0 to 4, .* got -1$"),
        (lambda: PIXELS[0].mean(-1.0), "light: expected photons per exposure time, >= 0"),
        (lambda: PIXELS[0].mean(-np.ones((9, 9))), r"got an array of float64 of shape \(9, 9\)$"),
        (lambda: jl.FreeRunning(dead_time=5e-8), "a fraction of the exposure time, so divide sec"),
        (lambda: jl.FreeRunning(dead_time=5e-8), r"n detections would be n / \(1 - n \* dead_time"),
        (lambda: PIXELS[0].interval([1], 0.2), "confidence_level: expected a number from 0.5"),
    ],
)
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


COUNTING = [
    jl.FreeRunning(dead_time=0.01),
    jl.FreeRunning(dead_time=0.05, efficiency=0.5, dark_counts=2.0),
    jl.FreeRunning(dead_time=1e-4, efficiency=0.8),
    jl.FreeRunning(dead_time=2e-6),
    jl.FreeRunning(dead_time=1e-7),
]


@pytest.mark.parametrize("pixel", COUNTING)
def test_the_most_likely_intensity_is_that_of_the_count(pixel):
    counts = np.arange(min(pixel.max_count, 120))[None]
    merged = pixel.merge(counts, light=60.0, near_neighbors=False)
    expected = np.clip(pixel.mle(counts) / 60, 0, 1)
    np.testing.assert_allclose(jl.mle(merged), expected, atol=2e-6, rtol=1e-5)
    photons = jl.reconstruct(merged, method="mle", units="photons")
    np.testing.assert_allclose(photons, pixel.efficiency * 60 * expected, atol=1e-4, rtol=1e-5)


@pytest.mark.parametrize("pixel", COUNTING)
def test_the_information_is_that_of_the_count(pixel):
    counts = np.arange(10, min(pixel.max_count - 1, 40))[None]
    light = 2 * float(pixel.mle(counts.max()))
    merged = pixel.merge(counts, light, near_neighbors=False)
    intensity = pixel.mle(counts) / light
    slope = pixel.efficiency * light / merged.sensor.frames
    rate = slope * intensity + pixel.dark_counts / merged.sensor.frames
    information = merged.trials * slope**2 / np.expm1(rate)
    # Whole numbers of ones scale the trials.
    tolerance = 0.5 / merged.ones.min()
    expected = light**2 * pixel.information(light * intensity)
    np.testing.assert_allclose(information, expected, rtol=1.01 * tolerance)


@pytest.mark.parametrize("pixel", COUNTING)
def test_the_score_is_the_derivative_of_the_logarithm(pixel):
    counts, light, step = np.arange(min(pixel.max_count, 15) + 1), 8.0, 1e-5
    logarithms = [np.log(pixel.probability(counts, light + sign * step)) for sign in (-1, 1)]
    numeric = (logarithms[1] - logarithms[0]) / (2 * step)
    np.testing.assert_allclose(pixel.score(counts, light), numeric, rtol=1e-4, atol=1e-5)
    # Far too many counts for so little light.
    assert np.isfinite(pixel.score(pixel.max_count, 1e-9))


@pytest.mark.parametrize("dark_counts", [0.0, 0.5])
def test_a_detection_before_a_long_dead_time_is_no_darkness(dark_counts):
    pixel = jl.FreeRunning(dead_time=0.95, dark_counts=dark_counts)
    merged = pixel.merge([[0, 1]], light=20.0, near_neighbors=False)
    np.testing.assert_allclose(jl.mle(merged), pixel.mle([[0, 1]]) / 20, rtol=1e-5)


def test_dark_and_saturated_pixels_are_at_the_ends():
    pixel = jl.FreeRunning(dead_time=0.1)
    merged = pixel.merge([[0, 10]], light=20.0, max_intensity=2.0, near_neighbors=False)
    assert merged.ones[0, 0] == 0
    assert merged.trials[0, 0] == pytest.approx(merged.sensor.frames)
    assert merged.ones[0, 1] == merged.trials[0, 1] > 0
    assert jl.mle(merged).tolist() == [[0.0, 2.0]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dead_time", "light", "gain"),
    [(0.2, 200.0, 11), (0.2, 20.0, 5), (1.0, 3.0, 11), (0.02, 1000.0, -0.1)],
)
def test_images_near_saturation_have_no_bias(dead_time, light, gain):
    scene = jl.datasets.photograph("camera")[60:188, 100:228].astype(float)
    pixel = jl.FreeRunning(dead_time=dead_time, efficiency=0.5, dark_counts=0.3)
    counts = pixel.draw(light * scene, rng=1)
    near, own = (
        jl.reconstruct(pixel.merge(counts, light, near_neighbors=near)) for near in (True, False)
    )
    # At the light 200, a fifth of the pixels have only saturated neighbors.
    assert abs(np.mean(near - scene)) < (0.06 if light == 200 else 0.02)
    assert jl.metrics.psnr(near, scene) > jl.metrics.psnr(own, scene) + gain


@pytest.mark.parametrize("intensity", [0.02, 0.3, 0.9])
@pytest.mark.parametrize("pixel", [*COUNTING, jl.FreeRunning(dead_time=0.25, dark_counts=0.1)])
def test_counts_near_neighbors_have_no_bias(pixel, intensity):
    light = min(10.0, 2 / pixel.dead_time)
    merged = pixel.merge(pixel.draw(np.full((96, 96), light * intensity), rng=3), light)
    rate = pixel.efficiency * light * intensity + pixel.dark_counts
    p = -np.expm1(-rate / merged.sensor.frames)
    noise = 1 / np.sqrt(merged.shape[0] ** 2 * pixel.information(light * intensity))
    slope = pixel.efficiency * light / merged.sensor.frames * (1 - p)
    error = (merged.ones.sum() / merged.trials.sum() - p) / slope
    assert abs(error) < 4 * noise + 0.005 * intensity
    information = merged.trials.mean() * slope**2 / (p * (1 - p))
    assert information == pytest.approx(light**2 * pixel.information(light * intensity), rel=0.1)


def test_pixels_with_only_saturated_neighbors_are_flagged():
    counts = np.full((32, 32), 5)
    counts[:, :16] = 3
    merged = jl.FreeRunning(dead_time=0.2).merge(counts, light=40.0)
    assert merged.flags[:, -4:].all()
    assert not merged.flags[:, :16].any()


@pytest.mark.parametrize("near", [True, False])
def test_dead_pixels_have_no_trials_and_no_effect(near):
    scene = jl.datasets.photograph("camera")[100:164, 180:252].astype(float)
    counts, dead = COUNTING[0].draw(400 * scene, rng=0), np.zeros(scene.shape, bool)
    dead[::5, ::4] = True
    merged, other = (
        COUNTING[0].merge(np.where(dead, fill, counts), 400.0, mask=dead, near_neighbors=near)
        for fill in (0, 10_000)
    )
    np.testing.assert_array_equal(merged.trials == 0, dead)
    np.testing.assert_array_equal(merged.sensor.mask, dead)
    for name in ("ones", "trials"):
        np.testing.assert_array_equal(getattr(merged, name), getattr(other, name))
    all_live = COUNTING[0].merge(counts, 400.0, near_neighbors=near)
    fractions = [each.ones[~dead].sum() / each.trials[~dead].sum() for each in (merged, all_live)]
    assert fractions[0] == pytest.approx(fractions[1], rel=2e-3)
    with pytest.warns(jl.JotlightWarning, match="no valid bit"):
        estimate = jl.mle(merged)
    assert estimate[20, 20] == pytest.approx(estimate[19:22, 19:22].mean(), rel=0.2)


def test_wrong_masks_of_dead_pixels_are_refused():
    counts = np.full((4, 6), 7)
    merge = COUNTING[0].merge
    with pytest.raises(ValueError, match=r"mask: expected .*\(4, 6\)"):
        merge(counts, 9.0, mask=np.zeros((6, 4), bool))
    with pytest.raises(ValueError, match="expected at least one pixel with a valid bit"):
        merge(counts, 9.0, mask=np.ones((4, 6), bool))
    masked = np.ma.array(counts, mask=np.eye(4, 6, dtype=bool))
    with pytest.raises(TypeError, match=r"masked one; fill it, .* merge\(counts, light, mask="):
        merge(masked, 9.0)
    with pytest.raises(TypeError, match="mask: expected a plain array, got a masked one"):
        merge(counts, 9.0, mask=masked == 7)


def test_networks_and_intervals_take_them():
    scene = jl.datasets.photograph("camera")[::4, ::4].astype(float)
    pixel = jl.FreeRunning(dead_time=0.02)
    merged = pixel.merge(pixel.draw(30 * scene, rng=0), light=30.0)
    estimate = jl.reconstruct(merged)
    assert jl.metrics.psnr(estimate, scene) > jl.metrics.psnr(jl.mle(merged), scene) + 5
    found = jl.uncertainty(merged)
    assert 0.8 < ((found.low <= scene) & (scene <= found.high)).mean() <= 1


@pytest.mark.parametrize(
    ("counts", "options", "message"),
    [
        ([[101]], {"light": 1.0}, "expected whole numbers from 0 to 100"),
        ([[3]], {"light": 0.0}, "light: expected"),
        ([[3]], {"light": 1e9}, "light: expected at most 5e.08 detections"),
        ([[3]], {"light": 1.0, "max_intensity": -1}, "max_intensity: expected"),
        ([3], {"light": 1.0}, "expected"),
    ],
)
def test_bad_counts_are_refused(counts, options, message):
    with pytest.raises(ValueError, match=message):
        COUNTING[0].merge(counts, **options)


@pytest.mark.parametrize("light", [1e300, np.inf])
@pytest.mark.parametrize("pixel", [*PIXELS, jl.FreeRunning(dead_time=0.01)])
def test_light_without_bound_saturates(pixel, light):
    # Warnings are errors.
    last = pixel.max_count
    assert pixel.mean(light) == last
    assert pixel.information(light) == 0
    assert pixel.probability([0, last - 1, last], light).tolist() == [0, 0, 1]
    assert pixel.at_least([0, last, last + 1], light).tolist() == [1, 1, 0]
    assert pixel.score(last, light) == 0
    assert pixel.mean(pixel.interval([0, last])[1])[1] == last
    assert pixel.draw([light], rng=0) == last
