"""Linear operators: the spread of light, differences, and scaling."""

import copy
import dataclasses
import pickle
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from jotlight.sensing.likelihood.operators import (
    Operator,
    check_adjoint,
    differences,
    scaling,
    spread,
)
from jotlight.sensing.sensor import KERNELS
from reference import sensing

RANDOM = np.random.default_rng(0)
SMALL = [(1,), (2,), (7,), (1, 1), (1, 3), (2, 1), (4, 3)]
LARGE = [(331,), (37, 50)]


@pytest.fixture(autouse=True, scope="module")
def taps():
    """Cache the reference's taps, which it computes for every line."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensing, "kernel_taps", cache(sensing.kernel_taps))
        yield


def reference_spread(image, kernel, oversampling):
    degree = sensing.DEGREES[kernel]
    for axis in range(image.ndim):
        image = np.apply_along_axis(sensing.spread, axis, image, degree, oversampling)
    return image


def columns(operator):
    """Return the matrix of an operator, column by column."""
    units = np.eye(int(np.prod(operator.input_shape)))
    return np.transpose([operator.forward(x.reshape(operator.input_shape)).ravel() for x in units])


def rows(operator):
    """Return the same matrix from its adjoint, row by row."""
    units = np.eye(int(np.prod(operator.output_shape)))
    return np.array([operator.adjoint(y.reshape(operator.output_shape)).ravel() for y in units])


@pytest.mark.parametrize(
    "oversampling", [1, 2, *(pytest.param(n, marks=pytest.mark.slow) for n in (3, 4)), 5]
)
@pytest.mark.parametrize("kernel", KERNELS)
def test_the_light_agrees_with_the_definition(kernel, oversampling):
    for shape in SMALL + LARGE:
        operator = spread(shape, oversampling, kernel, gain=2.5)
        assert operator.input_shape == shape
        assert operator.output_shape == tuple(oversampling * size for size in shape)
        image = RANDOM.standard_normal(shape)
        expected = 2.5 * reference_spread(image, kernel, oversampling)
        np.testing.assert_allclose(operator.forward(image), expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("kernel", KERNELS)
def test_the_light_of_a_pixel_of_many_jots_agrees_with_the_definition(kernel):
    operator = spread((2,), 500, kernel)
    expected = reference_spread(np.array([0.3, 0.9]), kernel, 500)
    np.testing.assert_allclose(operator.forward([0.3, 0.9]), expected, rtol=1e-12, atol=1e-16)
    assert check_adjoint(spread((2,), 4096, kernel)) < 1e-14


@pytest.mark.parametrize("oversampling", range(1, 6))
@pytest.mark.parametrize("kernel", KERNELS)
def test_the_adjoint_is_the_transposed_matrix(kernel, oversampling):
    for shape in SMALL:
        operator = spread(shape, oversampling, kernel, gain=0.7)
        matrix = columns(operator)
        np.testing.assert_allclose(rows(operator), matrix, rtol=1e-14, atol=1e-16)
        assert matrix.min() >= 0


@pytest.mark.parametrize("kernel", KERNELS)
def test_both_inner_products_are_equal_to_rounding(kernel):
    for shape in SMALL + LARGE:
        assert check_adjoint(spread(shape, 3, kernel, gain=0.3)) < 1e-14, shape


@pytest.mark.slow
@given(
    st.lists(st.integers(1, 12), min_size=1, max_size=2),
    st.integers(1, 9),
    st.sampled_from(KERNELS),
    st.floats(1e-6, 1e6),
    st.integers(0, 1000),
)
def test_both_inner_products_are_equal_for_any_operator(shape, oversampling, kernel, gain, rng):
    assert check_adjoint(spread(shape, oversampling, kernel, gain=gain), rng=rng) < 1e-13
    assert check_adjoint(differences(shape), rng=rng) < 1e-13


@pytest.mark.parametrize("kernel", KERNELS)
def test_a_constant_image_sheds_equal_light_on_all_jots(kernel):
    for shape in SMALL + LARGE:
        light = spread(shape, 3, kernel).forward(np.ones(shape))
        np.testing.assert_allclose(light, 3.0 ** -len(shape), rtol=1e-14)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("oversampling", [1, 2, 5])
def test_the_normal_operator_is_forward_then_weights_then_adjoint(kernel, oversampling):
    for shape in SMALL + LARGE:
        operator = spread(shape, oversampling, kernel, gain=1.7)
        image = RANDOM.standard_normal(shape)
        weights = RANDOM.standard_normal(operator.output_shape)
        expected = operator.adjoint(weights * operator.forward(image))
        np.testing.assert_allclose(
            operator.normal(weights, image), expected, rtol=1e-12, atol=1e-13
        )


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", [(1, 1), (6, 9)])
def test_light_is_the_rate_of_a_sensor(kernel, shape):
    sensor = jl.Sensor(oversampling=4, frames=3, gain=70.0, efficiency=0.6, kernel=kernel)
    gain = sensor.efficiency * sensor.gain / sensor.frames
    operator = spread(shape, 4, kernel, gain=gain)
    image = RANDOM.random(shape)
    np.testing.assert_allclose(operator.forward(image), sensor.rate(image), rtol=3e-7)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("shape", [(5,), (1000,), (1, 1), (83, 61)])
def test_the_result_does_not_depend_on_the_number_of_threads(kernel, shape):
    image = RANDOM.standard_normal(shape)
    light = RANDOM.standard_normal([3 * size for size in shape])
    planes = RANDOM.standard_normal((len(shape), *shape))
    results = []
    for threads in (1, 2, 7):
        operator = spread(shape, 3, kernel, gain=0.9, threads=threads)
        change = differences(shape, threads=threads)
        results.append(
            operator.forward(image).tobytes()
            + operator.adjoint(light).tobytes()
            + operator.normal(light, image).tobytes()
            + change.forward(image).tobytes()
            + change.adjoint(planes).tobytes()
        )
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize("make", [spread, differences])
@pytest.mark.parametrize("change", [np.asfortranarray, lambda x: x[::-1, ::-1], np.ndarray.tolist])
def test_arrays_of_any_layout_are_accepted_and_left_unchanged(make, change):
    operator = make((3, 4))
    image = RANDOM.integers(0, 9, (3, 4))
    argument = change(image)
    before = np.array(argument)
    light = operator.forward(argument)
    np.testing.assert_array_equal(light, operator.forward(before.astype(float)))
    np.testing.assert_array_equal(argument, before)


@pytest.mark.parametrize("shape", [(1,), (2,), (300,)])
def test_differences_of_a_signal_agree_with_numpy(shape):
    signal = RANDOM.standard_normal(shape)
    expected = np.append(np.diff(signal), 0)[None]
    np.testing.assert_array_equal(differences(shape).forward(signal), expected)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (6, 1), (40, 31)])
def test_differences_of_an_image_agree_with_numpy(shape):
    image = RANDOM.standard_normal(shape)
    down = np.diff(image, axis=0, append=image[-1:])
    right = np.diff(image, axis=1, append=image[:, -1:])
    np.testing.assert_array_equal(differences(shape).forward(image), [down, right])


@pytest.mark.parametrize("shape", [*SMALL, (3, 5)])
def test_the_adjoint_of_differences_is_the_transposed_matrix(shape):
    np.testing.assert_array_equal(rows(differences(shape)), columns(differences(shape)))
    assert check_adjoint(differences(shape)) < 1e-14


def test_the_adjoint_ignores_differences_past_the_border():
    planes = np.full((2, 3, 4), 7.0)
    planes[0, :-1] = planes[1, :, :-1] = 0
    np.testing.assert_array_equal(differences((3, 4)).adjoint(planes), 0)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3), (2, 3, 4)])
def test_scaling_multiplies_forward_and_back(shape):
    operator = scaling(shape, -1.5)
    image, weights = RANDOM.standard_normal((2, *shape))
    np.testing.assert_array_equal(operator.forward(image), -1.5 * image)
    np.testing.assert_array_equal(operator.adjoint(image), -1.5 * image)
    np.testing.assert_allclose(operator.normal(weights, image), 2.25 * weights * image, rtol=1e-15)
    assert operator.factor == -1.5
    assert check_adjoint(operator) < 1e-15


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"shape": ()}, r"shape: expected \(H, W\) or \(N,\), without a dimension of 0, got \(\)"),
        ({"shape": (0,)}, r"shape: .*got \(0,\)"),
        ({"shape": (3, 0)}, r"shape: .*got \(3, 0\)"),
        ({"shape": (-1, 2)}, r"shape: .*got \(-1, 2\)"),
        ({"shape": (2, 2, 3)}, r"shape: .*got \(2, 2, 3\)"),
        ({"oversampling": 0}, "oversampling: expected a whole number from 1 to 4096, got 0"),
        ({"oversampling": -3}, "oversampling: .*got -3"),
        ({"oversampling": 1.5}, "oversampling: .*got 1.5"),
        ({"oversampling": 4097}, "oversampling: .*got 4097"),
        ({"oversampling": np.nan}, "oversampling: .*got nan"),
        ({"kernel": "gauss"}, "kernel: expected one of box, linear, quadratic, cubic, got 'gauss'"),
        ({"kernel": 3}, "kernel: .*got 3"),
        ({"gain": 0.0}, "gain: expected a finite number above 0, got 0.0"),
        ({"gain": -1.0}, "gain: .*got -1.0"),
        ({"gain": np.inf}, "gain: .*got inf"),
        ({"gain": np.nan}, "gain: .*got nan"),
    ],
    ids=str,
)
def test_parameters_out_of_range_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        spread(**{"shape": (3, 4)} | arguments)


@pytest.mark.parametrize("shape", [(), (0,), (3, 0), (1, 2, 3)])
def test_differences_of_other_shapes_are_refused(shape):
    with pytest.raises(ValueError, match=r"shape: expected \(H, W\) or \(N,\)"):
        differences(shape)


def test_arrays_of_other_shapes_are_refused():
    operator = spread((3, 4), 2)
    with pytest.raises(ValueError, match=r"image: expected shape \(3, 4\), got \(4, 3\)"):
        operator.forward(np.ones((4, 3)))
    with pytest.raises(ValueError, match=r"jots: expected shape \(6, 8\), got \(48,\)"):
        operator.adjoint(np.ones(48))
    with pytest.raises(ValueError, match=r"weights: expected shape \(6, 8\), got \(3, 4\)"):
        operator.normal(np.ones((3, 4)), np.ones((3, 4)))
    with pytest.raises(ValueError, match=r"image: expected shape \(3, 4\), got \(\)"):
        operator.normal(np.ones((6, 8)), 1.0)
    with pytest.raises(ValueError, match=r"image: expected shape \(5,\), got \(1, 1, 5\)"):
        spread((5,)).forward(np.ones((1, 1, 5)))
    with pytest.raises(ValueError, match=r"image: expected shape \(5,\), got \(6,\)"):
        differences((5,)).forward(np.ones(6))
    with pytest.raises(ValueError, match=r"differences: expected shape \(1, 5\), got \(5,\)"):
        differences((5,)).adjoint(np.ones(5))
    with pytest.raises(ValueError, match=r"array: expected shape \(2,\), got \(3,\)"):
        scaling((2,), 1.0).forward(np.ones(3))


def halve(array):
    return array / 2


@pytest.mark.parametrize(
    "operator",
    [
        jl.operators.spread((4, 6), 2, "linear", gain=3.0, threads=1),
        jl.operators.scaling((4, 6), 2.0),
        jl.operators.differences((4, 6)),
        Operator(halve, halve, (4, 6), (4, 6)),
    ],
    ids=["spread", "scaling", "differences", "own"],
)
def test_operators_are_pickled_and_copied(operator):
    image = np.arange(24.0).reshape(4, 6)
    for other in (pickle.loads(pickle.dumps(operator)), copy.deepcopy(operator)):
        assert type(other) is type(operator)
        np.testing.assert_array_equal(other.forward(image), operator.forward(image))
        np.testing.assert_array_equal(other.forward(image[None]), operator.forward(image[None]))
        weights = np.ones(operator.output_shape)
        np.testing.assert_array_equal(other.normal(weights, image), operator.normal(weights, image))


def test_problems_are_pickled():
    problem = jl.Problem(jl.operators.spread((4,), 2), jl.Likelihood(np.ones(8, int), trials=4))
    other = pickle.loads(pickle.dumps(problem))
    assert other.log_likelihood(np.ones(4)) == problem.log_likelihood(np.ones(4))


def test_a_changed_copy_is_not_pickled_as_the_original():
    changed = dataclasses.replace(
        jl.operators.differences((4,)), forward=halve, adjoint=halve, output_shape=(4,)
    )
    other = pickle.loads(pickle.dumps(changed))
    assert other.forward(np.ones(4)).tolist() == [0.5] * 4
