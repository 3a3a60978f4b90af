"""Films that remember bits from before their windows."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.motion.agreement import consistency
from jotlight.motion.films import memory as memory_module
from jotlight.motion.films.candidates import Candidate
from jotlight.motion.films.film import film
from jotlight.motion.films.live_film import LiveFilm
from moving import in_memory

FADING = np.exp(-8 / (2.5 * 32))
"""For 8 frames and a window of 32."""


def recorded(motion, frames, photons=0.5, shape=(96, 96), **options):
    scene = jl.datasets.moving(
        jl.datasets.photograph("camera"),
        motion,
        sensor=jl.Sensor(frames=frames, **options),
        shape=shape,
        photons=photons,
        rng=1,
    )
    return scene, in_memory(scene)


def test_the_counts_of_a_still_scene_are_those_of_all_frames_with_fading(monkeypatch):
    # All bits agree, in the windows and in the memory.
    monkeypatch.setattr(memory_module, "_MAX_IF_STILL", np.inf)
    monkeypatch.setattr(consistency, "_LIMITS_IF_STILL", (np.inf, np.inf))
    _, bits = recorded("static", 96, shape=(48, 48))
    frames = bits.to_array()
    expected = np.zeros((2, 48, 48))
    for number, image in enumerate(film(bits, window=32, step=8, causal=True, model="none")):
        start = 8 * number
        window = np.stack([frames[start : start + 32].sum(axis=0), np.full((48, 48), 32)])
        ones, trials = window + expected
        assert np.abs(image.merged.ones - ones).max() <= 0.51
        known = image.merged.ones > 0
        found = image.merged.ones / image.merged.trials
        np.testing.assert_allclose(found[known], (ones / trials)[known], rtol=1e-4)
        leaving = np.stack([frames[start : start + 8].sum(axis=0), np.full((48, 48), 8)])
        expected = FADING * (expected + leaving)


@pytest.mark.slow
def test_a_rejected_image_is_not_remembered_twice(monkeypatch):
    _, bits = recorded("static", 56, shape=(64, 64))
    expected = [image.merged for image in film(bits, window=32, step=8, causal=True)]
    # Carried images are lost, so all are aligned afresh.
    for name, of_carried, of_fresh in (("agreeing", 0.5, 1.0), ("flagged", 0.2, 0.1)):
        shown = property(
            lambda self, a=of_carried, b=of_fresh: a if self.image.is_carried else b,
            lambda self, value: None,
        )
        monkeypatch.setattr(Candidate, name, shown, raising=False)
    found = list(film(bits, window=32, step=8, causal=True))
    assert not any(image.is_carried for image in found[1:])
    for image, other in zip(found, expected, strict=True):
        assert np.abs(image.merged.trials - other.trials).mean() < 3


@pytest.mark.slow
def test_memory_improves_the_images_of_a_shaking_camera():
    scene, bits = recorded("shake", 160)
    inner = (slice(12, -12),) * 2

    def quality(memory):
        images = list(film(bits, window=64, step=16, causal=True, memory=memory))
        truth = scene.image(16 * (len(images) - 1) + 63)[inner]
        found = jl.pretrained(bits.sensor).reconstruct(images[-1].merged)[inner]
        return jl.metrics.psnr(found, truth, data_range=1.0)

    assert quality(True) > quality(False) + 0.4


@pytest.mark.slow
def test_live_films_have_the_same_memory():
    _, bits = recorded("shake", 56, shape=(64, 64))
    live = LiveFilm(bits.sensor, window=32, step=8, model="affine")
    images = [image for start in range(0, 56, 8) for image in live.add(bits[start : start + 8])]
    others = list(film(bits, window=32, step=8, causal=True, model="affine"))
    assert max(image.merged.trials.max() for image in others) > 33
    for image, other in zip(images, others, strict=True):
        np.testing.assert_array_equal(image.merged.ones, other.merged.ones)
        np.testing.assert_array_equal(image.merged.trials, other.merged.trials)


@pytest.mark.slow
def test_color_channels_are_remembered_side_by_side():
    photograph = jl.datasets.photograph("astronaut")[::4, ::4]
    scene = jl.datasets.moving(
        photograph, "static", sensor=jl.Sensor(frames=48), shape=(64, 64), photons=0.5, rng=1
    )
    images = list(film(in_memory(scene), window=32, step=8, causal=True, model="none"))
    trials = images[-1].merged.trials
    assert trials.shape == (64, 64, 3)
    assert np.median(trials) > 40
    expected = 1 - np.exp(-scene.sensor.light_per_intensity * scene.image())
    found = images[-1].merged.ones.sum((0, 1)) / trials.sum((0, 1))
    np.testing.assert_allclose(found, expected.mean((0, 1)), atol=0.02)


@pytest.mark.slow
def test_only_causal_films_remember_by_default_and_none_on_a_finer_grid():
    _, bits = recorded("static", 48)
    later = list(film(bits, window=32, step=8))
    assert max(image.merged.trials.max() for image in later) <= 32
    fine = list(film(bits, window=32, step=16, causal=True, upsample=2))
    assert fine[-1].merged.upsample == 2
    with pytest.raises(ValueError, match="memory: expected False with upsample=2, got True"):
        film(bits, window=32, step=8, memory=True, upsample=2)


def quality(image, scene):
    """Return the PSNR of the last image."""
    found = jl.pretrained(image.merged.sensor).reconstruct(image.merged)
    truth = scene.image(scene.sensor.frames - 1)
    inner = (slice(12, -12),) * 2
    return jl.metrics.psnr(found[inner], truth[inner], data_range=1.0)


def jots(kind):
    rng = np.random.default_rng(0)
    hot = np.where(rng.random((96, 96)) < 0.01, 2.0, 0.001)
    return {
        "efficiency": {"efficiency": np.linspace(0.6, 1, 96 * 96).reshape(96, 96)},
        "hot": {"dark_counts": hot},
        "dark": {"dark_counts": rng.gamma(2, 0.02, (96, 96))},
        "dead": {"mask": rng.random((96, 96)) < 0.01},
    }[kind]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*no valid bit")
@pytest.mark.parametrize(
    ("kind", "motion", "frames"),
    [
        ("hot", "static", 64),
        *(
            (*case, 96)
            for case in (
                ("hot", "static"),
                ("efficiency", "shake"),
                ("dark", "static"),
                ("dead", "shake"),
            )
        ),
        *(
            pytest.param(*case, 96, marks=pytest.mark.exhaustive)
            for case in (
                ("efficiency", "static"),
                ("hot", "shake"),
                ("dark", "shake"),
                ("dead", "static"),
            )
        ),
    ],
)
def test_sensors_whose_jots_differ_are_remembered(kind, motion, frames):
    scene, bits = recorded(motion, frames, **jots(kind))
    spans = {"window": 32, "step": 8, "causal": True}
    last = list(film(bits, **spans))[-1]
    without = list(film(bits, **spans, memory=False))[-1]
    assert np.median(last.merged.trials) > 40
    assert quality(last, scene) > quality(without, scene) - 0.05


@pytest.mark.slow
def test_windows_that_do_not_overlap_remember_nothing():
    _, bits = recorded("static", 48)
    for step in (16, 20):
        images = list(film(bits, window=16, step=step, causal=True, model="none"))
        assert max(image.merged.trials.max() for image in images) <= 16


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.9, pytest.param(1.1, marks=pytest.mark.slow)])
def test_a_change_of_brightness_ends_the_memory(factor):
    scene, bright = recorded("static", 64)
    sensor = bright.sensor.replace(gain=factor * bright.sensor.gain)
    other = sensor.replace(frames=32).expose(scene.image(), rng=3, threads=1)
    packed = np.concatenate([np.asarray(bright.packed), np.asarray(other.packed)])
    bits = jl.Bits(packed, 96, sensor.replace(frames=96))
    images = list(film(bits, window=32, step=8, causal=True, model="none"))
    assert np.median(images[4].merged.trials) > 40  # frames 32 to 63
    rate = [image.merged.ones.sum() / image.merged.trials.sum() for image in images]
    after = np.unpackbits(np.asarray(other.packed), axis=2, count=96).mean()
    assert abs(rate[8] / after - 1) < 0.01  # frames 64 to 95


@pytest.mark.slow
def test_counts_and_pixels_of_several_jots_are_remembered():
    _, bits = recorded("static", 64, oversampling=2)
    last = list(film(bits, window=32, step=8, causal=True, model="none"))[-1]
    assert last.merged.shape == (96, 96)
    assert 150 < np.median(last.merged.trials) < 3.5 * 128
