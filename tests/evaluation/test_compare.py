"""The comparison of methods, also those of the caller, on one image."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.networks.planes_network import ColorNetwork
from jotlight.networks.pretrained import MOSAIC_FILE
from jotlight.sensing.parameters.mosaic import Mosaic

SENSOR = jl.Sensor(oversampling=2, frames=4)
IMAGE = jl.datasets.photograph()[100:140, 180:220]


def mine(bits):
    return bits.counts() / 16


def test_functions_networks_and_names_are_compared_on_the_same_bits():
    network = jl.Network.initial(SENSOR)
    methods = {"mine": mine, "maximum": "mle", "own": network}
    found = jl.compare(methods, IMAGE, SENSOR, rng=3, threads=1)
    bits = SENSOR.expose(IMAGE, rng=3)
    np.testing.assert_array_equal(found.bits.packed, bits.packed)
    expected = [np.float32(mine(bits)), jl.mle(bits), network(bits)]
    for result, estimate in zip(found.results, expected, strict=True):
        np.testing.assert_array_equal(result.estimate, estimate)
        assert result.psnr == jl.metrics.psnr(estimate, IMAGE)
    assert [row[0] for row in found.rows()] == ["mine", "maximum", "own"]


def test_a_function_of_the_caller_runs_once_on_the_whole_image():
    sizes = []

    def record(bits):
        sizes.append(bits.shape)
        return bits.counts() / 16 * np.ones(IMAGE.shape)

    jl.compare({"a": record}, IMAGE, SENSOR)
    assert sizes == [(4, 80, 80)]


def test_a_comparison_is_a_table_in_terminals_and_notebooks():
    found = jl.compare(["mle", "network-small"], IMAGE, SENSOR)
    lines = str(found).splitlines()
    assert lines[0].split() == ["method", "PSNR", "SSIM", "time"]
    assert lines[1].startswith("maximum likelihood")
    assert f"{found.results[0].psnr:.2f} dB" in lines[1]
    assert len({len(line) for line in lines}) == 1
    assert "<td>network, small, for K = 16</td>" in found._repr_html_()
    assert len(repr(found)) < 400


def test_the_figure_shows_the_image_the_bits_and_all_estimates():
    figure = jl.compare({"a": mine, "b": "mle"}, IMAGE, SENSOR).plot()
    images = [axes.images[0].get_array() for axes in figure.axes]
    assert len(images) == 8
    np.testing.assert_allclose(images[0], IMAGE)


def test_the_recommended_method_is_named_so():
    found = jl.compare(["mle", None], IMAGE, SENSOR)
    assert found.results[1].method == "recommended"
    assert str(found).splitlines()[2].startswith("recommended ")


def test_all_methods_are_the_default():
    small = IMAGE[:16, :16]
    found = jl.compare(None, small, SENSOR)
    assert {"mle", "admm-tv", "network-large"} <= {result.method for result in found.results}


@pytest.mark.parametrize(
    ("methods", "error", "message"),
    [
        (IMAGE, TypeError, "expected the name of a method, a network, or a function"),
        (jl.FilmNetwork.initial(), TypeError, "for 'FilmNetwork', got a film network; jotlight"),
        ([mine, mine], ValueError, "different titles, got mine, mine; pass a mapping"),
        ({1: "mle", "1": mine}, ValueError, "methods: expected different titles"),
        (["best"], ValueError, "method: there is no 'best'"),
        ({"a": "best"}, ValueError, "method: there is no 'best'"),
        ({"a": 3}, TypeError, "a function for 'a', got 3"),
        ({}, ValueError, "methods: expected at least one"),
        ({"a": lambda bits: np.zeros((2, 2))}, ValueError, "expected an image of shape"),
    ],
)
def test_what_is_no_method_is_refused(methods, error, message):
    with pytest.raises(error, match=message):
        jl.compare(methods, IMAGE, SENSOR)


def test_one_method_and_lists_of_functions_are_compared():
    assert [each.method for each in jl.compare("mle", IMAGE, SENSOR).results] == ["mle"]
    assert [each.method for each in jl.compare(mine, IMAGE, SENSOR).results] == ["mine"]
    network = jl.pretrained(SENSOR)
    found = jl.compare([mine, "mle", network], IMAGE, SENSOR)
    assert [each.method for each in found.results] == ["mine", "mle", "Network"]
    assert "maximum likelihood" in repr(found)


def test_images_that_cannot_be_shown_are_refused():
    with pytest.raises(ValueError, match="gray or RGB image"):
        jl.compare(["mle"], np.full((16, 16, 4), 0.5), SENSOR, channel_axis=-1)


@pytest.mark.parametrize(
    "options",
    [
        {"gain": [2.0, 2.0, 0.5, 0.5]},
        {"bit_depth": 4},
        *(
            pytest.param(options, marks=pytest.mark.slow)
            for options in (
                {"threshold": [1, 1, 2, 2]},
                {"threshold": 1 + np.indices((48, 40)).sum(axis=0) % 2},
                {"read_noise": 0.2},
            )
        ),
    ],
)
def test_sensors_of_every_kind_are_compared(options):
    image = jl.datasets.photograph()[100:148, 180:220]
    sensor = jl.Sensor(frames=4, **options)
    found = jl.compare(["mle", "network-small"], image, sensor, rng=1)
    for result in found.results:
        expected = jl.reconstruct(sensor.expose(image, rng=1), method=result.method)
        np.testing.assert_array_equal(result.estimate, expected)
    assert found.results[0].psnr < found.results[1].psnr
    name = "readings of 4 bits" if "bit_depth" in options else "bits"
    assert name in {text.get_text() for text in found.plot().texts}


@pytest.mark.slow
@pytest.mark.parametrize("mosaic", ["RGGB", None])
def test_the_color_network_is_one_of_the_methods_for_colors(mosaic):
    image = jl.datasets.photograph("astronaut")[100:132, 180:212]
    found = jl.compare(None, image, jl.Sensor(frames=8, mosaic=mosaic), channel_axis=-1)
    best = max(found.results, key=lambda result: result.psnr)
    assert best.method == "network-color"
    assert best.estimate.shape == image.shape
    assert "network, color" in repr(found)


@pytest.mark.parametrize("mosaic", ["RGGB", None])
def test_the_color_network_is_compared_by_its_name(mosaic):
    image = jl.datasets.photograph("astronaut")[100:132, 180:212]
    sensor = jl.Sensor(frames=8, mosaic=mosaic)
    found = jl.compare(["network-color", "mle"], image, sensor, channel_axis=-1)
    assert found.titles["network-color"] == "network, color"
    expected = jl.reconstruct(found.bits)
    np.testing.assert_array_equal(found.results[0].estimate, expected)


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (IMAGE[:16, :16], {}, "methods: network-color takes red, green, and blue, got a gray"),
        (np.full((16, 16, 3), 0.5), {"kernel": "cubic", "oversampling": 2}, "got the kernel cubic"),
    ],
    ids=["gray", "kernel"],
)
def test_the_color_network_is_refused_before_any_work(image, options, message):
    axis = None if image.ndim == 2 else -1
    with pytest.raises(ValueError, match=message):
        jl.compare(["network-color"], image, jl.Sensor(frames=8, **options), channel_axis=axis)


def test_a_color_network_is_compared():
    network = ColorNetwork.load(MOSAIC_FILE)
    image = jl.datasets.photograph("astronaut")[100:132, 180:212]
    found = jl.compare([network], image, jl.Sensor(frames=8, mosaic="RGGB"), channel_axis=-1)
    expected = jl.reconstruct(found.bits, method=network)
    np.testing.assert_array_equal(found.results[0].estimate, expected)


def test_a_mosaic_of_the_size_of_the_image_is_compared():
    image = np.full((24, 20, 3), [0.6, 0.4, 0.2])
    pattern = np.random.default_rng(0).choice(list("RGBW"), size=(24, 20))
    found = jl.compare(["mle"], image, jl.Sensor(frames=64, mosaic=pattern), channel_axis=-1)
    assert found.results[0].psnr > 10


@pytest.mark.parametrize("method", ["mle", None])
def test_the_white_balance_changes_no_score(method):
    image = jl.datasets.photograph("astronaut")[100:132, 180:212]
    factors = np.float32([1.25, 1.0, 1.5])
    sensor = jl.Sensor(frames=8, mosaic=Mosaic("RGGB", white_balance=factors))
    balanced = jl.reconstruct(sensor.expose(image, rng=0), method=method)
    expected = jl.metrics.psnr(balanced / factors, image)
    (result,) = jl.compare({"own": method}, image, sensor).results
    assert result.psnr == pytest.approx(expected, abs=1e-4)
    np.testing.assert_allclose(result.estimate, balanced / factors, atol=1e-6)
    assert jl.metrics.psnr(balanced, image) < expected - 0.5


def test_colors_of_a_mosaic_are_on_the_last_axis():
    image = np.full((24, 20, 3), [0.6, 0.4, 0.2])
    sensor = jl.Sensor(frames=8, mosaic="RGGB")
    found, again = (jl.compare("mle", image, sensor, channel_axis=axis) for axis in (None, -1))
    np.testing.assert_array_equal(found.results[0].estimate, again.results[0].estimate)
    with pytest.raises(ValueError, match="image: expected red, green, and blue"):
        jl.compare("mle", image[..., 0], sensor)


def test_one_channel_is_gray():
    methods = jl.compare(None, IMAGE[:16, :16, None], jl.Sensor(frames=8), channel_axis=-1).titles
    assert "network-medium" in methods
    assert "network-color" not in methods
