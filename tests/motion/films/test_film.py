"""Films: the motion that is carried from window to window, against a fresh alignment of each."""

import dataclasses
import itertools

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.motion.agreement.consistency import find_consistent
from jotlight.motion.align import as_motion
from jotlight.motion.films.carrying import carry
from jotlight.motion.films.film import film
from jotlight.motion.merge import as_paths
from jotlight.sensing.parameters.provenance import Provenance
from moving import blocks_of

PHOTO = jl.datasets.photograph("camera")


def moving(motion, frames=128, shape=(96, 96), photons=0.5, rng=1):
    scene = jl.datasets.moving(
        PHOTO, motion, sensor=jl.Sensor(frames=frames), shape=shape, photons=photons, rng=rng
    )
    return scene, jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)


def quality(merged, truth):
    inner = (slice(12, -12),) * 2
    estimate = jl.pretrained(merged.sensor).reconstruct(merged)
    return jl.metrics.psnr(estimate[inner], truth[inner], data_range=1.0)


@pytest.mark.parametrize(
    ("motion", "window", "step"),
    [
        pytest.param("shake", 64, 16, marks=[pytest.mark.slow, pytest.mark.exhaustive]),
        pytest.param("shake", 60, 7, marks=pytest.mark.slow),
        pytest.param("rotate", 64, 16, marks=pytest.mark.slow),
        pytest.param("layers", 64, 16, marks=[pytest.mark.slow, pytest.mark.exhaustive]),
    ],
)
def test_each_image_is_as_good_as_with_a_fresh_alignment(motion, window, step):
    scene, bits = moving(motion)
    images = list(film(bits, window=window, step=step))
    assert not images[0].is_carried
    assert motion == "layers" or all(image.is_carried for image in images[1:])
    for index, image in itertools.islice(enumerate(images), 0, None, 2):
        start = index * step
        part = bits[start : start + window]
        truth = scene.image(start + window // 2)
        fresh = quality(jl.merge(part, part.sensor), truth)
        assert quality(image.merged, truth) > fresh - 0.4
        assert image.merged.sensor == part.sensor


def test_a_static_scene_stays_static():
    _, bits = moving("static")
    images = list(film(bits, window=64, step=16))
    assert len(images) == (len(bits) - 64) // 16 + 1
    for index, image in enumerate(images):
        assert image.motion.model == "none"
        assert abs(image.motion.nodes).max() == 0
        assert image.merged.acceptance.mean() > 0.98
        whole = image.merged.trials == 64
        counts = bits[16 * index : 16 * index + 64].counts()
        np.testing.assert_array_equal(image.merged.ones[whole], counts[whole])


@pytest.mark.filterwarnings("ignore:the motion does not explain the scene")
@pytest.mark.slow
def test_a_scene_that_begins_to_move_is_aligned_afresh():
    _, still = moving("static", 96)
    scene, bits = moving("shake", 96)
    sensor = scene.sensor.replace(frames=192)
    both = jl.Bits(np.concatenate([still.packed, bits.packed]), bits.width, sensor)
    images = list(film(both, window=48, step=12))
    assert [image.motion.model for image in images[:5]] == ["none"] * 5
    assert images[-1].motion.model != "none"
    truth = scene.image(72)
    fresh = quality(jl.merge(bits[48:], scene.sensor.replace(frames=48)), truth)
    assert quality(images[-1].merged, truth) > fresh - 0.3


@pytest.mark.filterwarnings("ignore:the motion does not explain the scene")
@pytest.mark.filterwarnings("ignore:the frames differ although the motion is none")
@pytest.mark.slow
def test_another_scene_is_aligned_afresh():
    _, first = moving("shake", 64, (64, 64))
    second = jl.datasets.moving(
        PHOTO[200:], "shake", sensor=jl.Sensor(frames=64), shape=(64, 64), photons=0.5, rng=5
    )
    packed = np.concatenate([first.packed, np.asarray(second.bits.packed)])
    images = list(film(jl.Bits(packed, first.width), window=32, step=16))
    assert not all(image.is_carried for image in images[1:])
    assert images[-1].merged.acceptance.mean() > 0.9


@pytest.mark.slow
def test_windows_that_share_few_frames_are_aligned_afresh():
    _, bits = moving("shake", 96)
    for window, step in ((32, 10), (32, None)):
        images = list(film(bits, window=window, step=step))
        assert not any(image.is_carried for image in images)
    last = jl.align(bits[64:96])
    np.testing.assert_array_equal(images[-1].motion.nodes, last.nodes)
    # The templates of films come from a smaller network than those of single images.
    paths = as_paths(last, blocks_of(bits[64:96]))
    expected = find_consistent(paths).total
    np.testing.assert_array_equal(images[-1].merged.ones, expected.ones)
    np.testing.assert_array_equal(images[-1].merged.trials, expected.trials)


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["shake", "rotate"])
def test_a_causal_film_shows_the_last_frame_of_each_window(motion):
    scene, bits = moving(motion)
    images = list(film(bits, window=64, step=16, causal=True))
    others = list(film(bits, window=64, step=16))
    assert [image.motion.reference for image in images] == [63.0] * len(images)
    # The middle of a window is about the end of the second window before it.
    for index, image in enumerate(images[:-2]):
        truth = scene.image(16 * index + 63)
        assert quality(image.merged, truth) > quality(others[index + 2].merged, truth) - 1.5


@pytest.mark.slow
# Frames of noise have no motion, so the one that is found there may be wrong.
@pytest.mark.filterwarnings("ignore:the motion does not explain the scene")
@pytest.mark.filterwarnings("ignore:the motion that was found is wrong")
def test_a_causal_film_does_not_depend_on_later_frames():
    _, bits = moving("shake", 128, (48, 48))
    rng = np.random.default_rng(0)
    other = np.array(bits.packed)
    other[80:] = rng.integers(0, 256, other[80:].shape, dtype=np.uint8)
    pairs = zip(
        *(film(jl.Bits(each, 48), window=32, step=8, causal=True) for each in (bits.packed, other)),
        strict=True,
    )
    for index, (one, two) in enumerate(pairs):
        if 8 * index + 32 > 80:
            break
        np.testing.assert_array_equal(one.merged.ones, two.merged.ones)
        np.testing.assert_array_equal(one.motion.nodes, two.motion.nodes)


@pytest.mark.slow
def test_a_film_on_a_finer_grid_has_the_same_motion():
    _, bits = moving("shake", 48, (48, 48))
    films = [list(film(bits, window=32, step=8, upsample=factor)) for factor in (1, 2)]
    assert len(films[0]) == 3
    for coarse, fine in zip(*films, strict=True):
        assert fine.merged.shape == (96, 96)
        np.testing.assert_array_equal(fine.motion.nodes, coarse.motion.nodes)
        inner = slice(10, -10), slice(10, -10)
        squares = fine.merged.trials.reshape(48, 2, 48, 2).sum(axis=(1, 3))
        difference = squares[inner].mean() - coarse.merged.trials[inner].mean()
        assert abs(difference) < 0.5


@pytest.mark.slow
def test_counts_are_filmed_as_bits_are():
    _, bits = moving("shake", 96)
    stack = CountStack(bits.to_array().astype(np.uint8), Provenance("npy", "a.npy"), trials=1)
    pairs = zip(film(bits, window=48, step=12), film(stack, window=48, step=12), strict=True)
    for of_bits, of_counts in pairs:
        np.testing.assert_array_equal(of_bits.merged.ones, of_counts.merged.ones)
    several = CountStack(
        bits.to_array().reshape(48, 2, 96, 96).sum(axis=1), Provenance("npy", "a.npy"), trials=2
    )
    image = next(film(several, window=24, step=6))
    assert image.merged.sensor.frames == 48
    assert image.merged.trials.max() == 48


@pytest.mark.filterwarnings("ignore:the motion does not explain the scene")
@pytest.mark.slow
def test_color_is_filmed():
    _, bits = moving("shake", 64, (48, 48))
    colors = jl.Bits.from_array(np.stack([bits.to_array()] * 2, axis=3))
    images = list(film(colors, window=32, step=8))
    assert images[-1].merged.shape == (48, 48, 2)
    np.testing.assert_array_equal(images[-1].merged.ones[..., 0], images[-1].merged.ones[..., 1])


@pytest.mark.slow
def test_a_single_channel_keeps_its_axis():
    _, bits = moving("shake", 48, (48, 48))
    channel = jl.Bits.from_array(bits.to_array()[..., None])
    gray, images = (list(film(each, window=32, step=16)) for each in (bits, channel))
    assert images[-1].data.shape == (48, 48, 1)
    np.testing.assert_array_equal(images[-1].merged.ones[..., 0], gray[-1].merged.ones)


@pytest.mark.slow
def test_a_motion_that_folds_the_image_is_not_carried():
    _, bits = moving("shake", 64)
    motion = jl.align(bits[:32])
    nodes = np.random.default_rng(1).normal(0, 1e4, motion.nodes.shape).astype(np.float32)
    folded = dataclasses.replace(motion, nodes=nodes)
    with pytest.raises(ValueError, match="nodes: expected displacements"):
        folded.seen_from(24)
    assert carry(folded, bits[8:40], bits[8:40].sensor, 8) is None


@pytest.mark.slow
def test_the_carried_motion_shows_the_middle_of_its_window():
    scene, bits = moving("shake")
    before = jl.align(bits[:64])
    motion = as_motion(carry(before, bits[16:80], jl.Sensor(frames=64), 16), "affine")
    assert motion.reference == 32
    np.testing.assert_allclose(motion.at(32), 0, atol=0.3)
    # The exact motion from frame 48 of the scene to frame 70.
    exact = scene.motion(70) - scene.motion(48)
    inner = (slice(None), slice(30, 66), slice(30, 66))
    assert abs(motion.at(70 - 16) - exact)[inner].mean() < 0.5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 33}, "window: expected 1 to the capture's 32 frames"),
        ({"window": 0, "step": 1}, "window: expected 1 to"),
        ({"window": 16, "step": 0}, "step: expected 1 frame or more"),
        ({"window": 16, "upsample": 3}, "upsample: expected"),
        ({"window": 16, "model": "rigid"}, "model: expected one of auto"),
        ({"window": 16, "sensor": jl.Sensor(frames=16)}, "expected the sensor's 16 frames, got 32"),
    ],
)
def test_bad_input_is_refused_before_the_first_image(options, message):
    bits = jl.Bits.from_array(np.zeros((32, 16, 16), bool))
    with pytest.raises(ValueError, match=message):
        film(bits, **options)


def test_data_of_another_type_are_refused():
    with pytest.raises(TypeError, match="Bits"):
        film(np.zeros((32, 16, 16)), window=16)
