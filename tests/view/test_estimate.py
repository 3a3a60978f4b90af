"""The images of the page are those of the library."""

import functools
import io

import numpy as np
import pytest
import tifffile
from PIL import Image

import jotlight as jl
from jotlight.evaluation.methods import COLOR_NETWORK, METHODS
from jotlight.images.io import display_levels
from jotlight.images.tone import CURVES, Tone
from jotlight.view.alignment import merge_window
from jotlight.view.display import display, display_difference, fit_white
from jotlight.view.estimate import estimate, fraction_at, recommend
from jotlight.view.facts import describe_capture
from jotlight.view.notes import collected
from jotlight.view.overlays import DEAD, HOT, JotMap, error_levels, find_errors, find_saturated
from jotlight.view.running_counts import RunningCounts
from jotlight.view.saving import save_view
from jotlight.view.state import ViewState
from jotlight.view.viewed import Viewed
from moving import in_memory

PHOTO = jl.datasets.photograph("camera")[100:148, 180:244]
MASK = np.random.default_rng(1).random(PHOTO.shape) < 0.05
SENSORS = {
    "plain": jl.Sensor(frames=48, gain=30.0, max_intensity=4.0),
    "oversampled": jl.Sensor(frames=12, oversampling=2, max_intensity=4.0),
    "masked": jl.Sensor(frames=48, mask=MASK, dark_counts=0.01, max_intensity=4.0),
    "smooth": jl.Sensor(frames=12, oversampling=2, kernel="linear", max_intensity=4.0),
    "several": jl.Sensor(frames=24, bit_depth=4, gain=40.0, max_intensity=4.0),
    "noisy": jl.Sensor(frames=24, bit_depth=2, read_noise=0.3, oversampling=2, max_intensity=4.0),
    "noisy bits": jl.Sensor(frames=24, read_noise=0.3, max_intensity=4.0),
    "bracket": jl.Sensor(frames=24, gain=[0.5, 2.0] * 12, max_intensity=4.0),
    "thresholds": jl.Sensor(frames=24, gain=50.0, threshold=[1, 3] * 12, max_intensity=4.0),
}
SLOW = "noisy", "noisy bits", "thresholds"


def viewed_of(name, **changes):
    sensor = SENSORS[name].replace(**changes)
    return Viewed.from_data(sensor.expose(PHOTO, rng=0), name)


def made(viewed, span, method):
    return estimate(viewed, span, method, RunningCounts(viewed).move(span))


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in SENSORS]
)
@pytest.mark.parametrize("method", ["mle", "network-medium", "noniterative-gaussian", "admm-tv"])
def test_the_estimate_equals_that_of_the_library(name, method):
    viewed, span = viewed_of(name), range(4, 12)
    expected = jl.reconstruct(viewed.data[4:12], method=method)
    np.testing.assert_array_equal(made(viewed, span, method).image, expected)


class Unread(Viewed):
    """A capture whose frames must not be read again after they have been counted."""

    def part(self, frames):
        raise AssertionError(f"{frames} are read again")


METHODS_OF_COUNTS = [
    (kind, name)
    for kind in ("plain", "oversampled", "masked", "smooth")
    for name, method in METHODS.items()
    if method.available
    and not (kind == "smooth" and (method.iterative or method.unsupported_reason(SENSORS[kind])))
]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
@pytest.mark.parametrize(("kind", "method"), METHODS_OF_COUNTS)
def test_frames_that_are_counted_are_not_read_again(kind, method):
    viewed, span = viewed_of(kind), range(4, 12)
    counts = RunningCounts(viewed).move(span)
    image = estimate(Unread(kind, viewed.data, viewed.sensor_of_all, True), span, method, counts)
    np.testing.assert_array_equal(image.image, jl.reconstruct(viewed.data[4:12], method=method))


def test_color_bits_are_estimated():
    sensor = jl.Sensor(frames=8, max_intensity=4.0)
    bits = sensor.expose(np.stack([PHOTO] * 3, axis=2), rng=0, channel_axis=-1)
    viewed = Viewed.from_data(bits)
    image = made(viewed, range(2, 7), "mle")
    np.testing.assert_array_equal(image.image, jl.mle(bits[2:7]))
    assert display(image, ViewState(), 1.0).levels.shape == (*PHOTO.shape, 3)


def test_the_color_network_is_recommended_for_three_channels():
    sensor = jl.Sensor(frames=8, max_intensity=4.0)
    bits = sensor.expose(np.stack([PHOTO] * 3, axis=2), rng=0, channel_axis=-1)
    viewed = Viewed.from_data(bits)
    assert recommend(viewed, 5).method == COLOR_NETWORK
    image = made(viewed, range(2, 7), COLOR_NETWORK)
    assert image.title == "network, color"
    np.testing.assert_array_equal(image.image, jl.reconstruct(bits[2:7]))
    known = jl.uncertainty(bits[2:7], estimate=image.image)
    np.testing.assert_array_equal(find_errors(image), known.standard_error)
    with pytest.raises(ValueError, match=r"method: a color network takes .* got other data"):
        made(viewed_of("plain"), range(2, 7), COLOR_NETWORK)


def test_the_color_network_alone_is_refused_for_many_trials_or_another_kernel():
    bits = jl.Sensor(frames=2000).expose(np.full((8, 8, 3), 0.5), rng=0, channel_axis=-1)
    message = "up to 1,000 trials .* alone, got 2,000; choose held-out"
    with pytest.raises(ValueError, match=message):
        made(Viewed.from_data(bits), range(2000), COLOR_NETWORK)
    smooth = bits.replace(sensor=bits.sensor.replace(kernel="linear"))
    with pytest.raises(ValueError, match="the kernel linear; name another method"):
        made(Viewed.from_data(smooth), range(4), COLOR_NETWORK)


@functools.cache
def mosaic_bits(motion):
    color = np.stack([PHOTO, PHOTO[::-1], PHOTO[:, ::-1]], axis=2)
    sensor = jl.Sensor(frames=48, mosaic="RGGB")
    scene = jl.datasets.moving(color, motion, sensor=sensor, photons=0.6, rng=4)
    return in_memory(scene)


def mosaic_viewed(motion="static"):
    return Viewed.from_data(mosaic_bits(motion))


@pytest.mark.slow
def test_a_mosaic_has_colors_by_every_method():
    viewed, span = mosaic_viewed(), range(40)
    assert viewed.shape == (48, 64)
    assert recommend(viewed, 40).method == COLOR_NETWORK
    bits = viewed.data[:40]
    image = made(viewed, span, COLOR_NETWORK)
    np.testing.assert_array_equal(image.image, jl.reconstruct(bits))
    planes = made(viewed, span, "mle")
    expected = jl.reconstruct(bits, method="mle", demosaicing="differences")
    np.testing.assert_array_equal(planes.image, expected)
    known = jl.uncertainty(bits)
    np.testing.assert_array_equal(find_errors(image), known.standard_error)
    known = jl.uncertainty(bits, method="mle", demosaicing="differences")
    np.testing.assert_array_equal(find_errors(planes), known.standard_error)
    assert display(planes, ViewState(), 1.0).levels.shape == (48, 64, 3)
    counts = made(viewed, span, "counts")
    assert display(counts, ViewState(), 1.0).levels.shape == (48, 64)
    assert find_saturated(image).shape == (48, 64)
    map_, note = JotMap(viewed).find()
    assert not map_.any()
    assert "not searched" in note
    names = [each["name"] for each in describe_capture(viewed)["methods"]]
    assert COLOR_NETWORK in names
    assert ["mosaic", "Mosaic('RGGB')"] in describe_capture(viewed)["sensor"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
def test_a_mosaic_is_aligned():
    span = range(48)
    assert merge_window(mosaic_viewed(), span, "mle")[0] is None
    viewed = mosaic_viewed("shake")
    merged, _ = merge_window(viewed, span, "mle")
    counts = RunningCounts(viewed).move(span)
    image = estimate(viewed, span, COLOR_NETWORK, counts, merged)
    assert image.title == "network, color"
    np.testing.assert_array_equal(image.image, jl.reconstruct(merged))


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")
def test_the_method_of_aligned_pixels_that_lack_a_color_is_stated():
    sensor = jl.Sensor(frames=4, mosaic="RGGB")
    bits = sensor.expose(np.full((16, 16, 3), 0.5), rng=0)
    trials = np.full((16, 16, 3), 4.0)
    trials[:8, :, 2] = 0
    gray = sensor.replace(mosaic=None)
    merged = jl.Merged(np.where(trials > 0, 2, 0), trials, gray, channel_axis=-1)
    image = estimate(Viewed.from_data(bits), range(4), COLOR_NETWORK, bits.counts(), merged)
    assert (image.method, image.title) == ("network-medium", "network, medium")
    known = jl.uncertainty(merged, method=image.method, estimate=image.image)
    np.testing.assert_array_equal(find_errors(image), known.standard_error)


def test_without_a_stated_range_the_largest_intensity_is_that_of_saturation():
    bits = jl.Sensor(frames=16).expose(3 * PHOTO, rng=0)
    viewed = Viewed("bits", bits, bits.sensor)
    image = made(viewed, range(16), "mle")
    assert image.image.max() > 1
    assert image.sensor.max_intensity == pytest.approx(np.log(32))


def test_a_network_for_darker_scenes_has_a_note():
    bits = jl.Sensor(frames=16).expose(3 * PHOTO, rng=0)
    viewed = Viewed("bits", bits, bits.sensor)
    with collected() as notes:
        image = made(viewed, range(16), "network-small")
    assert image.image.max() == 1
    assert notes == [
        "the scene reaches the largest intensity 1 of the network, so brighter pixels are "
        'clipped; quality="medium" (--quality medium) reaches 3.47, where the bits saturate'
    ]
    with collected() as notes:
        made(viewed, range(16), "network-medium")
    assert notes == []


@pytest.mark.parametrize("curve", CURVES)
def test_the_levels_are_those_that_the_library_saves(curve, tmp_path):
    viewed = viewed_of("plain")
    image = made(viewed, range(16), "mle")
    shown = display(image, ViewState(curve=curve), 0.7)
    tone = Tone.fit(jl.mle(viewed.data[:16]), curve, white=0.7)
    jl.save_image(tmp_path / "a.png", tone(jl.mle(viewed.data[:16])), white=1.0)
    np.testing.assert_array_equal(shown.levels, np.asarray(Image.open(tmp_path / "a.png")))
    axis = shown.tone["axis"]
    levels = display_levels(Tone(curve, 0.7, tone.middle)(np.array([axis])), 1.0, 255)
    np.testing.assert_allclose(levels[0], [0, 63.75, 127.5, 191.25, 255], atol=1)


def test_counts_are_as_bright_as_the_intensity_that_they_mean():
    viewed = viewed_of("plain")
    level = fraction_at(0.5, viewed.sensor(1))
    assert level == pytest.approx(1 - np.exp(-0.5 * 30 / 48))


def test_differences_are_gray_where_both_agree_and_colored_elsewhere():
    viewed = viewed_of("plain")
    one = made(viewed, range(16), "mle")
    other = made(viewed, range(16), "network-medium")
    same = display_difference(one, one, 1.0)
    assert (same.levels == 128).all()
    assert same.tone["rms"] == 0
    shown = display_difference(one, other, 1.0)
    brighter = one.image > other.image + 0.05
    assert (shown.levels[brighter, 0] > shown.levels[brighter, 2]).all()
    expected = np.sqrt(np.mean((one.image - other.image) ** 2))
    assert shown.tone["rms"] == pytest.approx(expected, rel=1e-5)


@pytest.mark.filterwarnings("ignore::jotlight.JotlightWarning")  # a dead pixel is inpainted
def test_dead_hot_and_saturated_jots_are_marked():
    scene = np.full((32, 32), 0.05, np.float32)
    scene[5, 7], scene[20, 3] = 3.0, 60.0
    mask = np.zeros((32, 32), bool)
    mask[9, 9] = True
    sensor = jl.Sensor(frames=400, gain=400.0, mask=mask, max_intensity=100.0)
    viewed = Viewed.from_data(sensor.expose(scene, rng=0))
    found, note = JotMap(viewed).find()
    assert found[9, 9] == DEAD
    assert {tuple(place) for place in np.argwhere(found == HOT)} == {(5, 7), (20, 3)}
    assert note.startswith("1 dead, 2 hot")
    image = made(viewed, range(400), "mle")
    assert np.argwhere(find_saturated(image)).tolist() == [[20, 3]]


@pytest.mark.parametrize("bit_depth", [1, 2])
def test_the_ones_of_dead_jots_neither_saturate_a_pixel_nor_count(bit_depth):
    mask = np.zeros((16, 16), bool)
    mask[4, 4] = True
    dark = np.where(mask, 50.0, 0.0)
    sensor = jl.Sensor(frames=40, oversampling=2, bit_depth=bit_depth, gain=200.0 * bit_depth)
    readings = sensor.replace(dark_counts=dark).expose(np.full((8, 8), 1.0), rng=0)
    masked = sensor.replace(mask=mask, max_intensity=9.0)
    data = jl.Bits(readings.packed, 16, masked) if bit_depth == 1 else None
    viewed = Viewed.from_data(data or jl.Readings(readings.frames, masked))
    image = made(viewed, range(40), "mle")
    jots = readings.to_array().sum(axis=0)[4:6, 4:6]
    assert jots[0, 0] == 40 * sensor.max_reading
    assert image.counts[2, 2] == jots.sum() - jots[0, 0]
    assert image.trials[2, 2] == 3 * 40 * sensor.max_reading
    assert jots.sum() >= image.trials[2, 2]  # as if the pixel were saturated
    assert not find_saturated(image).any()
    with pytest.raises(ValueError, match="also those of its dead jots; choose a method"):
        find_saturated(made(viewed, range(40), "counts"))


def test_errors_are_those_of_the_library():
    viewed = viewed_of("plain")
    image = made(viewed, range(48), "mle")
    levels, facts = error_levels(find_errors(image))
    known = jl.uncertainty(viewed.data, method="mle").standard_error
    assert facts["is_exceeded"] == (known > facts["largest"]).any()
    shown = known < facts["largest"]
    np.testing.assert_allclose(
        levels[shown] * facts["largest"] / 255, known[shown], atol=facts["largest"] / 255
    )


@pytest.mark.parametrize(("ending", "tolerance"), [("png", 0.6 / 65535), ("tif", 0), ("exr", 0)])
def test_saved_files_hold_what_is_shown(ending, tolerance, tmp_path):
    if ending == "exr":
        pytest.importorskip("OpenEXR")
    viewed = viewed_of("plain")
    state = ViewState(2, 10, "mle", curve="linear", white=0.8)
    path = tmp_path / f"a.{ending}"
    path.write_bytes(save_view(viewed, state, ending))
    expected = jl.mle(viewed.data[2:12])
    if ending == "png":
        image = Image.open(io.BytesIO(path.read_bytes()))
        assert image.mode.startswith("I")
        shown = np.clip(expected / 0.8, 0, 1)
        np.testing.assert_allclose(np.asarray(image) / 65535, shown, atol=tolerance)
    else:
        np.testing.assert_array_equal(jl.read_image(path), expected)


def test_saved_counts_are_as_bright_as_on_the_page():
    viewed, state = viewed_of("plain"), ViewState(0, 16, "counts")
    image = made(viewed, range(16), "counts")
    white = fit_white(viewed, range(16), image)
    assert white == fit_white(viewed, range(16), made(viewed, range(16), "mle"))
    shown = display(image, state, white).levels
    saved = np.asarray(Image.open(io.BytesIO(save_view(viewed, state, "png")))) / 257
    assert np.abs(saved - shown).max() <= 1


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_two_channels_are_saved_as_their_mean(ending):
    sensor = jl.Sensor(frames=8, max_intensity=4.0)
    bits = sensor.expose(np.stack([PHOTO, PHOTO / 2], axis=2), rng=0, channel_axis=-1)
    viewed, state = Viewed.from_data(bits), ViewState(0, 8, "mle", white=1.0, curve="linear")
    content = save_view(viewed, state, ending)
    expected = jl.mle(bits).mean(axis=2)
    if ending == "tif":
        np.testing.assert_allclose(tifffile.imread(io.BytesIO(content)), expected, rtol=1e-6)
    else:
        saved = np.asarray(Image.open(io.BytesIO(content))) / 65535
        np.testing.assert_allclose(saved, np.clip(expected, 0, 1), atol=1e-5)
