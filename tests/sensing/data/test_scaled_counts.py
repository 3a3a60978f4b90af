"""Counts of images that hold the means of frames, times a scale."""

import re

import numpy as np
import pytest

import jotlight as jl
from examples.arrays import random_frames
from jotlight.datasets import photograph
from jotlight.sensing.data.scaled_counts import (
    check_trials,
    find_fewer_trials,
    recognize_trials,
    scaled_counts_hint,
    unscale_counts,
)


@pytest.mark.parametrize("rounding", [np.rint, np.floor, lambda x: np.floor(x + 0.5)])
@pytest.mark.parametrize("scale", [255, 65535, 1000])
def test_all_counts_are_found_for_all_numbers_of_trials(rounding, scale):
    for trials in range(1, min(1000, int(scale / 1.5)) + 1):
        counts = np.arange(trials + 1)
        values = rounding(counts * scale / trials).astype(np.int64)
        np.testing.assert_array_equal(unscale_counts(values, scale, trials), counts)


@pytest.mark.parametrize("trials", [3, 4, 16, 64, 100])
def test_the_number_of_trials_is_recognized(trials):
    counts = random_frames((trials, 40, 50), share=0.6).sum(0)
    for scale in (255, 65535):
        values = np.rint(counts * scale / trials).astype(np.int64)
        assert recognize_trials(values, scale) == trials
        assert f"trials={trials} (--trials {trials})" in scaled_counts_hint(values)


@pytest.mark.parametrize(
    "values",
    [
        np.arange(20),
        random_frames((30, 20, 20)).sum(0),
        np.rint(255 * photograph("camera")).astype(int),
        np.array([-255, 0, 64, 128]),
        np.array([0, 100, 70000]),
        2 * np.arange(9),
        2 * np.arange(40),
    ],
)
def test_counts_photographs_and_bits_have_no_scale(values):
    assert scaled_counts_hint(values) is None


@pytest.mark.parametrize("values", [[-16, 16], [0, 17, 32], [0, 271], [1, 2, 3]])
def test_other_values_are_refused(values):
    with pytest.raises(ValueError, match=r"counts_scale: expected (multiples of 255 / 16|values)"):
        unscale_counts(np.array(values), 255, 16)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("scale", [1, 255])
def test_float_means_of_all_numbers_of_trials_are_counts(dtype, scale):
    for trials in (1, 3, 16, 255, 1000, 65535):
        counts = np.arange(trials + 1)
        means = (counts.astype(np.float32) / np.float32(trials) * np.float32(scale)).astype(dtype)
        np.testing.assert_array_equal(unscale_counts(means, scale, trials), counts)
    assert recognize_trials(np.arange(17).astype(dtype) / 16, 1) == 16


def test_floats_that_hold_rounded_means_are_counts():
    values = np.rint(np.arange(17) * 255 / 16).astype(np.float32)
    np.testing.assert_array_equal(unscale_counts(values, 255, 16), np.arange(17))


@pytest.mark.parametrize("value", [0.03, 0.0624, np.nan, np.inf, -1.0, 17 / 16])
def test_other_floats_are_refused(value):
    with pytest.raises(ValueError, match=r"counts_scale: expected (multiples of 1 / 16|values)"):
        unscale_counts(np.array([0, value], np.float32), 1, 16)


def test_the_type_limits_the_number_of_trials():
    check_trials(np.dtype(np.float16), 1, 64)
    with pytest.raises(ValueError, match="at most 64, because float16 rounds"):
        check_trials(np.dtype(np.float16), 1, 65)
    with pytest.raises(ValueError, match=r"holds uint8 .* only floats hold means"):
        check_trials(np.dtype(np.uint8), 1, 16)


@pytest.mark.parametrize("factor", [2, 4, 8])
def test_a_multiple_of_the_number_of_trials_is_found(factor):
    counts = random_frames((16, 20, 30)).sum(0)
    values = np.rint(counts * 255 / 16).astype(int)
    assert find_fewer_trials(unscale_counts(values, 255, 16 * factor), 16 * factor) == 16
    assert find_fewer_trials(unscale_counts(values, 255, 16), 16) is None


def test_few_counts_in_a_dark_image_allow_no_conclusion():
    counts = np.zeros((20, 30), int)
    assert find_fewer_trials(counts, 16) is None
    counts[0, :15] = 2
    assert find_fewer_trials(counts, 16) is None
    counts[0, 15] = 4
    assert find_fewer_trials(counts, 16) == 8
    counts[1, 1] = 1
    assert find_fewer_trials(counts, 16) is None


@pytest.mark.parametrize("scale", [255, 65535])
def test_black_and_white_images_are_proposed_as_bits(scale):
    values = random_frames((20, 30)) * np.uint16(scale)
    hint = scaled_counts_hint(values)
    assert f"only 0 and {scale}" in hint
    assert "(--unpacked)" in hint
    with pytest.raises(ValueError, match=r"0 to K = 1 .*--unpacked"):
        jl.mle(values, jl.Sensor(frames=1))


def test_the_formula_for_arrays_returns_the_counts():
    counts = random_frames((16, 20, 30)).sum(0)
    values = np.rint(counts * 255 / 16).astype(np.uint8)
    with pytest.raises(ValueError, match="K = 16") as error:
        jl.reconstruct(values, jl.Sensor(frames=16))
    formula = "np.rint(x / 255 * 16).astype(int)"
    assert formula in str(error.value)
    np.testing.assert_array_equal(eval(formula, {"np": np, "x": values}), counts)


def test_methods_propose_the_scale_of_scaled_counts():
    values = np.array([[0, 16, 64, 255]])
    with pytest.raises(ValueError, match=r"0 to K = 16 .*counts_scale=255 .* and trials=16"):
        jl.mle(values, jl.Sensor(frames=16))


def test_floats_in_place_of_counts_say_how_to_convert_them():
    counts = np.arange(64, dtype=int).reshape(8, 8) % 17
    for floats, call in ((counts / 16, r"x \* 16"), (counts * 255 / 16, r"x / 255 \* 16")):
        message = rf"np.rint\({call}\).astype\(int\), with Sensor\(frames=16\)"
        with pytest.raises(TypeError, match=message):
            jl.mle(floats, jl.Sensor(frames=255))
    with pytest.raises(TypeError, match=r"cast rounded floats with astype\(int\)"):
        jl.mle(counts.astype(float), jl.Sensor(frames=16))


def test_fractions_that_are_no_means_are_not_taken_for_means():
    counts = np.arange(64).reshape(8, 8) % 9
    for fractions in (counts + 0.5, counts * 0.7, counts * 40.0 + 0.25):
        with pytest.raises(TypeError, match="got float64; fractions are no counts") as error:
            jl.mle(fractions, jl.Sensor(frames=8))
        assert "means" not in str(error.value)


def test_not_a_number_in_place_of_counts_is_named():
    sensor = jl.Sensor(frames=8)
    counts = np.arange(64).reshape(8, 8) % 9
    x = np.where(counts == 3, np.nan, counts)
    with pytest.raises(TypeError, match="got float64 with NaN; if these pixels x have") as error:
        jl.mle(x, sensor)
    advice = re.fullmatch(".*pass (.*) and trials=(.*)", str(error.value))
    arrays = [eval(formula, {"np": np, "x": x}) for formula in advice.groups()]
    with pytest.warns(jl.JotlightWarning, match="no valid bit"):
        estimate = jl.mle(arrays[0], sensor, trials=arrays[1])
    known = np.isfinite(x)
    np.testing.assert_array_equal(estimate[known], jl.mle(counts, sensor)[known])
    for other in (x / 8, np.where(known, counts, np.inf)):
        with pytest.raises(TypeError, match=r"got float64 with NaN or infinity$"):
            jl.mle(other, sensor)


def test_counts_that_look_like_means_are_warned_about():
    means = np.rint(np.arange(64).reshape(8, 8) % 17 * 255 / 16).astype(np.uint8)
    with pytest.warns(jl.JotlightWarning, match=r"look like means of 16 frames times 255"):
        jl.mle(means, jl.Sensor(frames=255))
    jl.mle(np.arange(256).reshape(16, 16), jl.Sensor(frames=255))


def test_unpacked_frames_in_place_of_a_stack_of_counts_are_reported():
    sensor = jl.Sensor(frames=16)
    frames = sensor.expose(np.full((8, 9), 0.4), rng=0).to_array().astype(np.uint8)
    with pytest.warns(jl.JotlightWarning, match=r"16 images of nothing but 0 and 1 .*from_array"):
        assert jl.mle(frames, sensor).shape == (16, 8, 9)
    hwt = np.moveaxis(frames, 0, 2)
    with pytest.warns(jl.JotlightWarning, match=r"16 columns of nothing but 0 and 1") as warned:
        jl.mle(hwt, sensor)
    call = re.search(r"(jotlight\.Bits\.from_array\(.*\)) makes", str(warned[0].message))[1]
    bits = eval(call, {"np": np, "jotlight": jl, "frames": hwt, "sensor": sensor})
    np.testing.assert_array_equal(bits.to_array(), frames)
    jl.mle(frames, jl.Sensor(frames=1))
    jl.mle(hwt, jl.Sensor(frames=4))
    jl.mle(frames[:5], sensor)
    # A pair of dim images has no count of 2 by chance.
    pair = np.stack(
        [each.counts() for each in jl.Sensor(frames=2).expose([np.full((8, 9), 0.05)] * 2, rng=0)]
    )
    assert pair.max() == 1
    jl.mle(pair, jl.Sensor(frames=2))
