"""Operators and likelihoods of a stack of images."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.data.stacks import dots, image_means, image_sums, replace, select
from jotlight.sensing.likelihood.operators import Operator, differences, scaling, spread


@pytest.mark.parametrize("shape", [(7,), (5, 6)])
@pytest.mark.parametrize("kind", ["spread", "differences", "scaling", "own"])
def test_a_stack_has_the_same_results_as_its_images(kind, shape):
    matrix = np.random.default_rng(0).random((4, int(np.prod(shape))))
    operator = {
        "spread": spread(shape, 3, "quadratic", gain=0.7),
        "differences": differences(shape),
        "scaling": scaling(shape, 3.0),
        "own": Operator(
            lambda x: matrix @ x.ravel(), lambda y: (y @ matrix).reshape(shape), shape, (4,)
        ),
    }[kind]
    rng = np.random.default_rng(1)
    images = rng.standard_normal((3, *operator.input_shape))
    others, weights = (rng.standard_normal((3, *operator.output_shape)) for _ in range(2))
    pairs = [
        (operator.forward(images), [operator.forward(each) for each in images]),
        (operator.adjoint(others), [operator.adjoint(each) for each in others]),
        (
            operator.normal(weights, images),
            [operator.normal(*each) for each in zip(weights, images, strict=True)],
        ),
    ]
    for stack, each in pairs:
        np.testing.assert_array_equal(stack, np.stack(each))


@pytest.mark.parametrize("maps", [False, True])
def test_the_likelihood_of_a_stack_is_that_of_each_image(maps):
    rng = np.random.default_rng(2)
    trials = rng.integers(3, 9, (3, 5, 7)) + 0.5 if maps else 9
    ones = rng.integers(0, 4, (3, 5, 7))
    options = {"dark_counts": rng.random((3, 5, 7))} if maps else {}
    light = rng.random((3, 5, 7))
    stack = jl.Likelihood(ones, trials, threshold=2, **options)
    values, (gradient, curvature) = stack.values(light), stack.gradient_and_curvature(light)
    assert values.sum() == pytest.approx(stack.value(light), rel=1e-14)
    for index in range(3):
        one = stack.select(np.arange(3) == index)
        own = {name: option[index] for name, option in options.items()}
        n = trials[index] if maps else trials
        alone = jl.Likelihood(ones[index], n, threshold=2, **own)
        assert values[index] == alone.value(light[index]) == one.values(light[index : index + 1])
        both = alone.gradient_and_curvature(light[index])
        np.testing.assert_array_equal([gradient[index], curvature[index]], both)


@pytest.mark.parametrize("shape", [(1,), (3, 5), (90, 111), (300, 300)])
def test_the_sum_of_an_image_does_not_depend_on_the_other_images(shape):
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(2, 5, *shape))
    for index in range(5):
        one = slice(index, index + 1)
        assert dots(a[one], b[one])[0] == dots(a, b)[index]
        assert image_means(a[one])[0] == image_means(a)[index]
        np.testing.assert_allclose(image_sums(a)[index], a[index].sum(), rtol=1e-9)


def test_some_images_are_selected_and_replaced():
    stack, images = np.arange(6.0).reshape(3, 2), np.array([True, False, True])
    np.testing.assert_array_equal(select(stack, images), [[0, 1], [4, 5]])
    assert select(stack, np.ones(3, bool)) is stack
    other = replace(stack.copy(), images, np.zeros((2, 2)))
    np.testing.assert_array_equal(other, [[0, 0], [2, 3], [0, 0]])
    np.testing.assert_array_equal(replace(stack, np.ones(3, bool), other), other)


def test_a_problem_whose_stack_has_an_image_without_bits_is_refused():
    trials = np.array([[1, 2], [0, 0]])
    with pytest.raises(ValueError, match="at least one cell with a bit"):
        jl.Problem(scaling((2,), 1.0), jl.Likelihood(np.zeros((2, 2), int), trials))


@pytest.mark.parametrize("method", [jl.mle_iterative, jl.admm_tv])
def test_a_problem_of_a_stack_has_the_estimates_of_its_images(method):
    ones = np.random.default_rng(4).integers(0, 10, (3, 20))
    light = spread((10,), 2, "linear", gain=2.0)
    estimates, histories = method(jl.Problem(light, jl.Likelihood(ones, 10)), return_history=True)
    for index in range(3):
        alone, history = method(
            jl.Problem(light, jl.Likelihood(ones[index], 10)), return_history=True
        )
        np.testing.assert_array_equal(estimates[index], alone)
        assert histories[index].objective == history.objective
        assert histories[index].iterations == history.iterations
