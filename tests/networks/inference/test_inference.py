"""The forward pass of sequential networks against a slow twin."""

import numpy as np
import pytest

import jotlight as jl
from reference import networks
from reference.networks import last_layer, random_bits, random_network


def twin(network, bits, dead=None):
    sums = networks.block_sums(network.layers[0].filters, bits, network.sensor.oversampling, dead)
    return networks.network(network.layers, sums)


SHAPES = [
    ([1], []),
    ([1, 1], [(15, 15)]),
    ([3, 1], [(3, 5)]),
    ([2, 1], [(4, 2)]),
    ([2, 3, 1], [(1, 7), (6, 3)]),
    ([3, 2, 2, 1], [(5, 5), (2, 2), (3, 1)]),
]


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize(("channels", "sizes"), SHAPES)
@pytest.mark.parametrize(("height", "width"), [(9, 70), (2, 3)])
@pytest.mark.parametrize("masked", [False, True])
def test_the_estimate_equals_the_twins(channels, sizes, tied, height, width, masked):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(oversampling=3, frames=2)
    network = random_network(rng, sensor, channels, sizes, tied=tied)
    bits = random_bits(rng, sensor, height, width)
    dead = None
    if masked:
        dead = rng.random(bits.shape[1:]) < 0.4
        dead[1::3, 1::3] = False
    estimate = last_layer(network, jl.Bits.from_array(bits), sensor.replace(mask=dead))
    assert (estimate.shape, estimate.dtype) == ((height, width), np.float32)
    np.testing.assert_allclose(estimate, twin(network, bits, dead), atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize(
    ("channels", "sizes"), [SHAPES[1], pytest.param(*SHAPES[4], marks=pytest.mark.exhaustive)]
)
@pytest.mark.parametrize(
    ("height", "width"),
    [(130, 1024), pytest.param(65, 1031, marks=pytest.mark.exhaustive), (3, 2059)],
)
def test_tiles_leave_no_seams(channels, sizes, tied, height, width):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(oversampling=3)
    network = random_network(rng, sensor, channels, sizes, tied=tied)
    bits = random_bits(rng, sensor, height, width)
    expected = twin(network, bits)
    packed = jl.Bits.from_array(bits)
    for threads in (1, 2, 64):
        estimate = last_layer(network, packed, threads=threads)
        np.testing.assert_allclose(estimate, expected, atol=5e-5)


def test_splines_may_have_more_than_256_knots():
    rng = np.random.default_rng(1)
    sensor = jl.Sensor(frames=900)
    line = np.sort(rng.uniform(0, 1, (1, 400)))
    taps = rng.uniform(0, 0.1, (1, 1, 3, 3))
    layers = [jl.Layer(np.ones((1, 1, 1, 1)), line, 0.0, 900 / 397), jl.Layer(taps, line, 0, 1e-3)]
    network = jl.Network(layers, sensor)
    counts = rng.integers(0, 901, (40, 30))
    expected = networks.network(network.layers, counts[None].astype(float))
    np.testing.assert_allclose(last_layer(network, counts), expected, atol=2e-5)


@pytest.mark.parametrize("oversampling", [1, 7, 9, 12])
def test_blocks_may_have_any_width(oversampling):
    rng = np.random.default_rng(1)
    sensor = jl.Sensor(oversampling=oversampling)
    network = random_network(rng, sensor, [1], [], tied=False)
    bits = random_bits(rng, sensor, 3, 5)
    estimate = last_layer(network, jl.Bits.from_array(bits))
    np.testing.assert_allclose(estimate, twin(network, bits), atol=2e-5)


def test_a_mask_without_dead_jots_changes_nothing():
    rng = np.random.default_rng(2)
    sensor = jl.Sensor(oversampling=3, frames=2)
    network = random_network(rng, sensor, [3, 1], [(3, 3)], tied=False)
    bits = jl.Bits.from_array(random_bits(rng, sensor, 6, 7))
    masked = last_layer(network, bits, sensor.replace(mask=np.zeros((18, 21), bool)))
    np.testing.assert_array_equal(masked, last_layer(network, bits))


def test_splines_are_constant_outside_their_knots():
    coefficients = np.random.default_rng(3).normal(0, 1, (1, 9))
    layer = jl.Layer(np.ones((1, 1, 1, 1)), coefficients, 4.0, 1.0)
    estimate = last_layer(jl.Network([layer], jl.Sensor(frames=16)), np.arange(17)[None])[0]
    expected = networks.spline(np.arange(17.0), coefficients[0], 4.0, 1.0)
    np.testing.assert_allclose(estimate, expected, atol=1e-6)
    assert len(set(estimate[:5])) == len(set(estimate[10:])) == 1
    assert len(set(estimate)) == 7


@pytest.mark.parametrize("threads", [1, 2])
def test_the_number_of_threads_does_not_change_the_estimate(threads):
    rng = np.random.default_rng(4)
    sensor = jl.Sensor(oversampling=2, frames=3)
    network = random_network(rng, sensor, [3, 2, 1], [(5, 4), (3, 3)], tied=False)
    bits = jl.Bits.from_array(random_bits(rng, sensor, 30, 90))
    expected = last_layer(network, bits)
    np.testing.assert_array_equal(last_layer(network, bits, threads=threads), expected)


@pytest.mark.parametrize(
    ("channels", "sizes", "halo"),
    [
        ([1], [], 0),
        ([1, 1], [(15, 15)], 7),
        ([2, 1], [(4, 2)], 2),
        ([2, 2, 1], [(5, 3), (6, 1)], 5),
        ([1, 1, 1, 1], [(3, 3), (1, 1), (5, 5)], 3),
    ],
)
def test_a_tile_with_a_border_of_the_halo_equals_the_whole(channels, sizes, halo):
    rng = np.random.default_rng(5)
    sensor = jl.Sensor(oversampling=2)
    network = random_network(rng, sensor, channels, sizes, tied=False)
    assert network.halo == halo
    bits = random_bits(rng, sensor, 40, 90)
    whole = last_layer(network, jl.Bits.from_array(bits))

    def part(rows, columns, border):
        outer = [
            (max(0, low - border), min(most, high + border))
            for (low, high), most in zip((rows, columns), (40, 90), strict=True)
        ]
        (top, bottom), (left, right) = outer
        tile = last_layer(
            network, jl.Bits.from_array(bits[:, 2 * top : 2 * bottom, 2 * left : 2 * right])
        )
        return tile[rows[0] - top : rows[1] - top, columns[0] - left : columns[1] - left]

    for rows, columns in [((15, 25), (20, 31)), ((0, 12), (0, 80)), ((11, 40), (77, 90))]:
        inside = whole[slice(*rows), slice(*columns)]
        np.testing.assert_array_equal(part(rows, columns, halo), inside)
    if halo:
        assert (part((15, 25), (20, 31), halo - 1) != whole[15:25, 20:31]).any()


@pytest.mark.parametrize("tied", [True, False])
def test_dead_pixels_are_inpainted(tied):
    sensor = jl.Sensor(oversampling=2)
    network = jl.Network.initial(sensor, tied=tied)
    mask = np.zeros((20, 20), bool)
    mask[6:12, 6:12] = True
    bits = np.random.default_rng(12).random((1, 20, 20)) < 0.5
    with pytest.warns(jl.JotlightWarning, match="9 of 100 pixels"):
        first = last_layer(network, jl.Bits.from_array(bits), sensor.replace(mask=mask))
    with pytest.warns(jl.JotlightWarning):
        second = last_layer(network, jl.Bits.from_array(bits ^ mask), sensor.replace(mask=mask))
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, second)


def test_a_pixel_with_one_valid_jot_of_weight_0_is_not_dead():
    filters = np.zeros((1, 1, 2, 2))
    filters[0, 0, 0, 0] = 1
    ramp = np.arange(-1, 5.0)[None]
    network = jl.Network([jl.Layer(filters, ramp, 0.0, 1.0)], jl.Sensor(oversampling=2))
    bits = np.zeros((1, 2, 4), bool)
    bits[0, 1] = 1, 1, 1, 0
    mask = np.zeros((2, 4), bool)
    mask[0, ::2] = True
    estimate = last_layer(network, jl.Bits.from_array(bits), network.sensor.replace(mask=mask))
    np.testing.assert_allclose(estimate, [[2 / 3, 1 / 3]], rtol=1e-6)
