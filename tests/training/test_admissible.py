"""The admissible set: projections, and the bounds that they guarantee."""

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jotlight as jl
from jotlight.training import SafeSet, parameter_vector, split_vector, with_parameters
from jotlight.training.admissible import nearest_filter, nearest_monotone, nearest_weights
from reference import networks, sensing
from reference import training as twins
from reference.networks import random_bits

SMALL = hnp.arrays(float, st.integers(1, 5), elements=st.floats(-4, 4))
NU = st.sampled_from([0.0, 0.1, 0.5, 2.0])
SHAPES = [
    ([1], []),
    ([1, 1], [(5, 5)]),
    ([3, 1], [(3, 5)]),
    ([2, 3, 1], [(3, 3), (1, 3)]),
    ([2, 2, 2, 1], [(3, 3), (1, 1), (3, 3)]),
]
SENSORS = [
    jl.Sensor(oversampling=2, frames=2, max_intensity=0.3),
    jl.Sensor(oversampling=3),
    jl.Sensor(frames=16, max_intensity=8.0),
]
CASES = st.tuples(
    st.sampled_from(SENSORS), st.sampled_from(SHAPES), st.booleans(), NU, st.integers(0, 2**32)
)


def bare_network(sensor, channels, sizes, *, tied):
    """A network of ones, with the spline domains [0, K], [-1, 2], [0, 3], and [-7, -5]."""
    block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)
    shapes = [(channels[0], *block)]
    shapes += [(b, a, *size) for a, b, size in zip(channels, channels[1:], sizes, strict=False)]
    domains = [(0, sensor.trials), (-1, 2), (0, 3), (-7, -5)]
    return jl.Network(
        [
            jl.Layer(np.ones(shape), np.zeros((shape[0], 9)), low, (high - low) / 6)
            for shape, (low, high) in zip(shapes, domains, strict=False)
        ],
        sensor,
    )


def domains_of(network):
    return [(x.start, x.start + x.spacing * (x.coefficients.shape[1] - 3)) for x in network.layers]


def random_vector(rng, size):
    return rng.normal(0, 1, size) * 10 ** rng.uniform(-1, 3)


def assert_in_set(network, vector, nu, slack=1e-9):
    domains = domains_of(network)
    for index, (filters, coefficients) in enumerate(split_vector(network, vector)):
        if index == 0:
            times = network.sensor.trials if network.tied else 1
            assert filters.min() >= 0
            np.testing.assert_allclose(times * filters.sum((1, 2, 3)), domains[0][1], atol=slack)
        else:
            np.testing.assert_allclose(filters.sum((1, 2, 3)), 1, atol=slack)
            assert np.abs(filters).sum((1, 2, 3)).max() <= 1 + 2 * nu + slack
        if index + 1 == len(domains):
            low, high = 0, network.sensor.max_intensity
        else:
            # The interval that becomes the domain when ν times its width is added on each side.
            (a, b) = domains[index + 1]
            low, high = (
                ((1 + nu) * a + nu * b) / (1 + 2 * nu),
                ((1 + nu) * b + nu * a) / (1 + 2 * nu),
            )
        assert coefficients.min() >= low - slack
        assert coefficients.max() <= high + slack


@given(SMALL, NU)
def test_nearest_filter_equals_an_exhaustive_search(taps, nu):
    found = nearest_filter(taps, nu)
    expected = twins.nearest_filter(taps, nu)
    np.testing.assert_allclose(found, expected, atol=1e-9)


@given(SMALL, st.floats(0.1, 9))
def test_nearest_weights_equal_an_exhaustive_search(taps, total):
    np.testing.assert_allclose(
        nearest_weights(taps, total), twins.nearest_weights(taps, total), atol=1e-9
    )


@given(SMALL)
def test_nearest_monotone_is_the_nearest_within_bounds_too(values):
    found = nearest_monotone(values)
    assert (np.diff(found) >= 0).all()
    expected = twins.nearest_monotone(values, -2.0, 1.0)
    np.testing.assert_allclose(found.clip(-2, 1), expected, atol=1e-6)


def test_splines_are_monotone_on_request_where_every_layer_has_one_channel():
    sensor = jl.Sensor(oversampling=3)
    for channels, monotone, rises in [
        ([1, 1], True, True),
        ([1, 1], False, False),
        ([2, 1], True, False),
    ]:
        network = bare_network(sensor, channels, [(3, 3)], tied=True)
        start = np.random.default_rng(0).normal(0, 1, len(parameter_vector(network)))
        for _, coefficients in split_vector(
            network, SafeSet(0.5, monotone).project(network, start)
        ):
            assert (np.diff(coefficients) >= 0).all() == rises


@given(CASES)
def test_projection_reaches_the_set_and_is_idempotent(case):
    sensor, shape, tied, nu, seed = case
    network = bare_network(sensor, *shape, tied=tied)
    start = random_vector(np.random.default_rng(seed), len(parameter_vector(network)))
    before = start.copy()
    once = SafeSet(nu).project(network, start)
    np.testing.assert_array_equal(start, before)
    assert_in_set(network, once, nu)
    np.testing.assert_allclose(SafeSet(nu).project(network, once), once, rtol=0, atol=1e-12)


@given(CASES)
def test_projection_is_nonexpansive(case):
    sensor, shape, tied, nu, seed = case
    network, rng = bare_network(sensor, *shape, tied=tied), np.random.default_rng(seed)
    one = random_vector(rng, len(parameter_vector(network)))
    other = one + random_vector(rng, len(one)) * rng.choice([1e-3, 1.0])
    here, there = (SafeSet(nu).project(network, x) for x in (one, other))
    assert np.linalg.norm(here - there) <= np.linalg.norm(one - other) * (1 + 1e-12)


@given(CASES)
def test_the_projection_is_the_nearest_point_of_the_set(case):
    sensor, shape, tied, nu, seed = case
    network, rng = bare_network(sensor, *shape, tied=tied), np.random.default_rng(seed)
    start = random_vector(rng, len(parameter_vector(network)))
    nearest = SafeSet(nu).project(network, start)
    for _ in range(5):
        # The projection on a convex set satisfies a variational inequality.
        member = SafeSet(nu).project(network, start + random_vector(rng, len(start)))
        assert (start - nearest) @ (member - nearest) <= 1e-8 * (1 + start @ start)


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("nu", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("sigma", [0.25, 0.7, 1.0])
@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_initial_networks_are_in_the_set(sensor, sigma, nu, tied):
    network = jl.Network.initial(sensor, sigma=sigma, tied=tied, nu=nu)
    vector = parameter_vector(network)
    moved = np.abs(SafeSet(nu).project(network, vector) - vector)
    assert moved.max() < 1e-6 * max(1, np.abs(vector).max())


def patterns(rng, sensor):
    """Bits of single blocks (N, T, K̂, K̂): all 0, all 1, checkered, each jot alone, and others."""
    block = (sensor.frames, sensor.oversampling, sensor.oversampling)
    checkered = np.indices(block).sum(0) % 2 == 1
    single = np.eye(sensor.trials, dtype=bool).reshape(-1, *block)
    rest = rng.random((24, *block)) < rng.random((24, 1, 1, 1))
    return np.concatenate(
        [np.zeros((1, *block), bool), np.ones((1, *block), bool), [checkered, ~checkered],
         single, ~single, rest]
    )  # fmt: skip


def join_blocks(blocks):
    """Bits (T, H·K̂, W·K̂) from blocks (H, W, T, K̂, K̂)."""
    height, width, frames, side, _ = blocks.shape
    return blocks.transpose(2, 0, 3, 1, 4).reshape(frames, height * side, width * side)


def extreme_bits(rng, network):
    """Bits that maximize or minimize a sum of the second layer at the center pixel."""
    choice = patterns(rng, network.sensor)
    side = 7
    for index in range(4):
        yield join_blocks(np.broadcast_to(choice[index], (side, side, *choice[index].shape)))
    grid = np.indices((side, side)).sum(0) % 2
    yield join_blocks(choice[grid])
    yield join_blocks(choice[rng.integers(len(choice), size=(side, side))])
    yield random_bits(rng, network.sensor, side, side)
    if len(network.layers) == 1:
        return
    layers = twins.layers_of(network, parameter_vector(network))
    alone = join_blocks(choice[None])
    answers = twins.first_sums(layers[0].filters, alone, network.sensor.oversampling)[:, 0]
    for plane, coefficients in zip(answers, layers[0].coefficients, strict=True):
        plane[:] = networks.spline(plane, coefficients, layers[0].start, layers[0].spacing)
    for filters in layers[1].filters:
        (_, height, width), top = filters.shape, side // 2
        # A convolution flips its filter.
        weighed = np.einsum("cij,cn->ijn", filters[:, ::-1, ::-1], answers)
        for place in (weighed.argmax(2), weighed.argmin(2)):
            picked = np.zeros((side, side), int)
            rows = slice(top - height // 2, top + height // 2 + 1)
            picked[rows, top - width // 2 : top + width // 2 + 1] = place
            yield join_blocks(choice[picked])


@pytest.mark.slow
@given(CASES)
def test_no_bits_lead_out_of_a_range(case):
    sensor, shape, tied, nu, seed = case
    rng = np.random.default_rng(seed)
    bare = bare_network(sensor, *shape, tied=tied)
    network = with_parameters(
        bare, SafeSet(nu).project(bare, random_vector(rng, len(parameter_vector(bare))))
    )
    vector = parameter_vector(network)
    for bits in extreme_bits(rng, network):
        sums = twins.spline_inputs(network, vector, bits)
        for plane, (low, high) in zip(sums, domains_of(network), strict=True):
            slack = 5e-6 * max(abs(low), abs(high))
            assert plane.min() >= low - slack
            assert plane.max() <= high + slack
        estimate = network.reconstruct(jl.Bits.from_array(bits))
        assert estimate.min() >= 0
        assert estimate.max() <= np.float32(sensor.max_intensity)
        np.testing.assert_allclose(estimate, twins.output(network, vector, bits), atol=1e-3)
        if network.tied:
            counts = sensing.block_counts(bits, sensor.oversampling)
            np.testing.assert_array_equal(network.reconstruct(counts), estimate)


@pytest.mark.parametrize("nu", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("tied", [True, False])
def test_the_bounds_are_reached_so_they_are_tight(tied, nu):
    bare = bare_network(SENSORS[1], [1, 1], [(1, 3)], tied=tied)
    vector = parameter_vector(bare)
    (taps, first), (filters, second) = split_vector(bare, vector)
    taps[...] = 1e3
    first[0, :4], first[0, 4:] = -1e3, 1e3
    filters[0, 0, 0] = -900, 1000, -950
    second[0, :4], second[0, 4:] = -1e3, 1e3
    network = with_parameters(bare, SafeSet(nu).project(bare, vector))
    bits = np.repeat([[[False, True, False], [True, False, True]]], 3, axis=2).repeat(3, axis=1)
    p, r = twins.spline_inputs(network, parameter_vector(network), bits)
    np.testing.assert_allclose([p.min(), p.max()], (0, 9), rtol=1e-6)
    np.testing.assert_allclose(r[0, :, 1], (2, -1), rtol=2e-6)
    estimate = network.reconstruct(jl.Bits.from_array(bits))
    np.testing.assert_array_equal(estimate[:, 1], (1, 0))


class Frozen:
    """A user-defined set: filters equal 1, and coefficients lie in [0.2, 0.7]."""

    def project(self, network, vector):
        new = vector.copy()
        for filters, coefficients in split_vector(network, new):
            filters[...] = 1
            coefficients[...] = coefficients.clip(0.2, 0.7)
        return new


@pytest.mark.parametrize("optimizer", jl.training.OPTIMIZERS)
def test_train_stays_in_a_user_defined_set(optimizer):
    network = bare_network(SENSORS[1], [1, 1], [(3, 3)], tied=True)
    trained, _ = jl.train(
        network,
        lambda rng, number: rng.random((number, 8, 8), np.float32),
        steps=2,
        batch=4,
        rng=0,
        optimizer=optimizer,
        admissible=Frozen(),
    )
    found = parameter_vector(trained)
    np.testing.assert_allclose(found, Frozen().project(trained, found), rtol=1e-6)
    assert (parameter_vector(network) != found).any()


@pytest.mark.parametrize("nu", [-0.1, np.nan, np.inf])
def test_a_negative_or_infinite_nu_is_refused(nu):
    with pytest.raises(ValueError, match="nu: expected a number of 0 or more"):
        SafeSet(nu)


@pytest.mark.parametrize(("start", "spacing"), [(0.5, 1.0), (-9.0, 1.0), (-6.0, 1.0)])
def test_a_first_spline_without_0_in_its_domain_is_refused(start, spacing):
    network = jl.Network([jl.Layer(np.ones((1, 1, 1, 1)), np.ones((1, 9)), start, spacing)],
                         jl.Sensor(oversampling=3))  # fmt: skip
    with pytest.raises(ValueError, match="network: expected a first spline that starts at 0"):
        SafeSet().project(network, parameter_vector(network))


def test_a_vector_of_another_network_is_refused():
    network = bare_network(SENSORS[1], [1, 1], [(3, 3)], tied=True)
    with pytest.raises(ValueError, match="vector: expected 28 parameters, got 29"):
        SafeSet().project(network, np.zeros(29))
