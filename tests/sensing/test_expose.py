"""The bits of a sensor.

The statistical tests have fixed seeds, so they pass or fail for good; each says how often it would
fail for a right sensor and another seed.
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
"""The rate at which a jot fires half of the time."""


def ones(packed):
    return int.from_bytes(np.ascontiguousarray(packed).tobytes(), "little").bit_count()


@pytest.mark.parametrize("rate", [1e-5, 1e-4, 1e-2, 0.3, 1, 2.5, 5])
@pytest.mark.parametrize("threshold", [1, 2, 5])
def test_a_hundred_million_jots_fire_as_often_as_poisson_says(threshold, rate):
    """Exact binomial test; false alarm: once in 10⁶ seeds."""
    sensor = jl.Sensor(oversampling=10, frames=4, threshold=threshold)
    bits = sensor.expose(np.full((500, 500), float(rate)), rng=2016)
    fires = gammainc(threshold, rate)
    assert binomtest(ones(bits.packed), 10**8, fires).pvalue > FALSE_ALARM


@pytest.mark.parametrize("rate", [1e-4, 5e-4, 1e-3, 1.7e-3, 3e-3, 0.1, 30, 1e5, 1e300])
@pytest.mark.parametrize("threshold", [2, 3, 4, 5, 6, 50])
def test_rates_between_the_nodes_of_the_table_hold_too(threshold, rate):
    """Exact binomial test of 10⁶ jots; false alarm: once in 10⁶ seeds."""
    bits = jl.Sensor(threshold=threshold).expose(np.full((1000, 1000), float(rate)), rng=7)
    fires = gammainc(threshold, rate)
    assert binomtest(ones(bits.packed), 10**6, fires).pvalue > FALSE_ALARM


@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(frames=3000, gain=2500, efficiency=0.8, dark_counts=0.01),
        jl.Sensor(oversampling=4, frames=1500, gain=18000, kernel="cubic", threshold=2),
        jl.Sensor(oversampling=3, frames=1500, kernel="linear", mask=np.eye(30, 27, dtype=bool)),
    ],
    ids=repr,
)
def test_each_jot_fires_as_often_as_its_own_probability_says(sensor):
    """χ² over the jots, upper and lower tail; false alarm: once in 5·10⁵ seeds."""
    image = np.random.default_rng(0).uniform(0.2, 2, (10, 9))
    bits = sensor.expose(image, rng=11)
    fires = sensing.probability(sensor, image)
    alive = fires > 0
    mean, variance = sensor.frames * fires, sensor.frames * fires * (1 - fires)
    square = ((bits.to_array().sum(axis=0) - mean) ** 2)[alive] / variance[alive]
    assert FALSE_ALARM < chi2.cdf(square.sum(), alive.sum()) < 1 - FALSE_ALARM
    assert square.max() < 45


def test_a_dead_jot_never_fires():
    mask = np.random.default_rng(0).random((40, 60)) < 0.5
    for kernel in KERNELS:
        sensor = jl.Sensor(oversampling=2, frames=3, kernel=kernel, mask=mask)
        fired = sensor.expose(np.full((20, 30), 1e6), rng=0).to_array()
        np.testing.assert_array_equal(fired, np.broadcast_to(~mask, fired.shape))


def test_without_light_no_jot_fires():
    assert ones(jl.Sensor(oversampling=9).expose(np.zeros((90, 90)), rng=0).packed) == 0


def even_bits(rng=0, channels=2):
    sensor = jl.Sensor(frames=2)
    return sensor.expose(np.full((1001, 2000, channels), EVEN), rng=rng).to_array()


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
def test_jots_at_different_places_are_independent(which):
    """Jots that fire half of the time agree half of the time; false alarm: once in 10⁶ seeds."""
    one, other = INDEPENDENT[which](even_bits())
    agree = np.count_nonzero(one == other)
    assert binomtest(agree, one.size, 0.5).pvalue > FALSE_ALARM


def test_the_jots_of_a_word_are_independent():
    """All 2016 pairs of its 64 jots and the 256 bytes; false alarm of each: once in 10⁶ seeds."""
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
def test_the_same_bits_for_any_number_of_threads(threads, kernel):
    sensor = SENSOR.replace(kernel=kernel)
    bits = sensor.expose(IMAGE, rng=0, threads=threads)
    np.testing.assert_array_equal(bits.packed, sensor.expose(IMAGE, rng=0).packed)


def part_of(size):
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
    tile = (draw(part_of(height)), draw(part_of(width)))
    return sensor, image, tile, draw(part_of(frames)), draw(st.sampled_from([1, 2, 3, None]))


@settings(max_examples=5 * settings().max_examples)
@given(exposures(), st.integers(0, 2**64))
def test_a_part_holds_what_the_whole_holds_there(exposure, seed):
    sensor, image, tile, frames, threads = exposure
    whole = sensor.expose(image, rng=seed, threads=1)
    part = sensor.expose(image, rng=seed, tile=tile, frames=frames, threads=threads)
    rows, columns = (
        slice(side.start * sensor.oversampling, side.stop * sensor.oversampling) for side in tile
    )
    np.testing.assert_array_equal(part.to_array(), whole.to_array()[frames, rows, columns])
    repacked = np.packbits(part.to_array(), axis=2)
    np.testing.assert_array_equal(part.packed, repacked, err_msg="padding bits are not 0")
    for name, map_ in sensor.maps().items():
        np.testing.assert_array_equal(part.sensor.maps()[name], map_[rows, columns])
    share = sensor.gain / sensor.bits_per_pixel
    assert part.sensor.gain / part.sensor.bits_per_pixel == pytest.approx(share)


@pytest.mark.parametrize("oversampling", [1, 7])
@pytest.mark.parametrize("kernel", ["box", "quadratic"])
def test_parts_of_wide_rows_fit_too(oversampling, kernel):
    image = np.random.default_rng(0).random((1, 9001))
    sensor = jl.Sensor(oversampling=oversampling, kernel=kernel)
    whole = sensor.expose(image, rng=0).to_array()
    for start, stop in [(0, 4096), (1, 4097), (63, 8999), (585, 586), (4095, 9001)]:
        part = sensor.expose(image, rng=0, tile=(slice(None), slice(start, stop))).to_array()
        there = whole[:, :, start * oversampling : stop * oversampling]
        np.testing.assert_array_equal(part, there)


@pytest.mark.parametrize("size", [1, 600, 5000])
def test_the_same_bits_in_slabs_of_any_size(monkeypatch, size):
    image = np.random.default_rng(0).random((33, 41, 3))
    whole = SENSOR.expose(image, rng=0)
    rate = SENSOR.rate(image)
    monkeypatch.setattr("jotlight.chunks._MAX_JOTS", size)
    monkeypatch.setattr("jotlight.chunks._MIN_ROW_COST", 1)
    done = []
    np.testing.assert_array_equal(
        SENSOR.expose(image, rng=0, progress=done.append).packed, whole.packed
    )
    assert done == sorted(set(done))
    assert len(done) >= 6
    assert done[-1] == 1
    np.testing.assert_array_equal(SENSOR.rate(image), rate)
    np.testing.assert_array_equal(
        whole.counts(), whole.to_array().reshape(5, 33, 3, 41, 3, 3).sum(axis=(0, 2, 4))
    )


@pytest.mark.parametrize(
    "tile",
    [
        (slice(0, 0), slice(None)),
        (slice(None), slice(50, 60)),
        (slice(None, None, 2), slice(None)),
        (slice(None, None, -1), slice(None)),
        (),
        (slice(None),),
        (slice(None),) * 3,
    ],
)
def test_a_tile_that_is_no_part_of_the_image_is_refused(tile):
    with pytest.raises(ValueError, match="tile"):
        SENSOR.expose(IMAGE, rng=0, tile=tile)


@pytest.mark.parametrize("frames", [slice(5, 6), slice(0, 0), slice(None, None, 2)])
def test_frames_that_the_sensor_does_not_have_are_refused(frames):
    with pytest.raises(ValueError, match=r"frames: .*inside 0\.\.5"):
        SENSOR.expose(IMAGE, rng=0, frames=frames)


@pytest.mark.parametrize("part", [0, 1, [0], (0, 1)])
def test_a_part_that_is_no_slice_is_refused(part):
    with pytest.raises(TypeError, match="frames: expected a slice"):
        SENSOR.expose(IMAGE, rng=0, frames=part)
    with pytest.raises(TypeError, match="tile columns: expected a slice"):
        SENSOR.expose(IMAGE, rng=0, tile=(slice(None), part))


def test_a_seed_is_the_same_as_a_whole_number_or_sequence():
    bits = SENSOR.expose(IMAGE, rng=5).packed
    for seed in (np.int64(5), np.uint8(5), np.random.SeedSequence(5)):
        np.testing.assert_array_equal(SENSOR.expose(IMAGE, rng=seed).packed, bits)


def test_seeds_that_differ_give_other_bits():
    seeds = [0, 1, 2**32, 2**64, 2**200, None, None]
    seen = {SENSOR.expose(IMAGE, rng=seed).packed.tobytes() for seed in seeds}
    assert len(seen) == len(seeds)


def test_a_generator_gives_new_bits_each_time_and_the_same_from_the_same_state():
    one, other = np.random.default_rng(3), np.random.default_rng(3)
    first = SENSOR.expose(IMAGE, rng=one).packed
    second = SENSOR.expose(IMAGE, rng=one).packed
    assert (first != second).any()
    np.testing.assert_array_equal(SENSOR.expose(IMAGE, rng=other).packed, first)
    np.testing.assert_array_equal(SENSOR.expose(IMAGE, rng=other).packed, second)


@pytest.mark.parametrize("seed", [True, np.True_, "0", 0.0, [0], b"0", np.random.RandomState(0)])
def test_what_is_no_seed_is_refused(seed):
    with pytest.raises(TypeError, match="rng: expected a whole number"):
        SENSOR.expose(IMAGE, rng=seed)


@pytest.mark.parametrize("seed", [-1, np.int8(-1), -(2**70)])
def test_a_negative_seed_is_refused(seed):
    with pytest.raises(ValueError, match="rng: expected a seed of 0 or more"):
        SENSOR.expose(IMAGE, rng=seed)


SHAPE = (5, 99, 16)


@pytest.mark.parametrize(
    "make",
    [
        lambda folder: np.full(SHAPE, 255, np.uint8),
        lambda folder: np.full(SHAPE, 255, np.uint8, order="F"),
        lambda folder: np.full((*SHAPE, 2), 255, np.uint8)[..., 1],
        lambda folder: np.full((10, 99, 16), 255, np.uint8)[::-2],
        lambda folder: np.full((5, 99, 18), 255, np.uint8)[:, :, 1:-1],
        lambda folder: np.memmap(folder / "bits", np.uint8, "w+", shape=SHAPE),
        lambda folder: np.lib.format.open_memmap(folder / "b.npy", "w+", np.uint8, SHAPE),
    ],
    ids=["array", "fortran", "plane", "reversed", "inner", "memmap", "npy"],
)
def test_bits_go_to_the_array_that_is_given(make, tmp_path):
    out = make(tmp_path)
    bits = SENSOR.expose(IMAGE, rng=0, out=out)
    assert bits.packed is out
    np.testing.assert_array_equal(out, SENSOR.expose(IMAGE, rng=0).packed)


def test_bits_given_to_a_part_of_an_array_leave_the_rest_alone():
    out = np.full((5, 99, 18), 77, np.uint8)
    SENSOR.expose(IMAGE, rng=0, out=out[:, :, 1:-1])
    assert (out[:, :, [0, -1]] == 77).all()


@pytest.mark.parametrize(
    "out",
    [
        np.zeros((5, 99, 15), np.uint8),
        np.zeros((5, 99, 123), np.uint8),
        np.zeros((4, 99, 16), np.uint8),
        np.zeros((99, 16), np.uint8),
        np.zeros((5, 99, 16, 1), np.uint8),
        np.zeros(SHAPE, bool),
        np.zeros(SHAPE, np.int8),
        np.broadcast_to(np.uint8(0), SHAPE),
    ],
)
def test_an_array_that_does_not_fit_is_refused(out):
    with pytest.raises(ValueError, match=r"out: .*uint8 array of shape \(5, 99, 16\)"):
        SENSOR.expose(IMAGE, rng=0, out=out)


def test_the_bits_know_their_sensor_and_true_width():
    bits = SENSOR.expose(IMAGE, rng=0)
    assert bits.shape == (5, 99, 123)
    assert bits.sensor == SENSOR
    colour = SENSOR.expose(np.stack([IMAGE] * 4, axis=2), rng=0, frames=slice(1, 3))
    assert colour.shape == (2, 99, 123, 4)
    assert colour.sensor == SENSOR.replace(frames=2)
    np.testing.assert_array_equal(colour.packed[..., 0], bits.packed[1:3])
