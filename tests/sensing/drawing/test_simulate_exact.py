"""The exact distribution of the bits of sensors whose jots have different rates.

The tests have fixed seeds, so they always pass or always fail. Each compares the number of ones of
every jot in many frames with its binomial distribution.
"""

import numpy as np
import pytest
from scipy.special import gammainc
from scipy.stats import binom

import jotlight as jl
import jotlight._engine as engine
from jotlight.seeds import seed_bytes
from jotlight.sensing.sensor import KERNELS
from reference import sensing

FRAMES = 50_000
FALSE_ALARM = 1e-7
RANDOM = np.random.default_rng(41)


def check_counts(ones, probability, frames=FRAMES):
    """Compare the number of ones of each jot with its binomial distribution, in both tails."""
    below = binom.cdf(ones, frames, probability)
    above = binom.sf(ones - 1, frames, probability)
    assert np.minimum(below, above).min() > FALSE_ALARM


def kinds_of_jots():
    """Yield all products. The fast ones have all pairs of oversampling and kernel."""
    for i, oversampling in enumerate((1, 3, 4, 8)):
        for j, kernel in enumerate(KERNELS):
            for k, threshold in enumerate((1, 2, 7)):
                marks = [] if (i + j) % 3 == k else [pytest.mark.slow]
                yield pytest.param(oversampling, kernel, threshold, marks=marks)


@pytest.mark.parametrize(("oversampling", "kernel", "threshold"), list(kinds_of_jots()))
def test_each_jot_has_its_binomial_distribution(oversampling, kernel, threshold):
    sensor = jl.Sensor(
        oversampling=oversampling,
        frames=FRAMES,
        kernel=kernel,
        threshold=threshold,
        gain=2.0 * FRAMES * oversampling**2 * threshold,
        efficiency=0.7,
        dark_counts=0.004,
    )
    image = np.array([[0.0, 0.004, 1.0], [0.03, 0.5, 0.2]])
    ones = sensor.expose(image, rng=threshold).to_array().sum(axis=0)
    check_counts(ones, sensing.probability(sensor, image))


@pytest.mark.parametrize("kernel", ["box", "cubic"])
@pytest.mark.parametrize("threshold", [1, 3])
def test_maps_and_masks_keep_the_binomial_distribution(threshold, kernel):
    jots = (8, 12)
    sensor = jl.Sensor(
        oversampling=4,
        frames=FRAMES,
        kernel=kernel,
        threshold=threshold,
        gain=16.0 * FRAMES * threshold,
        efficiency=RANDOM.uniform(0.1, 1, jots),
        dark_counts=np.where(RANDOM.random(jots) < 0.1, 2.0, 0.01),
        mask=RANDOM.random(jots) < 0.2,
    )
    image = RANDOM.uniform(0, 2, (2, 3))
    ones = sensor.expose(image, rng=3).to_array().sum(axis=0)
    check_counts(ones, sensing.probability(sensor, image))


@pytest.mark.slow
def test_a_gain_for_each_frame_keeps_the_binomial_distribution():
    gains = np.tile([0.05, 0.5, 4.0], 2000)
    sensor = jl.Sensor(frames=len(gains), gain=gains)
    image = RANDOM.uniform(0, 1, (4, 5))
    bits = sensor.expose(image, rng=1).to_array()
    for gain in [0.05, 0.5, 4.0]:
        ones = bits[gains == gain].sum(axis=0)
        check_counts(ones, -np.expm1(-gain * image), 2000)


def count_sensors():
    """Yield all products. The fast ones have each number of trials, and each threshold often."""
    sizes = (1, 1), (1, 3), (1, 4), (70, 1), (3, 8), (5, 10)
    for i, (frames, oversampling) in enumerate(sizes):
        for j, threshold in enumerate((1, 2, 5)):
            sensor = jl.Sensor(
                frames=frames,
                oversampling=oversampling,
                threshold=threshold,
                gain=frames * oversampling**2 * threshold,
                efficiency=0.8,
                dark_counts=0.003 * threshold,
            )
            marks = [] if (i + j) % 2 == 0 else [pytest.mark.slow]
            yield pytest.param(sensor, id=f"{sensor.trials}-{threshold}", marks=marks)


@pytest.mark.parametrize("sensor", list(count_sensors()))
def test_counts_have_the_distribution_of_the_sums_of_bits(sensor):
    """Each number of occurrences of each count is binomial, for every K, q, and dark counts."""
    pixels = 100_000
    for number, intensity in enumerate((0.0, 0.02, 0.3, 1.0, 4.0)):
        image = np.full((100, pixels // 100), intensity)
        counts = np.empty(image.shape, np.int32)
        arguments = sensor.engine_arguments()
        engine.draw_counts(arguments, sensor.frames, image, seed_bytes(8), number, counts)
        found = np.bincount(counts.ravel(), minlength=sensor.trials + 1)
        rate = 0.8 * sensor.threshold * intensity + sensor.dark_counts
        share = binom.pmf(
            np.arange(sensor.trials + 1), sensor.trials, gammainc(sensor.threshold, rate)
        )
        check_counts(found, share, pixels)
        bits = sensor.expose(image[:, :500].astype(float), rng=number).counts()
        square = (bits.mean() - counts.mean()) ** 2
        variance = sensor.trials * gammainc(sensor.threshold, rate)
        assert square <= 30 * variance * (1 / bits.size + 1 / pixels)


def test_counts_of_all_pixels_and_indices_are_independent():
    sensor = jl.Sensor(oversampling=4)
    image = np.full((2, 4000), 1.0)
    drawn = []
    for index in range(3):
        counts = np.empty(image.shape, np.int32)
        engine.draw_counts(sensor.engine_arguments(), 1, image, seed_bytes(1), index, counts)
        drawn.append(counts - counts.mean())
    values = np.array(drawn)
    variance = values.var()
    for one, other in [(values[1:], values[:-1]), (values[:, 1:], values[:, :-1])]:
        assert abs((one * other).mean()) < 5.5 * variance / np.sqrt(one.size)
    for lag in (1, 2, 15, 16, 17, 64, 128):
        product = (values[..., lag:] * values[..., :-lag]).mean()
        assert abs(product) < 5.5 * variance / np.sqrt(values[..., lag:].size)


def test_counts_are_refused_where_bits_are_not_alike():
    counts = np.empty((2, 2), np.int32)
    for sensor in (
        jl.Sensor(kernel="cubic"),
        jl.Sensor(threshold=65),
        jl.Sensor(mask=np.eye(2) > 0),
    ):
        with pytest.raises(ValueError, match="sensor: expected a box kernel, no maps"):
            engine.draw_counts(sensor.engine_arguments(), 1, np.ones((2, 2)), bytes(32), 0, counts)
