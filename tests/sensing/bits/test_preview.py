"""Previews of bits for people: what they show, and how much they read."""

import matplotlib as mpl
import numpy as np
import pytest

import jotlight as jl
from jotlight.sensing.bits.frames import Frames
from jotlight.sensing.bits.preview import preview


def random_bits(*shape, sensor=None):
    return jl.Bits.from_array(np.random.default_rng(0).random(shape) < 0.3, sensor)


def test_a_single_frame_is_shown_as_it_is():
    bits = random_bits(1, 5, 9)
    image, frames = preview(bits)
    np.testing.assert_array_equal(image, bits[0])
    assert frames == range(1)


@pytest.mark.parametrize(("channels", "shape"), [((), (4, 6)), ((3,), (4, 6, 3)), ((2,), (4, 6))])
def test_several_frames_are_shown_as_fractions_of_ones(channels, shape):
    sensor = jl.Sensor(frames=50, oversampling=2)
    bits = random_bits(50, 8, 12, *channels, sensor=sensor)
    image, frames = preview(bits)
    assert frames == range(50)
    assert image.shape == shape
    assert image.min() >= 0
    assert image.max() == 1
    fractions = bits.counts() / 200
    if channels == (2,):
        fractions = fractions.mean(axis=2)
    white = np.percentile(fractions, 99.5)
    np.testing.assert_allclose(image, np.minimum(fractions / white, 1))


def test_only_the_first_frames_of_long_captures_are_read():
    read = []

    def frames_of(start, stop):
        read.append(stop)
        return np.zeros((stop - start, 8, 2), np.uint8)

    bits = jl.Bits(Frames((10**9, 8, 2), frames_of))
    image, frames = preview(bits, max_bytes=160)
    assert frames == range(10)
    assert max(read) == 10
    assert not image.any()
    assert len(preview(bits, max_bytes=1)[1]) == 1


def test_notebooks_show_an_image_and_facts(tmp_path):
    sensor = jl.Sensor(frames=16, oversampling=2)
    text = random_bits(16, 300, 600, 3, sensor=sensor)._repr_html_()
    for part in ("16", "300 x 600", "channels", "Sensor(oversampling=2, frames=16)", "<img"):
        assert part in text
    assert len(text) < 100_000
    path = tmp_path / "a<b>&.npy"
    jl.save(random_bits(20, 8, 8), path)
    text = jl.open(path)._repr_html_()
    assert "a&lt;b&gt;&amp;.npy" in text
    assert "<b>&" not in text


def test_the_mean_reading_is_shown_with_pyplot(monkeypatch):
    plt = pytest.importorskip("matplotlib.pyplot")
    shown = []
    monkeypatch.setattr(plt, "show", lambda: shown.append(plt.gcf()))
    array = np.arange(24).reshape(2, 3, 4) % 16
    jl.Readings(array, jl.Sensor(frames=2, bit_depth=4)).show()
    (axes,) = shown[0].axes
    assert "mean reading" in axes.get_title()
    mean = array.mean(axis=0)
    np.testing.assert_allclose(
        axes.images[0].get_array(), np.minimum(mean / np.percentile(mean, 99.5), 1)
    )
    plt.close("all")


def test_bits_are_shown_with_pyplot(monkeypatch):
    mpl.use("agg")
    import matplotlib.pyplot as plt

    shown = []
    monkeypatch.setattr(plt, "show", lambda: shown.append(plt.gcf()))
    bits = random_bits(4, 8, 8)
    bits.show()
    (axes,) = shown[0].axes
    np.testing.assert_array_equal(axes.images[0].get_array(), preview(bits)[0])
    assert axes.get_title() == "how often each pixel is 1"
    plt.close("all")
