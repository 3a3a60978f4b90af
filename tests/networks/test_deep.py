"""Deep members of the network family, without PyTorch."""

import dataclasses

import numpy as np
import pytest

import jotlight as jl
import jotlight._engine as engine
from jotlight.networks import inference
from jotlight.networks.conditioning import conditioning_weights, count_sets
from jotlight.networks.graph import halo_radius, size_divisor
from reference import deep, networks
from reference.networks import random_bits

SENSOR = jl.Sensor(oversampling=4)
ARCHITECTURES = ("small", "medium")
SIZES = [(1, 1), (2, 3), (5, 1), (30, 47), (33, 64)]
BETWEEN = (1, 256)
ROUNDING = 1e-6


def member(name, seed=0, **options):
    rng = np.random.default_rng(seed)
    return deep.lively(jl.Network.residual(SENSOR, name, rng=seed), rng, **options)


def conditional(name="small", seed=0):
    return deep.lively(jl.Network.conditional(name, rng=seed), np.random.default_rng(seed))


def twin(network, bits):
    sums = networks.block_sums(network.layers[0].filters, bits, network.sensor.oversampling)
    return deep.picture(network.layers, sums, size_divisor(network.layers))


def counts_of(sensor, height, width, seed=0):
    return np.random.default_rng(seed).integers(0, sensor.bits_per_pixel + 1, (height, width))


@pytest.mark.parametrize("name", ARCHITECTURES)
@pytest.mark.parametrize("size", SIZES)
def test_the_picture_of_a_member_is_the_twins(name, size):
    network = member(name)
    bits = random_bits(np.random.default_rng(1), SENSOR, *size)
    expected = twin(network, bits)
    picture = network.reconstruct(jl.Bits.from_array(bits))
    assert (picture.shape, picture.dtype) == (size, np.float32)
    np.testing.assert_allclose(picture, expected, atol=1e-5)
    counts = bits.reshape(size[0], 4, size[1], 4).sum((1, 3))
    np.testing.assert_array_equal(network.reconstruct(counts), picture)


def test_a_picture_of_many_tiles_is_the_twins():
    network, counts = member("medium"), counts_of(SENSOR, 150, 1060)
    sums = network.layers[0].filters[:, 0] * counts[None]
    picture = network.reconstruct(counts, threads=1)
    np.testing.assert_allclose(picture, deep.picture(network.layers, sums, 4), atol=1e-5)
    np.testing.assert_array_equal(network.reconstruct(counts, threads=3), picture)


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize("size", [(1, 1), (7, 5), (24, 36), (61, 50)])
@pytest.mark.parametrize("seed", range(3))
def test_the_picture_of_any_wiring_is_the_twins(tied, size, seed):
    rng = np.random.default_rng(seed)
    sensor = jl.Sensor(oversampling=3, frames=2)
    network = deep.wired(rng, sensor, tied=tied)
    assert (size_divisor(network.layers), network.halo % 6) == (6, 0)
    bits = random_bits(rng, sensor, *size)
    picture = network.reconstruct(jl.Bits.from_array(bits))
    np.testing.assert_allclose(picture, twin(network, bits), atol=2e-5)


def test_filters_that_the_stride_does_not_divide():
    rng = np.random.default_rng(0)
    network = deep.wired(rng, SENSOR, odd=True)
    bits = random_bits(rng, SENSOR, 100, 70)
    picture = network.reconstruct(jl.Bits.from_array(bits))
    np.testing.assert_allclose(picture, twin(network, bits), atol=2e-5)


@pytest.mark.parametrize(("stride", "upsampling", "step"), [(2, 2, 2), (4, 2, 4), (3, 3, 3)])
@pytest.mark.parametrize("size", [(5, 7), (13, 110), (61, 50)])
def test_a_layer_that_filters_with_a_stride_and_goes_from_depth_to_space(
    stride, upsampling, step, size
):
    rng = np.random.default_rng(5)
    one = np.ones((1, 1, 1, 1), np.float32)
    both = rng.normal(0, 0.3, (2 * upsampling**2, 1, stride, stride)).astype(np.float32)
    back = rng.normal(0, 0.3, ((stride // upsampling) ** 2, 2, 1, 1)).astype(np.float32)
    layers = [
        jl.Layer(one / 16, None),
        jl.Layer(both, None, stride=stride, upsampling=upsampling),
        jl.Layer(back, None, upsampling=stride // upsampling),
    ]
    assert size_divisor(layers) == step
    network = jl.Network(layers, SENSOR)
    counts = counts_of(SENSOR, *size)
    picture = network.reconstruct(counts, threads=1)
    expected = deep.picture(layers, counts[None] / 16, step)
    np.testing.assert_allclose(picture, expected, atol=1e-5)
    np.testing.assert_array_equal(network.reconstruct(counts, threads=3), picture)


@pytest.mark.parametrize("times", [2, 3, 5])
def test_columns_of_tiles_that_the_upsampling_does_not_divide(times):
    rng = np.random.default_rng(8)
    one = np.ones((1, 1, 1, 1), np.float32)
    down = rng.normal(0, 0.3, (times**2, 1, times, times)).astype(np.float32)
    depth = np.eye(times**2, dtype=np.float32)[:, :, None, None]
    layers = [
        jl.Layer(one / 16, None),
        jl.Layer(down, None, stride=times),
        jl.Layer(depth, None, upsampling=times),
    ]
    counts = counts_of(SENSOR, 12, 2100)
    picture = jl.Network(layers, SENSOR).reconstruct(counts)
    np.testing.assert_allclose(picture, deep.picture(layers, counts[None] / 16, times), atol=1e-5)


def test_rows_past_the_last_one_need_those_above():
    rng = np.random.default_rng(9)
    one = np.ones((1, 1, 1, 1), np.float32)
    layers = [
        jl.Layer(one / 16, None),
        jl.Layer(rng.normal(0, 0.3, (16, 1, 4, 4)).astype(np.float32), None, stride=4),
        jl.Layer(rng.normal(0, 0.3, (16, 16, 1, 1)).astype(np.float32), None, upsampling=4),
    ]
    network = jl.Network(layers, SENSOR)
    counts = counts_of(SENSOR, 65, 9)
    prepared = [layer.engine_layer for layer in layers]
    top, bottom = engine.input_rows(prepared, 65, (64, 65))
    part = network.reconstruct(counts[top:bottom])
    np.testing.assert_array_equal(part[64 - top :], network.reconstruct(counts)[64:])


def test_layers_that_need_too_much_at_a_pixel_are_refused():
    one = np.ones((1, 1, 1, 1), np.float32)
    up, down = np.ones((256, 1, 1, 1), np.float32), np.ones((1, 1, 16, 16), np.float32)
    many = np.ones((17, 1, 1, 1), np.float32)
    layers = [
        jl.Layer(one, None),
        *[jl.Layer(up, None, upsampling=16)] * 2,
        jl.Layer(many, None),
        jl.Layer(np.ones((1, 17, 16, 16), np.float32), None, stride=16),
        jl.Layer(down, None, stride=16),
    ]
    with pytest.raises(ValueError, match="at most 2\\^20 numbers at a pixel"):
        jl.Network(layers, SENSOR).reconstruct(counts_of(SENSOR, 5, 5))
    # As many planes as are allowed, in a tile of a few rows.
    layers[3], layers[4] = jl.Layer(one, None), jl.Layer(down, None, stride=16)
    assert jl.Network(layers, SENSOR).reconstruct(counts_of(SENSOR, 5, 5)).shape == (5, 5)


def test_strides_that_are_too_many_together_are_refused():
    one = np.ones((1, 1, 1, 1), np.float32)
    down, up = np.ones((1, 1, 16, 16), np.float32), np.ones((256, 1, 1, 1), np.float32)
    layers = [jl.Layer(one, None), *[jl.Layer(down, None, stride=16)] * 3]
    layers += [jl.Layer(up, None, upsampling=16)] * 3
    with pytest.raises(ValueError, match="at most 256 together, got 4096"):
        jl.Network(layers, SENSOR)


def test_dead_jots_of_a_deep_network_that_weighs_jots_singly():
    rng = np.random.default_rng(4)
    sensor = jl.Sensor(oversampling=3)
    network = deep.wired(rng, sensor, tied=False)
    bits = random_bits(rng, sensor, 12, 18)
    dead = rng.random(bits.shape[1:]) < 0.4
    dead[1::3, 1::3] = False
    sums = networks.block_sums(network.layers[0].filters, bits, 3, dead)
    picture = network.reconstruct(jl.Bits.from_array(bits), sensor.replace(mask=dead))
    expected = deep.picture(network.layers, sums, 6)
    np.testing.assert_allclose(picture, expected, atol=2e-5)


@pytest.mark.parametrize("bits", [1, 2, 16, 100, 256])
@pytest.mark.parametrize("size", [(1, 1), (19, 30)])
def test_the_picture_of_a_network_that_is_told_k_is_the_twins(bits, size):
    network, sensor = conditional(), jl.Sensor(frames=bits, max_intensity=5.0)
    counts = counts_of(sensor, *size)
    layers = deep.conditioned(network.layers, bits, BETWEEN, count_sets(network.layers))
    # Trained filters are kept in float32.
    sums = counts[None] * np.float64(layers[0].filters.reshape(()))
    expected = deep.picture(layers, sums, size_divisor(layers))
    shares = network.conditioned_on(sensor).reconstruct(counts, sensor)
    np.testing.assert_allclose(shares, expected, atol=1e-5)
    light = (-np.log1p(-expected.clip(0, 1 - 1e-9))).clip(0, 5)
    near = expected < 0.95
    np.testing.assert_allclose(
        network.reconstruct(counts, sensor)[near], light[near], atol=3e-4, rtol=1e-3
    )


@pytest.mark.parametrize("number", [4, 5, 6, 9])
def test_shares_are_those_of_splines(number):
    for bits in (1, 1.5, 2, 16, 99, 255.9, 256):
        found = conditioning_weights(bits, BETWEEN, number)
        assert found.min() >= 0
        assert abs(found.sum() - 1) < 1e-12
        np.testing.assert_allclose(found, deep.shares(bits, BETWEEN, number), atol=1e-10)


def test_a_network_of_equal_sets_is_the_same_for_every_k():
    network = jl.Network.conditional("small", rng=0)
    layer = network.layers[5]
    assert layer.set_counts
    for bits in (1, 7, 256):
        at = layer.interpolate(conditioning_weights(bits, BETWEEN, 6))
        np.testing.assert_allclose(at.coefficients, layer.coefficients[0], atol=1e-6)


@pytest.mark.parametrize("name", ARCHITECTURES)
@pytest.mark.parametrize("size", [(1, 7), (150, 300), (261, 130)])
def test_threads_change_nothing(name, size):
    network, counts = member(name), counts_of(SENSOR, *size)
    one = network.reconstruct(counts, threads=1)
    for threads in (2, 7, None):
        np.testing.assert_array_equal(network.reconstruct(counts, threads=threads), one)


@pytest.mark.parametrize("tied", [True, False])
def test_large_pictures_in_parts_are_those_in_one(monkeypatch, tied):
    rng = np.random.default_rng(2)
    sensor = jl.Sensor(oversampling=3)
    network = deep.wired(rng, sensor, tied=tied) if not tied else member("small")
    sensor = network.sensor
    height = 65 * network.halo + 11
    bits = jl.Bits.from_array(random_bits(rng, sensor, height, 25))
    whole = network.reconstruct(bits)
    monkeypatch.setattr(inference, "FLOPS_PER_BAND", 1)
    np.testing.assert_array_equal(network.reconstruct(bits), whole)
    if tied:
        counts = bits.counts(sensor.oversampling)
        np.testing.assert_array_equal(network.reconstruct(counts), whole)


@pytest.mark.parametrize("name", ARCHITECTURES)
@pytest.mark.parametrize("rows", [(0, 1), (3, 4), (199, 200), (200, 207), (402, 403)])
def test_rows_are_made_of_the_rows_that_they_need(name, rows):
    network, (start, stop) = member(name), rows
    counts = counts_of(SENSOR, 403, 20)
    layers = [layer.engine_layer for layer in network.layers]
    top, bottom = engine.input_rows(layers, 403, rows)
    part = network.reconstruct(counts[top:bottom])[start - top : stop - top]
    np.testing.assert_array_equal(part, network.reconstruct(counts)[start:stop])
    # Not many more of them than what one pixel depends on.
    assert bottom - top < 8 * network.halo + stop - start


@pytest.mark.parametrize("make", [lambda: member("small"), lambda: deep.wired(RNG, SENSOR)])
def test_a_tile_with_a_border_of_the_halo_has_the_pixels_of_the_whole(make):
    network = make()
    halo, step = network.halo, size_divisor(network.layers)
    height, width = 4 * halo + 5 * step, 3 * halo + 7 * step
    counts = counts_of(SENSOR, height, width)
    whole = network.reconstruct(counts)
    tops = [0, step, height // 2 // step * step]
    for top, left in zip(tops, reversed(tops), strict=True):
        bottom, right = top + 3 * step, left + 2 * step
        first, start = max(0, top - halo), max(0, left - halo)
        part = network.reconstruct(counts[first : bottom + halo, start : right + halo])
        np.testing.assert_allclose(
            part[top - first : bottom - first, left - start : right - start],
            whole[top:bottom, left:right],
            atol=ROUNDING,
        )


RNG = np.random.default_rng(9)


def test_the_halo_is_no_wider_than_it_has_to_be():
    """A pixel outside of the halo changes nothing, and one a step inside of it does."""
    network = deep.wired(np.random.default_rng(3), SENSOR)
    halo, step = network.halo, size_divisor(network.layers)
    size = 4 * halo // step * step
    counts = counts_of(SENSOR, size, size)
    one = network.reconstruct(counts)
    middle = size // 2 // step * step
    changed = np.zeros((size, size), bool)
    for pixel in range(middle, middle + step):
        other = counts.copy()
        other[pixel, middle] = (other[pixel, middle] + 8) % 17
        changed |= network.reconstruct(other) != one
    rows, columns = np.nonzero(changed)
    reach = max(middle - rows.min(), rows.max() - (middle + step - 1))
    reach = max(reach, middle - columns.min(), columns.max() - (middle + step - 1))
    assert halo - 2 * step < reach <= halo


@pytest.mark.parametrize("name", ARCHITECTURES)
def test_a_member_starts_as_a_classical_estimate(name):
    image = np.full((40, 40), 0.5)
    bits = SENSOR.expose(image, 0)
    picture = jl.Network.residual(SENSOR, name, rng=0).reconstruct(bits)
    assert abs(picture.mean() - 0.5) < 0.05
    assert picture.std() < 0.1
    for frames in (1, 16, 256):
        sensor = jl.Sensor(frames=frames, max_intensity=4.0)
        picture = jl.Network.conditional(name, rng=0).reconstruct(sensor.expose(image, 0), sensor)
        assert abs(picture.mean() - 0.5) < 0.1


@pytest.mark.parametrize("most", [0.3, 1.0, 7.0])
def test_every_output_lies_between_0_and_the_largest_intensity(most):
    sensor = jl.Sensor(oversampling=4, max_intensity=most)
    for seed in range(4):
        start = jl.Network.residual(sensor, "small", rng=seed)
        network = deep.lively(start, np.random.default_rng(seed), size=5.0)
        picture = network.reconstruct(counts_of(sensor, 60, 70, seed))
        assert picture.min() >= 0
        assert picture.max() <= np.float32(most)
        assert picture.std() > 0.01 * most


@pytest.mark.parametrize("make", [*(lambda n=n: member(n) for n in ARCHITECTURES), conditional])
def test_a_file_keeps_everything(tmp_path, make):
    network = make()
    network.save(tmp_path / "deep.safetensors")
    loaded = jl.Network.load(tmp_path / "deep.safetensors")
    assert (loaded.sensor, loaded.trials_range) == (network.sensor, network.trials_range)
    for one, other in zip(network.layers, loaded.layers, strict=True):
        assert one.metadata() == other.metadata()
        np.testing.assert_array_equal(one.filters, other.filters)
        assert (one.coefficients is None) == (other.coefficients is None)
        if one.coefficients is not None:
            np.testing.assert_array_equal(one.coefficients, other.coefficients)


def layer(outputs, inputs, taps=3, *, bends=False, **options):
    coefficients = np.zeros((outputs // options.get("upsampling", 1) ** 2, 4)) if bends else None
    return jl.Layer(np.ones((outputs, inputs, taps, taps)), coefficients, **options)


FIRST = layer(2, 1, 1)
LAST = layer(1, 2)


@pytest.mark.parametrize(
    ("layers", "message"),
    [
        ([layer(1, 1, 1, input=0)], "the first one to read the data"),
        ([layer(1, 1, 1, skip=0)], "the first one to read the data"),
        ([layer(4, 1, 1, upsampling=2)], "the first one to read the data"),
        ([FIRST, layer(1, 2, input=1)], "input of layer 1 to be 0 to 0, got 1"),
        ([FIRST, layer(1, 2, skip=-1)], "skip of layer 1 to be 0 to 0, got -1"),
        ([FIRST, layer(3, 2), layer(1, 2)], "expected 3 input channels in layer 2"),
        (
            [FIRST, layer(3, 2), layer(1, 3, skip=1)],
            "the skip connection of layer 2 to have its 1 channels",
        ),
        (
            [FIRST, layer(2, 2, stride=2), layer(2, 2, skip=0), LAST],
            "layer 2 to have its 2 channels and its size, got the output of layer 0",
        ),
        ([FIRST, layer(2, 2)], "one output channel of the last layer"),
        ([FIRST, layer(1, 2, stride=2)], "one output channel of the last layer, in the size of"),
        (
            [FIRST, layer(4, 2, upsampling=2)],
            "one output channel of the last layer, in the size of",
        ),
        (
            [FIRST, layer(3, 2), layer(1, 2, input=0)],
            "another layer to use the output of layer 1, got none",
        ),
    ],
)
def test_layers_that_do_not_fit_each_other_are_refused(layers, message):
    with pytest.raises(ValueError, match=message):
        jl.Network(layers, SENSOR).reconstruct(np.ones((4, 4), int))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stride": 0}, "stride: expected 1 to 16, got 0"),
        ({"stride": 17}, "stride: expected 1 to 16, got 17"),
        ({"upsampling": 17}, "upsampling: expected 1 to 16, got 17"),
        ({"stride": 4}, "at least as many rows and columns as the stride of 4"),
        ({"upsampling": 3}, "expected a multiple of 9 filters for an upsampling of 3, got 4"),
        ({"trainable": "some"}, "trainable: expected one of all, filters, nothing, got 'some'"),
    ],
)
def test_a_layer_that_cannot_be_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        layer(4, 2, **options)


def test_coefficients_are_one_row_for_each_channel_after_the_upsampling():
    with pytest.raises(ValueError, match="coefficients: expected 1 rows, one per channel"):
        jl.Layer(np.ones((4, 1, 1, 1)), np.zeros((4, 5)), upsampling=2)


@pytest.mark.parametrize(
    ("bits", "message"),
    [
        (None, "trials_range: expected a range of K for layers with sets"),
        ((0, 16), "trials_range: expected the smallest and the largest K of a tied network"),
        (
            (16, 16),
            "trials_range: expected the smallest and the largest K of a tied network",
        ),
    ],
)
def test_a_network_with_sets_needs_a_range_of_k(bits, message):
    with pytest.raises(ValueError, match=message):
        jl.Network(conditional().layers, jl.Sensor(), trials_range=bits)


def test_sets_are_as_many_in_all_layers_and_four_at_least():
    layers = list(conditional().layers)
    for kept in (3, 5):
        cut = dataclasses.replace(layers[1], filters=layers[1].filters[:kept])
        with pytest.raises(ValueError, match="the same number of parameter sets"):
            jl.Network([layers[0], cut, *layers[2:]], jl.Sensor(), trials_range=BETWEEN)


def test_a_k_out_of_range_is_refused():
    with pytest.raises(ValueError, match="for 1 to 256 bits per pixel, got 257"):
        conditional().reconstruct(np.ones((4, 4), int), jl.Sensor(frames=257))
    with pytest.raises(ValueError, match="architecture: expected one of small, medium, large"):
        jl.Network.residual(SENSOR, "huge")


def test_the_halo_of_members():
    for name in ARCHITECTURES:
        layers = jl.Network.residual(SENSOR, name, rng=0).layers
        assert halo_radius(layers) % size_divisor(layers) == 0
