"""The checks of arguments that several modules share."""

import re
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl
from jotlight.checks import (
    as_image,
    positive_number,
    real_number,
    require_intensities,
    to_array,
    whole_number,
    whole_number_in_range,
)


@pytest.mark.parametrize("value", [1, np.int64(1), np.uint8(1)])
def test_a_whole_number_becomes_a_plain_int(value):
    assert type(whole_number("steps", value, 1)) is int


@pytest.mark.parametrize("value", [1.0, "1", None, [1], True, np.bool_(1)])
def test_other_types_are_not_whole_numbers(value):
    with pytest.raises(TypeError, match="steps: expected a whole number, got"):
        whole_number("steps", value, 1)


def test_a_whole_number_below_the_minimum_is_refused():
    with pytest.raises(ValueError, match="steps: expected at least 1, got 0"):
        whole_number("steps", 0, 1)


@pytest.mark.parametrize("value", [4, 4.0, np.float32(4), np.array(4)])
def test_whole_floats_are_whole_numbers_in_range(value):
    number = whole_number_in_range("threshold", value, 1, 10)
    assert (number, type(number)) == (4, int)


@pytest.mark.parametrize("value", [0, 11, 1.5, np.nan, np.inf, True, "4", None, [4], 4j])
def test_anything_else_is_not_a_whole_number_in_range(value):
    with pytest.raises(ValueError, match="threshold: expected a whole number from 1 to 10, got"):
        whole_number_in_range("threshold", value, 1, 10)


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.array(2)])
def test_a_positive_number_becomes_a_plain_float(value):
    number = positive_number("gain", value)
    assert (number, type(number)) == (2.0, float)


@pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf, True, "2", None, [2.0], 2j])
def test_anything_else_is_not_a_positive_number(value):
    with pytest.raises(ValueError, match="gain: expected a finite number above 0, got"):
        positive_number("gain", value)


@pytest.mark.parametrize("value", [True, "1", None, [1.0], 1j])
def test_anything_but_a_single_real_number_is_nan(value):
    assert np.isnan(real_number(value))


def test_an_image_of_bool_becomes_floats_without_a_division():
    image = np.eye(4, dtype=bool)
    for check in (as_image, lambda image: require_intensities("truth", image)):
        message = r"(image|truth): expected floats in units of intensity, got bool; pass (\S+),"
        with pytest.raises(TypeError, match=message) as error:
            check(image)
        converted = eval(re.search(message, str(error.value))[2], {"image": image})
        np.testing.assert_array_equal(as_image(converted), image)


def test_an_image_of_anything_but_numbers_has_no_scale():
    with pytest.raises(TypeError, match=r"got complex128$"):
        as_image(np.ones((2, 2), complex))


@pytest.mark.parametrize("folder", ["folder", Path("folder")])
def test_a_path_in_place_of_an_image_is_named(folder):
    with pytest.raises(TypeError, match="image: expected an array, got the path 'folder'; pass"):
        as_image(folder)


BITS = jl.Sensor(frames=16).expose(np.full((16, 16), 0.5), rng=0)


@pytest.mark.parametrize("data", [BITS, [BITS, BITS]], ids=["bits", "list"])
@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("ones", jl.Likelihood),
        ("counts", lambda bits: jl.vst.anscombe(bits, 16)),
        ("z", lambda bits: jl.vst.inverse_anscombe(bits, 16)),
        ("image", jl.denoise.tv),
        ("image", jl.denoise.gaussian),
        ("image", jl.operators.spread((16, 16)).forward),
        ("array", jl.operators.scaling((16, 16, 16), 2.0).forward),
        ("estimate", lambda bits: jl.metrics.psnr(bits, bits)),
        ("image", lambda bits: jl.Sensor().expose(bits, rng=0)),
        ("image", lambda bits: jl.save_image("image.png", bits)),
    ],
)
def test_bits_are_no_array_of_numbers(name, function, data):
    with pytest.raises(
        TypeError, match=rf"{name}: expected an array, got Bits; .* bits.counts\(\)"
    ):
        function(data)


RAGGED = [[1], [2, 3]]


@pytest.mark.parametrize(
    ("values", "found"),
    [
        (RAGGED, "rows of 1 and 2"),
        ([[[1, 2]], [[1, 2], [3, 4]]], "rows of 1 and 2"),
        ([[[1, 2], [3]], [[1, 2], [3, 4]]], "rows of 2 and 1"),
        ([1, [2]], "single values beside rows"),
    ],
    ids=str,
)
def test_rows_of_different_lengths_are_named(values, found):
    with pytest.raises(ValueError, match=f"^x: expected rows of the same length, got {found}; "):
        to_array("x", values)


def test_numbers_that_numpy_does_not_know_are_refused():
    torch = pytest.importorskip("torch")
    with pytest.raises(TypeError, match=r"^image: .* got bfloat16; pass tensor\.float\(\)"):
        jl.Sensor().expose(torch.ones(4, 4, dtype=torch.bfloat16))


class Table:
    """A table of pandas whose columns may lack values: NumPy gets objects."""

    def __array__(self, dtype=None, copy=None):
        return np.ones((4, 4), object)

    def to_numpy(self, dtype):
        return np.ones((4, 4), dtype)


@pytest.mark.parametrize(
    ("values", "advice"),
    [
        (Table(), r"got Table; pass x\.to_numpy\(int\)"),
        (np.ones((4, 4), object), r"x\.astype\(int\)"),
    ],
    ids=["table", "array"],
)
def test_whole_numbers_as_objects_have_advice(values, advice):
    with pytest.raises(TypeError, match=advice):
        jl.mle(values, jl.Sensor(frames=4))


def test_an_array_stays_itself():
    array = np.ones((2, 3))
    assert to_array("x", array) is array
    np.testing.assert_array_equal(to_array("x", [[1, 2], [3, 4]]), [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("data", lambda: jl.save(RAGGED, "a.npy")),
        ("bits", lambda: jl.Bits.from_array(RAGGED)),
        ("image", lambda: jl.save_image("a.tif", RAGGED)),
        ("image", lambda: jl.Sensor().expose(RAGGED)),
        ("counts", lambda: jl.calibrate(RAGGED, frames=3)),
        ("readings", lambda: jl.Readings(RAGGED, jl.Sensor(bit_depth=2))),
        ("estimate", lambda: jl.metrics.psnr(RAGGED, np.ones((2, 2)))),
        ("gain", lambda: jl.Sensor(gain=RAGGED)),
        ("threshold", lambda: jl.Sensor(threshold=RAGGED)),
        ("efficiency", lambda: jl.Sensor(efficiency=RAGGED)),
        ("mask", lambda: jl.Sensor(mask=RAGGED)),
        ("light", lambda: jl.plan_brackets(jl.Sensor(), RAGGED)),
    ],
)
def test_public_functions_name_the_parameter(name, call):
    with pytest.raises(ValueError, match=f"^{name}: expected rows of the same length, got rows"):
        call()
