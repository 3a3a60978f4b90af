"""Random bits: their distribution, independence, and dependence on the seed.

The statistical tests have fixed seeds, so they always pass or always fail. Each says how often it
would fail for other seeds although the sensor is right.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import gammainc
from scipy.stats import binomtest, chi2

import jotlight as jl
from jotlight.sensing.sensor import KERNELS
from reference import sensing

FALSE_ALARM = 1e-6
EVEN = np.log(2)
"""The rate at which half of the jots report 1."""


def number_of_ones(packed):
    return int.from_bytes(np.ascontiguousarray(packed).tobytes(), "little").bit_count()


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1e-4, 0.3, 2.5])
@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_of_a_hundred_million_jots_the_expected_share_reports_1(threshold, rate):
    """Exact binomial test; it fails for one of 10⁶ seeds."""
    sensor = jl.Sensor(oversampling=10, frames=4, threshold=threshold)
    bits = sensor.expose(np.full((500, 500), float(rate)), rng=2016)
    probability = gammainc(threshold, rate)
    assert binomtest(number_of_ones(bits.packed), 10**8, probability).pvalue > FALSE_ALARM


RATES = [1e-5, 1e-4, 5e-4, 1e-3, 1.7e-3, 3e-3, 1e-2, 0.1, 0.3, 1, 2.5, 5, 30, 1e5, 1e300]
"""Rates at the nodes of the engine's table of probabilities, between them, and beyond it."""


@pytest.mark.slow
@pytest.mark.parametrize("threshold", [1, 2, *(q for q in (3, 4, 5)), 6, 50])
def test_of_a_million_jots_the_expected_share_reports_1_at_every_rate(threshold):
    """Exact binomial test of each rate; it fails for one of 10⁶ seeds."""
    image = np.repeat(np.float64(RATES)[:, None, None], 1000, axis=1) * np.ones(1000)
    bits = jl.Sensor(threshold=threshold).expose(image.reshape(-1, 1000), rng=7)
    for rate, packed in zip(RATES, bits.packed.reshape(len(RATES), -1), strict=True):
        probability = gammainc(threshold, rate)
        pvalue = binomtest(number_of_ones(packed), 10**6, probability).pvalue
        assert pvalue > FALSE_ALARM, rate


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=3000, gain=2500, efficiency=0.8, dark_counts=0.01),
        jl.Sensor(oversampling=4, frames=1500, gain=18000, kernel="cubic", threshold=2),
        jl.Sensor(oversampling=3, frames=1500, kernel="linear", mask=np.eye(30, 27, dtype=bool)),
    ],
    ids=repr,
)
def test_each_jot_reports_1_with_its_own_probability(sensor):
    """χ² test over the jots, of both tails; it fails for one of 5·10⁵ seeds."""
    image = np.random.default_rng(0).uniform(0.2, 2, (10, 9))
    bits = sensor.expose(image, rng=11)
    p = sensing.probability(sensor, image)
    alive = p > 0
    mean, variance = sensor.frames * p, sensor.frames * p * (1 - p)
    square = ((bits.to_array().sum(axis=0) - mean) ** 2)[alive] / variance[alive]
    assert FALSE_ALARM < chi2.cdf(square.sum(), alive.sum()) < 1 - FALSE_ALARM
    assert square.max() < 45


def test_a_dead_jot_always_reports_0():
    mask = np.random.default_rng(0).random((40, 60)) < 0.5
    for kernel in KERNELS:
        sensor = jl.Sensor(oversampling=2, frames=3, kernel=kernel, mask=mask)
        bits = sensor.expose(np.full((20, 30), 1e6), rng=0).to_array()
        np.testing.assert_array_equal(bits, np.broadcast_to(~mask, bits.shape))


def test_without_light_all_jots_report_0():
    assert number_of_ones(jl.Sensor(oversampling=9).expose(np.zeros((90, 90)), rng=0).packed) == 0


def even_bits(rng=0, channels=2):
    sensor = jl.Sensor(frames=2)
    image = np.full((1001, 2000, channels), EVEN)
    return sensor.expose(image, rng=rng, channel_axis=-1).to_array()


INDEPENDENT = {
    "seeds": lambda bits: (bits, even_bits(1)),
    "spawned seeds": lambda bits: (
        even_bits(np.random.SeedSequence(0).spawn(1)[0]),
        even_bits(np.random.SeedSequence(0).spawn(2)[1]),
    ),
    "channels": lambda bits: (bits[..., 0], bits[..., 1]),
    "frames": lambda bits: (bits[0], bits[1]),
    "rows": lambda bits: (bits[:, 1:], bits[:, :-1]),
    "columns": lambda bits: (bits[:, :, 1:], bits[:, :, :-1]),
    "words": lambda bits: (bits[:, :, 64:], bits[:, :, :-64]),
    "rows and frames": lambda bits: (bits[0, 1:], bits[1, :-1]),
}


@pytest.mark.parametrize("which", INDEPENDENT)
def test_bits_at_different_positions_are_independent(which):
    """Bits with P(b = 1) = 1/2 agree half of the time; the test fails for one of 10⁶ seeds."""
    one, other = INDEPENDENT[which](even_bits())
    agree = np.count_nonzero(one == other)
    assert binomtest(agree, one.size, 0.5).pvalue > FALSE_ALARM


@pytest.mark.slow
def test_the_bits_of_a_word_are_independent():
    """Tests of all 2016 pairs of 64 bits, and of the 256 bytes; each fails for one of 10⁶ seeds."""
    words = 1 << 19
    packed = jl.Sensor(oversampling=8).expose(np.full((words // 512, 512), EVEN), rng=3).packed
    times = np.bincount(packed.ravel(), minlength=256)
    square = ((times - packed.size / 256) ** 2).sum() / (packed.size / 256)
    assert FALSE_ALARM / 2 < chi2.cdf(square, 255) < 1 - FALSE_ALARM / 2
    signs = np.unpackbits(packed.reshape(-1, 8), axis=1).astype(np.float32) * 2 - 1
    together = signs.T @ signs / len(signs)
    pairs = together[np.triu_indices(64, 1)]
    assert np.abs(pairs).max() < 6.4 / np.sqrt(len(signs))


SENSOR = jl.Sensor(oversampling=3, frames=5, kernel="linear", threshold=2, gain=90)
IMAGE = np.random.default_rng(1).random((33, 41))


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("kernel", ["box", "cubic"])
def test_the_bits_do_not_depend_on_the_number_of_threads(threads, kernel):
    sensor = SENSOR.replace(kernel=kernel)
    bits = sensor.expose(IMAGE, rng=0, threads=threads)
    np.testing.assert_array_equal(bits.packed, sensor.expose(IMAGE, rng=0).packed)


def slices(size):
    return st.tuples(st.integers(0, size - 1), st.integers(1, size)).map(
        lambda ends: slice(ends[0], max(ends[0] + 1, ends[1]))
    )


@st.composite
def exposures(draw):
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 30))
    oversampling, frames = draw(st.integers(1, 9)), draw(st.integers(1, 4))
    jots = (height * oversampling, width * oversampling)
    random = np.random.default_rng(draw(st.integers(0, 1000)))
    sensor = jl.Sensor(
        oversampling=oversampling,
        frames=frames,
        gain=1.5 * frames * oversampling**2,
        threshold=draw(st.integers(1, 3)),
        kernel=draw(st.sampled_from(KERNELS)),
        dark_counts=draw(st.sampled_from([0.0, 0.1, random.random(jots)])),
        mask=draw(st.sampled_from([None, random.random(jots) < 0.2])),
    )
    image = random.random((height, width, *draw(st.sampled_from([(), (1,), (3,)]))))
    tile = (draw(slices(height)), draw(slices(width)))
    return sensor, image, tile, draw(slices(frames)), draw(st.sampled_from([1, 2, 3, None]))


@pytest.mark.slow
@settings(max_examples=5 * settings().max_examples)
@given(exposures(), st.integers(0, 2**64))
def test_a_part_has_the_bits_that_the_whole_has_there(exposure, seed):
    sensor, image, tile, frames, threads = exposure
    axis = None if image.ndim == 2 else -1
    whole = sensor.expose(image, seed, channel_axis=axis, threads=1)
    part = sensor.expose(image, seed, channel_axis=axis, tile=tile, frames=frames, threads=threads)
    rows, columns = (
        slice(side.start * sensor.oversampling, side.stop * sensor.oversampling) for side in tile
    )
    np.testing.assert_array_equal(part.to_array(), whole.to_array()[frames, rows, columns])
    repacked = np.packbits(part.to_array(), axis=2)
    np.testing.assert_array_equal(part.packed, repacked, err_msg="padding bits are not 0")
    for name, map_ in sensor.maps().items():
        np.testing.assert_array_equal(part.sensor.maps()[name], map_[rows, columns])
    share = sensor.gain / sensor.trials
    assert part.sensor.gain / part.sensor.trials == pytest.approx(share)


@pytest.mark.parametrize("oversampling", [1, 7])
@pytest.mark.parametrize("kernel", ["box", "quadratic"])
def test_a_part_of_a_wide_row_has_the_bits_that_the_whole_row_has_there(oversampling, kernel):
    image = np.random.default_rng(0).random((1, 9001))
    sensor = jl.Sensor(oversampling=oversampling, kernel=kernel)
    whole = sensor.expose(image, rng=0).to_array()
    for start, stop in [(0, 4096), (1, 4097), (63, 8999), (585, 586), (4095, 9001)]:
        part = sensor.expose(image, rng=0, tile=(slice(None), slice(start, stop))).to_array()
        expected = whole[:, :, start * oversampling : stop * oversampling]
        np.testing.assert_array_equal(part, expected)


@pytest.mark.parametrize("size", [1, 600, 5000])
def test_the_bits_do_not_depend_on_the_size_of_the_chunks(monkeypatch, size):
    image = np.random.default_rng(0).random((33, 41, 3))
    whole = SENSOR.expose(image, rng=0, channel_axis=-1)
    rate = SENSOR.rate(image, channel_axis=-1)
    monkeypatch.setattr("jotlight.chunks._MAX_JOTS", size)
    monkeypatch.setattr("jotlight.chunks._MIN_ROW_COST", 1)
    done = []
    np.testing.assert_array_equal(
        SENSOR.expose(image, rng=0, channel_axis=-1, progress=done.append).packed, whole.packed
    )
    assert done == sorted(set(done))
    assert len(done) >= 6
    assert done[-1] == 1
    np.testing.assert_array_equal(SENSOR.rate(image, channel_axis=-1), rate)
    np.testing.assert_array_equal(
        whole.counts(), whole.to_array().reshape(5, 33, 3, 41, 3, 3).sum(axis=(0, 2, 4))
    )
