"""Fields of displacements from normal equations: the twins, exact fields, outliers, bad input."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jotlight import _engine as engine
from jotlight.motion.displacements.regularize import Equations, Smoothness, fit_affine, solve_field
from jotlight.motion.tiles import affine_basis
from reference import motion as reference

SHAPE = 8, 10
ALL = np.ones(SHAPE)
RNG = np.random.default_rng(0)


def random_information(scale=20.0, rng=RNG, shape=SHAPE):
    roots = rng.normal(size=(2, 3, *shape))
    return scale * np.stack(
        [
            (roots[0] ** 2).sum(axis=0),
            (roots[0] * roots[1]).sum(axis=0),
            (roots[1] ** 2).sum(axis=0),
        ]
    )


def product(information, vectors):
    rows, mixed, columns = information
    return np.stack(
        [rows * vectors[0] + mixed * vectors[1], mixed * vectors[0] + columns * vectors[1]]
    )


def equations_of(errors, information):
    """Return the normal equations whose solution is a field of errors."""
    return Equations(information, product(information, errors))


def affine_field(parameters):
    return (np.reshape(parameters, (2, 3)) @ affine_basis(SHAPE).T).reshape(2, *SHAPE)


@st.composite
def cases(draw):
    """Draw equations, weights of tiles, two fields, and a smoothness."""
    shape = draw(st.integers(1, 20)), draw(st.integers(1, 20))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    scale = draw(st.sampled_from([0.0, 0.1, 10.0, 1e4]))
    information = random_information(scale, rng, shape) * (rng.random(shape) < 0.7)
    right = product(information, rng.normal(size=(2, *shape))) + rng.normal(size=(2, *shape))
    weights = rng.random(shape) * (rng.random(shape) < draw(st.sampled_from([0, 0.5, 1])))
    now, predicted = rng.normal(0, draw(st.sampled_from([0.1, 5])), (2, 2, *shape))
    to_prediction = draw(st.sampled_from([0.0, 5.0]))
    smoothness = Smoothness(to_prediction, draw(st.sampled_from([0.0, 4.0, 10.0])))
    return Equations(information, right), weights, now, predicted, smoothness


@given(cases())
def test_affine_fits_are_those_of_the_twin(case):
    equations, weights, *_ = case
    errors, information = fit_affine(equations, weights)
    expected = reference.fit_affine(
        equations.information, equations.right, weights, affine_basis(weights.shape)
    )
    scale = 1 + abs(expected[0]).max()
    np.testing.assert_allclose(errors, expected[0], atol=1e-6 * scale)
    np.testing.assert_allclose(information, expected[1], atol=1e-6 * (1 + abs(expected[1]).max()))


@pytest.mark.slow
@given(cases())
def test_fields_are_those_of_the_twin(case):
    equations, _, now, predicted, smoothness = case
    field = solve_field(equations, now, predicted, smoothness)
    expected = reference.solve_field(
        equations.information,
        equations.right,
        now,
        predicted,
        affine_basis(now.shape[1:]),
        dataclasses.astuple(smoothness),
    )
    np.testing.assert_allclose(field, expected, atol=1e-5 * (1 + abs(expected).max()))


def test_affine_errors_are_found():
    errors = affine_field([1, -0.5, 0.3, 0.2, 0.7, -1])
    information = random_information()
    found, of_coefficients = fit_affine(equations_of(errors, information), ALL)
    np.testing.assert_allclose(found, errors, atol=5e-3)
    assert of_coefficients[0, 0] <= information[0].sum()
    assert (np.linalg.eigvalsh(of_coefficients) > 0).all()


def test_a_moving_object_does_not_change_the_affine_motion():
    errors = affine_field([1, 0, 0, -1, 0, 0])
    with_object = errors.copy()
    with_object[:, 2:5, 3:6] += 8
    found, _ = fit_affine(equations_of(with_object, random_information()), ALL)
    np.testing.assert_allclose(found, errors, atol=0.05)


def test_tiles_outside_the_segment_do_not_count():
    errors = affine_field([0.5, 0.2, 0, -0.5, 0, 0.1])
    with_others = errors.copy()
    with_others[:, :, 4:] += 3
    weights = ALL.copy()
    weights[:, 4:] = 0
    found, _ = fit_affine(equations_of(with_others, random_information()), weights)
    np.testing.assert_allclose(found[:, :, :4], errors[:, :, :4], atol=0.02)


def test_tiles_without_texture_follow_their_neighbors():
    information = random_information()
    information[:, 3:6, 4:7] = 0
    errors = affine_field([0.5, 0.4, -0.2, 0, 0.1, 0.3])
    now = np.zeros((2, *SHAPE))
    field = solve_field(equations_of(errors, information), now, now, Smoothness(0, 4))
    np.testing.assert_allclose(field, -errors, atol=0.05)


def test_objects_keep_their_own_motion():
    errors = np.zeros((2, *SHAPE))
    errors[:, 2:6, 3:7] = 5
    now = np.zeros((2, *SHAPE))
    field = solve_field(equations_of(errors, random_information(200)), now, now, Smoothness(0, 10))
    np.testing.assert_allclose(field, -errors, atol=0.2)


def test_without_outlines_the_field_minimizes_the_quadratic_form():
    """With one affine fit and equal weights, all derivatives of the cost are 0."""
    information, now = random_information(), RNG.normal(size=(2, *SHAPE))
    predicted = RNG.normal(size=(2, *SHAPE))
    equations = Equations(information, RNG.normal(0, 50, (2, *SHAPE)))
    smoothness = Smoothness(to_prediction=5.0, to_affine=1e-9, outline=0.5)
    field = solve_field(equations, now, predicted, smoothness)

    def cost(values):
        u = values.reshape(2, *SHAPE)
        d = now - u
        data = 0.5 * (d * product(information, d)).sum() - (equations.right * d).sum()
        deviation = u - predicted
        smooth = sum((np.diff(deviation, axis=axis) ** 2).sum() for axis in (1, 2))
        return data + 2.5 * smooth + 0.5e-4 * (deviation**2).sum()

    step = 1e-4
    for index in RNG.choice(field.size, 30, replace=False):
        offset = np.zeros(field.size)
        offset[index] = step
        slope = (cost(field.ravel() + offset) - cost(field.ravel() - offset)) / (2 * step)
        assert slope == pytest.approx(0, abs=1e-4)


def test_every_instruction_set_finds_the_same_field():
    case = Equations(random_information(), RNG.normal(0, 50, (2, *SHAPE)))
    now = RNG.normal(size=(2, *SHAPE))
    fields = []
    for level in engine.cpu_levels():
        engine.choose_cpu_level(level)
        fields.append(solve_field(case, now, 0 * now, Smoothness()))
    engine.choose_cpu_level(None)
    for field in fields[1:]:
        np.testing.assert_allclose(field, fields[0], atol=1e-7)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"information": np.zeros((3, 2, 5))}, "information of the equations: expected \\(3, 2, 4"),
        ({"right": np.zeros((1, 2, 4))}, "right sides of the equations: expected \\(2, 2, 4\\)"),
        ({"right": np.zeros((2, 0, 4))}, "right sides of the equations: expected \\(2, 1, 4\\)"),
        ({"information": np.full((3, 2, 4), np.nan)}, "equations: expected finite numbers"),
        ({"right": np.full((2, 2, 4), np.inf)}, "equations: expected finite numbers"),
        ({"basis": np.zeros((8, 2))}, "functions of tiles: expected \\(8, 3\\)"),
        ({"basis": np.full((8, 3), np.nan)}, "functions of tiles: expected finite numbers"),
    ],
)
def test_equations_that_do_not_fit_are_refused(changes, message):
    arguments = {"information": np.ones((3, 2, 4)), "right": np.zeros((2, 2, 4))}
    basis = changes.get("basis", affine_basis((2, 4)))
    arguments |= {name: value for name, value in changes.items() if name != "basis"}
    fields = np.zeros((2, 2, 4))
    with pytest.raises(ValueError, match=message):
        engine.fit_affine(*arguments.values(), np.ones((2, 4)), basis)
    with pytest.raises(ValueError, match=message):
        engine.solve_field(*arguments.values(), fields, fields, basis, (5.0, 10.0, 0.5))


@pytest.mark.parametrize("weights", [np.ones((2, 3)), -np.ones((2, 4)), np.full((2, 4), np.nan)])
def test_weights_that_do_not_fit_are_refused(weights):
    equations = Equations(np.ones((3, 2, 4)), np.zeros((2, 2, 4)))
    with pytest.raises(ValueError, match="weights of tiles"):
        fit_affine(equations, weights)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"now": np.zeros((2, 2, 5))}, "^displacements: expected \\(2, 2, 4\\)"),
        ({"predicted": np.zeros((2, 3, 4))}, "predicted displacements: expected \\(2, 2, 4\\)"),
        ({"predicted": np.full((2, 2, 4), np.nan)}, "predicted displacements: expected finite"),
        ({"smoothness": Smoothness(-1.0, 10.0)}, "weights of differences: expected .* got -1"),
        ({"smoothness": Smoothness(5.0, np.nan)}, "weights of differences"),
        (
            {"smoothness": Smoothness(5.0, 10.0, 0.0)},
            "difference at outlines: expected a finite number above 0",
        ),
    ],
)
def test_fields_that_do_not_fit_are_refused(changes, message):
    parts = {"now": np.zeros((2, 2, 4)), "predicted": np.zeros((2, 2, 4))}
    parts |= {"smoothness": Smoothness(), **changes}
    with pytest.raises(ValueError, match=message):
        solve_field(equations=Equations(np.ones((3, 2, 4)), np.zeros((2, 2, 4))), **parts)
