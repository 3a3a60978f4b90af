"""The arguments of `Sensor.expose`: tiles, frames, seeds, and output arrays."""

import numpy as np
import pytest

import jotlight as jl

SENSOR = jl.Sensor(oversampling=3, frames=5, kernel="linear", threshold=2, gain=90)
IMAGE = np.random.default_rng(1).random((33, 41))


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
def test_a_tile_that_is_not_inside_the_image_is_refused(tile):
    with pytest.raises(ValueError, match="tile"):
        SENSOR.expose(IMAGE, rng=0, tile=tile)


@pytest.mark.parametrize("frames", [slice(5, 6), slice(0, 0), slice(None, None, 2)])
def test_frames_that_the_sensor_does_not_have_are_refused(frames):
    with pytest.raises(ValueError, match=r"frames: .*inside 0\.\.5"):
        SENSOR.expose(IMAGE, rng=0, frames=frames)


@pytest.mark.parametrize("part", [0, 1, [0], (0, 1)])
def test_a_part_that_is_not_a_slice_is_refused(part):
    with pytest.raises(TypeError, match="frames: expected a slice"):
        SENSOR.expose(IMAGE, rng=0, frames=part)
    with pytest.raises(TypeError, match="tile columns: expected a slice"):
        SENSOR.expose(IMAGE, rng=0, tile=(slice(None), part))


def test_a_whole_number_and_its_seed_sequence_are_the_same_seed():
    bits = SENSOR.expose(IMAGE, rng=5).packed
    for seed in (np.int64(5), np.uint8(5), np.random.SeedSequence(5)):
        np.testing.assert_array_equal(SENSOR.expose(IMAGE, rng=seed).packed, bits)


def test_different_seeds_make_different_bits():
    seeds = [0, 1, 2**32, 2**64, 2**200, None, None]
    seen = {SENSOR.expose(IMAGE, rng=seed).packed.tobytes() for seed in seeds}
    assert len(seen) == len(seeds)


def test_a_generator_makes_new_bits_each_time_and_the_same_bits_from_the_same_state():
    one, other = np.random.default_rng(3), np.random.default_rng(3)
    first = SENSOR.expose(IMAGE, rng=one).packed
    second = SENSOR.expose(IMAGE, rng=one).packed
    assert (first != second).any()
    np.testing.assert_array_equal(SENSOR.expose(IMAGE, rng=other).packed, first)
    np.testing.assert_array_equal(SENSOR.expose(IMAGE, rng=other).packed, second)


@pytest.mark.parametrize("seed", [True, np.True_, "0", 0.0, [0], b"0", np.random.RandomState(0)])
def test_objects_that_are_not_seeds_are_refused(seed):
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
    ids=["array", "fortran", "channel", "reversed", "inner", "memmap", "npy"],
)
def test_bits_are_written_to_out(make, tmp_path):
    out = make(tmp_path)
    bits = SENSOR.expose(IMAGE, rng=0, out=out)
    assert bits.packed is out
    np.testing.assert_array_equal(out, SENSOR.expose(IMAGE, rng=0).packed)


def test_bits_written_to_a_part_of_an_array_leave_the_rest_unchanged():
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
def test_out_of_another_shape_or_type_is_refused(out):
    with pytest.raises(ValueError, match=r"out: .*array of uint8 of shape \(5, 99, 16\)"):
        SENSOR.expose(IMAGE, rng=0, out=out)


def test_the_bits_carry_their_sensor_and_true_width():
    bits = SENSOR.expose(IMAGE, rng=0)
    assert bits.shape == (5, 99, 123)
    assert bits.sensor == SENSOR
    color = SENSOR.expose(np.stack([IMAGE] * 4), rng=0, channel_axis=0, frames=slice(1, 3))
    assert color.shape == (2, 99, 123, 4)
    assert color.sensor == SENSOR.replace(frames=2)
    np.testing.assert_array_equal(color.packed[..., 0], bits.packed[1:3])


@pytest.mark.parametrize(("white", "dtype"), [(255, np.float32), (65535, np.float64)])
def test_values_of_an_integer_image_are_reported(white, dtype):
    image = np.rint(white * IMAGE).astype(dtype)
    image.flat[0] = white
    message = rf"whole numbers up to {white}; .* image / {white}"
    with pytest.warns(jl.JotlightWarning, match=message):
        SENSOR.expose(image, rng=0)


def test_gray_levels_of_floats_are_reported():
    message = r"max_intensity=1, but most of them exceed 10, up to 254.*image / 255 \(--white 255\)"
    with pytest.warns(jl.JotlightWarning, match=message):
        SENSOR.expose(254.7 * IMAGE, rng=0)
    with pytest.warns(jl.JotlightWarning, match=r"Sensor\(max_intensity=…\) \(--max-intensity\)"):
        SENSOR.rate(40000.5 * IMAGE)
    SENSOR.replace(max_intensity=255).expose(254.7 * IMAGE, rng=0)


def test_bright_light_is_not_reported():
    SENSOR.expose(np.where(IMAGE > 0.6, 200 * IMAGE, IMAGE), rng=0)
    SENSOR.expose(np.full((4, 4), 9.0), rng=0)
    SENSOR.expose(np.full((4, 4), 1e6), rng=0)


def test_a_channel_that_looks_like_transparency_is_warned_about():
    sensor = jl.Sensor(frames=2)
    image = np.random.default_rng(0).random((4, 6, 8, 5))
    sensor.expose(image, rng=0, channel_axis=1)
    sensor.expose(np.ones((4, 8, 5)), rng=0, channel_axis=0)
    image[:, 3, :, :] = 1.0
    sensor.expose(image, rng=0, channel_axis=1)  # six channels
    opaque = image[:, :4]
    opaque[0, 3, 5, 3] = 0.5
    sensor.expose(opaque, rng=0, channel_axis=1)
    with pytest.warns(jl.JotlightWarning, match=r"1 everywhere, .* pass image\[\.\.\., :3\]"):
        sensor.expose(opaque[1:], rng=0, channel_axis=1)
