import copy
import pickle

import numpy as np
import pytest
from scipy.ndimage import convolve

import jotlight as jl
from reference import methods, networks
from reference.networks import random_bits, random_network


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
def test_the_picture_is_the_twins(channels, sizes, tied, height, width, masked):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(oversampling=3, frames=2)
    network = random_network(rng, sensor, channels, sizes, tied=tied)
    bits = random_bits(rng, sensor, height, width)
    dead = None
    if masked:
        dead = rng.random(bits.shape[1:]) < 0.4
        dead[1::3, 1::3] = False
    picture = network.reconstruct(jl.Bits.from_array(bits), sensor.replace(mask=dead))
    assert (picture.shape, picture.dtype) == ((height, width), np.float32)
    np.testing.assert_allclose(picture, twin(network, bits, dead), atol=2e-5)


@pytest.mark.parametrize("tied", [True, False])
@pytest.mark.parametrize(("channels", "sizes"), [SHAPES[1], SHAPES[4]])
@pytest.mark.parametrize(("height", "width"), [(130, 1024), (65, 1031), (3, 2059)])
def test_tiles_of_the_engine_do_not_show(channels, sizes, tied, height, width):
    rng = np.random.default_rng(0)
    sensor = jl.Sensor(oversampling=3)
    network = random_network(rng, sensor, channels, sizes, tied=tied)
    bits = random_bits(rng, sensor, height, width)
    expected = twin(network, bits)
    packed = jl.Bits.from_array(bits)
    for threads in (1, 2, 64):
        picture = network.reconstruct(packed, threads=threads)
        np.testing.assert_allclose(picture, expected, atol=5e-5)


def test_splines_of_more_knots_than_a_byte_tells_apart():
    rng = np.random.default_rng(1)
    sensor = jl.Sensor(frames=900)
    line = np.sort(rng.uniform(0, 1, (1, 400)))
    taps = rng.uniform(0, 0.1, (1, 1, 3, 3))
    layers = [jl.Layer(np.ones((1, 1, 1, 1)), line, 0.0, 900 / 397), jl.Layer(taps, line, 0, 1e-3)]
    network = jl.Network(layers, sensor)
    counts = rng.integers(0, 901, (40, 30))
    expected = networks.network(network.layers, counts[None].astype(float))
    np.testing.assert_allclose(network.reconstruct(counts), expected, atol=2e-5)


@pytest.mark.parametrize("oversampling", [1, 7, 9, 12])
def test_blocks_of_any_width_are_weighed(oversampling):
    rng = np.random.default_rng(1)
    sensor = jl.Sensor(oversampling=oversampling)
    network = random_network(rng, sensor, [1], [], tied=False)
    bits = random_bits(rng, sensor, 3, 5)
    picture = network.reconstruct(jl.Bits.from_array(bits))
    np.testing.assert_allclose(picture, twin(network, bits), atol=2e-5)


def test_a_mask_without_dead_jots_changes_nothing():
    rng = np.random.default_rng(2)
    sensor = jl.Sensor(oversampling=3, frames=2)
    network = random_network(rng, sensor, [3, 1], [(3, 3)], tied=False)
    bits = jl.Bits.from_array(random_bits(rng, sensor, 6, 7))
    masked = network.reconstruct(bits, sensor.replace(mask=np.zeros((18, 21), bool)))
    np.testing.assert_array_equal(masked, network.reconstruct(bits))


def test_splines_are_constant_outside_of_their_knots():
    coefficients = np.random.default_rng(3).normal(0, 1, (1, 9))
    layer = jl.Layer(np.ones((1, 1, 1, 1)), coefficients, 4.0, 1.0)
    picture = jl.Network([layer], jl.Sensor(frames=16)).reconstruct(np.arange(17)[None])[0]
    expected = networks.spline(np.arange(17.0), coefficients[0], 4.0, 1.0)
    np.testing.assert_allclose(picture, expected, atol=1e-6)
    assert len(set(picture[:5])) == len(set(picture[10:])) == 1
    assert len(set(picture)) == 7


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_do_not_change_the_picture(threads):
    rng = np.random.default_rng(4)
    sensor = jl.Sensor(oversampling=2, frames=3)
    network = random_network(rng, sensor, [3, 2, 1], [(5, 4), (3, 3)], tied=False)
    bits = jl.Bits.from_array(random_bits(rng, sensor, 30, 90))
    expected = network.reconstruct(bits)
    np.testing.assert_array_equal(network.reconstruct(bits, threads=threads), expected)


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
def test_a_tile_with_a_border_of_the_halo_has_the_pixels_of_the_whole(channels, sizes, halo):
    rng = np.random.default_rng(5)
    sensor = jl.Sensor(oversampling=2)
    network = random_network(rng, sensor, channels, sizes, tied=False)
    assert network.halo == halo
    bits = random_bits(rng, sensor, 40, 90)
    whole = network.reconstruct(jl.Bits.from_array(bits))

    def part(rows, columns, border):
        outer = [
            (max(0, low - border), min(most, high + border))
            for (low, high), most in zip((rows, columns), (40, 90), strict=True)
        ]
        (top, bottom), (left, right) = outer
        tile = network.reconstruct(
            jl.Bits.from_array(bits[:, 2 * top : 2 * bottom, 2 * left : 2 * right])
        )
        return tile[rows[0] - top : rows[1] - top, columns[0] - left : columns[1] - left]

    for rows, columns in [((15, 25), (20, 31)), ((0, 12), (0, 80)), ((11, 40), (77, 90))]:
        inside = whole[slice(*rows), slice(*columns)]
        np.testing.assert_array_equal(part(rows, columns, halo), inside)
    if halo:
        assert (part((15, 25), (20, 31), halo - 1) != whole[15:25, 20:31]).any()


@pytest.mark.parametrize("sigma", [0.25, 0.7, 1.0, 3.0])
@pytest.mark.parametrize(
    "sensor",
    [
        jl.Sensor(oversampling=3),
        jl.Sensor(oversampling=4),
        jl.Sensor(frames=100),
        jl.Sensor(frames=25, threshold=2, max_intensity=4.0),
        jl.Sensor(frames=36, dark_counts=0.1, efficiency=0.6, gain=50.0, max_intensity=1.5),
    ],
    ids=repr,
)
def test_initial_is_the_noniterative_method_with_a_gaussian(sensor, sigma):
    bits = sensor.bits_per_pixel
    line = np.exp(-0.5 * (np.arange(15) - 7) ** 2 / sigma**2)
    gaussian = np.outer(line, line) / line.sum() ** 2
    network = jl.Network.initial(sensor, sigma=sigma)
    np.testing.assert_allclose(network.layers[1].filters[0, 0], gaussian, rtol=1e-6, atol=1e-12)

    def intensity(z):
        return methods.mle(
            np.clip(methods.algebraic_inverse(z, bits), 0, bits),
            bits,
            threshold=sensor.threshold,
            sensitivity=sensor.efficiency * sensor.gain / bits,
            dark=sensor.dark_counts,
            max_intensity=sensor.max_intensity,
        )

    def curve(layer, z):
        return networks.spline(z, layer.coefficients[0], layer.start, layer.spacing)

    # The only errors are those of the splines; h2 is an average and does not make them larger.
    first, second = network.layers
    counts = np.arange(bits + 1)
    z = np.linspace(*methods.anscombe(np.array([0, bits]), bits), 20_001)
    first_error = np.abs(curve(first, counts) - methods.anscombe(counts, bits)).max()
    second_error = np.abs(curve(second, z) - intensity(z)).max()
    steepest = np.abs(np.diff(intensity(z)) / np.diff(z)).max()
    bound = steepest * first_error + second_error + 1e-5
    assert bound < 0.02 * sensor.max_intensity

    seen = np.random.default_rng(6).integers(0, bits + 1, (20, 30))
    expected = jl.noniterative(
        seen,
        sensor,
        denoiser=lambda image: convolve(image, gaussian, mode="reflect"),
        inverse="algebraic",
    )
    np.testing.assert_allclose(network.reconstruct(seen), expected, atol=bound)


def test_a_map_of_dark_counts_enters_initial_by_the_median_of_its_live_jots():
    dark = np.array([[0.1, 0.2, 0.3], [4.0, 9.0, 9.0]])
    mapped = jl.Sensor(frames=16, dark_counts=dark, mask=dark == 9)
    plain = jl.Sensor(frames=16, dark_counts=0.25)
    for mine, theirs in zip(
        jl.Network.initial(mapped).layers, jl.Network.initial(plain).layers, strict=True
    ):
        np.testing.assert_allclose(mine.coefficients, theirs.coefficients, atol=1e-5)


def test_initial_weighs_jots_alike_whether_tied_or_not():
    sensor = jl.Sensor(oversampling=3, frames=2)
    bits = jl.Bits.from_array(random_bits(np.random.default_rng(7), sensor, 8, 9))
    tied, untied = (jl.Network.initial(sensor, tied=tied) for tied in (True, False))
    assert (tied.tied, untied.tied) == (True, False)
    assert untied.layers[0].filters.shape == (1, 2, 3, 3)
    np.testing.assert_array_equal(untied.reconstruct(bits), tied.reconstruct(bits))


@pytest.mark.parametrize("most", [0.3, 1.0, 8.0])
def test_initial_stays_between_0_and_the_largest_intensity(most):
    sensor = jl.Sensor(frames=9, max_intensity=most)
    counts = np.random.default_rng(8).choice([0, 4, 9], (40, 50))
    picture = jl.Network.initial(sensor, sigma=0.4).reconstruct(counts)
    assert picture.min() >= 0
    assert picture.max() <= np.float32(most)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sigma": 0}, "sigma: expected a number above 0"),
        ({"sigma": np.nan}, "sigma"),
        ({"taps": 4}, "taps: expected an odd number, got 4"),
        ({"taps": -1}, "taps"),
        ({"coefficients": 4}, "coefficients: expected at least 5"),
    ],
)
def test_initial_refuses(options, message):
    with pytest.raises(ValueError, match=message):
        jl.Network.initial(jl.Sensor(), **options)


@pytest.mark.parametrize("taps", [1, 3, 21])
@pytest.mark.parametrize("coefficients", [5, 40])
def test_initial_has_the_size_that_is_asked_for(taps, coefficients):
    network = jl.Network.initial(jl.Sensor(), taps=taps, coefficients=coefficients)
    assert network.layers[1].filters.shape == (1, 1, taps, taps)
    assert {layer.coefficients.shape for layer in network.layers} == {(1, coefficients)}
    assert network.halo == taps // 2


@pytest.mark.parametrize("frames", [1, 4, 16])
def test_a_tied_network_serves_frames_in_time_as_jots_in_space(frames):
    network = jl.Network.initial(jl.Sensor(oversampling=4))
    counts = np.random.default_rng(9).integers(0, 17, (6, 7))
    side = {1: 4, 4: 2, 16: 1}[frames]
    sensor = jl.Sensor(oversampling=side, frames=frames)
    expected = network.reconstruct(counts)
    np.testing.assert_array_equal(network.reconstruct(counts, sensor), expected)
    order = np.arange(16).reshape(frames, side, side)
    values = np.tile(order, (6, 7)) < counts.repeat(side, 0).repeat(side, 1)
    carried = jl.Bits.from_array(values, sensor)
    np.testing.assert_array_equal(network.reconstruct(carried), expected)
    np.testing.assert_array_equal(network.reconstruct(jl.Bits.from_array(values), sensor), expected)


@pytest.mark.parametrize("tied", [True, False])
def test_colours_do_not_mix(tied):
    sensor = jl.Sensor(oversampling=2)
    network = jl.Network.initial(sensor, tied=tied)
    bits = np.random.default_rng(10).random((1, 8, 10, 3)) < 0.5
    picture = network.reconstruct(jl.Bits.from_array(bits))
    for channel in range(3):
        alone = network.reconstruct(jl.Bits.from_array(bits[..., channel]))
        np.testing.assert_array_equal(picture[..., channel], alone)


def test_a_tied_network_takes_dark_counts_that_it_was_not_made_for():
    rng = np.random.default_rng(11)
    network = jl.Network.initial(jl.Sensor(frames=400), sigma=0.25)
    dark = rng.uniform(0, 1.5, (30, 30))
    counts = rng.binomial(400, 1 - np.exp(-0.5 - dark))
    sensor = jl.Sensor(frames=400, dark_counts=dark)
    picture = network.reconstruct(counts, sensor)
    np.testing.assert_allclose(picture, jl.mle(counts, sensor), atol=0.02)


@pytest.mark.parametrize("tied", [True, False])
def test_pixels_without_live_jots_are_filled(tied):
    sensor = jl.Sensor(oversampling=2)
    network = jl.Network.initial(sensor, tied=tied)
    mask = np.zeros((20, 20), bool)
    mask[6:12, 6:12] = True
    bits = np.random.default_rng(12).random((1, 20, 20)) < 0.5
    with pytest.warns(jl.JotlightWarning, match="9 of 100 pixels"):
        first = network.reconstruct(jl.Bits.from_array(bits), sensor.replace(mask=mask))
    with pytest.warns(jl.JotlightWarning):
        second = network.reconstruct(jl.Bits.from_array(bits ^ mask), sensor.replace(mask=mask))
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, second)


def test_jots_that_the_network_gives_no_weight_are_no_blind_pixel():
    filters = np.zeros((1, 1, 2, 2))
    filters[0, 0, 0, 0] = 1
    ramp = np.arange(-1, 5.0)[None]
    network = jl.Network([jl.Layer(filters, ramp, 0.0, 1.0)], jl.Sensor(oversampling=2))
    bits = np.zeros((1, 2, 4), bool)
    bits[0, 1] = 1, 1, 1, 0
    mask = np.zeros((2, 4), bool)
    mask[0, ::2] = True
    picture = network.reconstruct(jl.Bits.from_array(bits), network.sensor.replace(mask=mask))
    np.testing.assert_allclose(picture, [[2 / 3, 1 / 3]], rtol=1e-6)


SPACE = jl.Sensor(oversampling=4)
TIED, UNTIED = (jl.Network.initial(SPACE, tied=tied) for tied in (True, False))
BITS = jl.Bits.from_array(np.zeros((1, 8, 8), bool))


@pytest.mark.parametrize("network", [TIED, UNTIED], ids=["tied", "untied"])
@pytest.mark.parametrize(
    "change",
    [
        {"frames": 2},
        {"oversampling": 2},
        {"threshold": 2},
        {"gain": 8.0},
        {"efficiency": 0.5},
        {"max_intensity": 2.0},
    ],
    ids=str,
)
def test_a_sensor_that_answers_to_light_otherwise_is_refused(network, change):
    with pytest.raises(ValueError, match=r"sensor: the network (needs data with its own|is for)"):
        network.reconstruct(BITS, SPACE.replace(**change))


@pytest.mark.parametrize(
    ("network", "data", "sensor", "error", "message"),
    [
        (UNTIED, np.zeros((2, 2), int), None, TypeError, "a tied network takes counts"),
        (UNTIED, BITS, jl.Sensor(frames=16), ValueError, "1 frames of 4 x 4 .* 16 frames of 1 x 1"),
        (UNTIED, BITS, SPACE.replace(dark_counts=0.1), ValueError, "a tied network takes others"),
        (
            UNTIED,
            BITS,
            SPACE.replace(dark_counts=np.eye(8)),
            ValueError,
            "a tied network takes others",
        ),
        (TIED, [[17]], None, ValueError, "expected 0 to K = 16"),
        (TIED, [[0.5]], None, TypeError, "whole numbers"),
        (TIED, BITS, SPACE.replace(mask=np.zeros((4, 4), bool)), ValueError, "mask"),
        (UNTIED, BITS, SPACE.replace(mask=np.zeros((4, 4), bool)), ValueError, "mask"),
    ],
)
def test_data_that_do_not_fit_are_refused(network, data, sensor, error, message):
    with pytest.raises(error, match=message):
        network.reconstruct(data, sensor)


ONES = np.ones((1, 1, 1, 1))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.ones((1, 1, 1)), np.ones((1, 5)), 0, 1), "filters: expected floats of 4 dimensions"),
        ((np.ones((1, 1, 1, 1), int), np.ones((1, 5)), 0, 1), "filters: .* got int64"),
        ((np.ones((1, 1, 0, 1)), np.ones((1, 5)), 0, 1), "filters"),
        ((ONES * np.nan, np.ones((1, 5)), 0, 1), "filters: expected finite"),
        ((ONES * 1e39, np.ones((1, 5)), 0, 1), "filters: expected finite"),
        ((ONES, np.full((1, 5), np.inf), 0, 1), "coefficients: expected finite"),
        ((ONES, np.ones((2, 5)), 0, 1), "coefficients: expected 1 rows"),
        ((ONES, np.ones((1, 3)), 0, 1), "of at least 4"),
        ((ONES, np.ones((1, 5)), np.nan, 1), "start and spacing"),
        ((ONES, np.ones((1, 5)), 1e39, 1), "start and spacing"),
        ((ONES, np.ones((1, 5)), 0, 0), "start and spacing"),
        ((ONES, np.ones((1, 5)), 0, -1), "start and spacing"),
        ((ONES, np.ones((1, 5)), 0, 1e-60), "start and spacing"),
        ((ONES, np.ones((1, 5)), 0, np.inf), "start and spacing"),
    ],
)
def test_a_layer_of_numbers_that_do_not_fit_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        jl.Layer(*arguments)


@pytest.mark.parametrize(
    ("filters", "message"),
    [
        ([], "at least one, got none"),
        ([(1, 2, 4, 4)], r"shape \(C, 1, 4, 4\) in the first layer, or \(C, 1, 1, 1\)"),
        ([(1, 1, 4, 3)], r"shape \(C, 1, 4, 4\)"),
        ([(2, 1, 1, 1), (1, 1, 3, 3)], "expected 2 input channels in layer 1"),
        ([(1, 1, 1, 1), (2, 1, 3, 3)], "one output channel of the last layer.*got 2"),
    ],
)
def test_layers_that_do_not_fit_each_other_or_the_sensor_are_refused(filters, message):
    layers = [jl.Layer(np.ones(shape), np.ones((shape[0], 5)), 0, 1) for shape in filters]
    with pytest.raises(ValueError, match=message):
        jl.Network(layers, SPACE)


def test_a_network_tells_what_it_is():
    text = repr(
        random_network(np.random.default_rng(14), SPACE, [2, 3, 1], [(3, 3)] * 2, tied=True)
    )
    assert text.startswith("<Network: channels 2 -> 3 -> 1, ")
    assert f"{2 + 22 + 54 + 33 + 27 + 11} parameters" in text


def test_a_network_for_another_kernel_is_refused():
    with pytest.raises(ValueError, match="for the box kernel, got cubic"):
        TIED.reconstruct(BITS, SPACE.replace(kernel="cubic"))


def test_a_layer_keeps_what_it_was_made_of():
    filters = np.ones((1, 1, 3, 3), np.float32)
    layer = jl.Layer(filters, None)
    filters[:] = 2
    assert (layer.filters == 1).all()
    with pytest.raises(ValueError, match="read-only"):
        layer.filters[:] = 2


def pickled(network):
    return pickle.loads(pickle.dumps(network))


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, pickled])
def test_a_network_that_has_run_is_copied_and_pickled(again):
    rng = np.random.default_rng(6)
    sensor = jl.Sensor(oversampling=2, frames=3)
    network = random_network(rng, sensor, [2, 1], [(3, 3)], tied=False)
    bits = jl.Bits.from_array(random_bits(rng, sensor, 20, 30))
    expected = network.reconstruct(bits)
    copied = again(network)
    np.testing.assert_array_equal(copied.reconstruct(bits), expected)
    assert not copied.layers[0].filters.flags.writeable


def test_a_network_that_is_told_another_k_forgets_the_last_one():
    network = jl.Network.conditional("small", trials_range=(2, 32), rng=0)
    counts = np.random.default_rng(7).integers(0, 3, (20, 30))
    four, nine = jl.Sensor(frames=4), jl.Sensor(frames=9)
    first, other = network.reconstruct(counts, four), network.reconstruct(counts, nine)
    assert (first != other).any()
    np.testing.assert_array_equal(network.reconstruct(counts, four), first)


def test_parts_of_a_picture_whose_jots_are_weighed_singly_are_those_of_the_whole(monkeypatch):
    rng = np.random.default_rng(9)
    sensor = jl.Sensor(oversampling=4)
    network = random_network(rng, sensor, [2, 1], [(3, 3)], tied=False)
    # Enough pixels for one table of all blocks, which the parts are too small for.
    bits = jl.Bits.from_array(random_bits(rng, sensor, 960, 140))
    whole = network.reconstruct(bits)
    monkeypatch.setattr("jotlight.networks.inference.FLOPS_PER_BAND", 1)
    np.testing.assert_array_equal(network.reconstruct(bits), whole)
