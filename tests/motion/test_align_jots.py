"""Alignment with sensors whose jots differ: their pattern stands still, and the scene moves."""

import numpy as np
import pytest

import jotlight as jl
from moving import record, rms_error

SIZE = 96, 112
FRAMES = 64
PHOTONS = 0.2


def pattern(name):
    """Return the maps of a sensor. Dark counts are twice the light."""
    rng = np.random.default_rng(5)
    dark = 2 * PHOTONS * rng.gamma(1, 1, SIZE)
    fixed = np.clip(rng.normal(0.6, 0.3, SIZE), 0.1, 1)
    hot = np.where(rng.random(SIZE) < 0.01, 1.5, 0)
    return {
        "dark counts": {"dark_counts": dark},
        "efficiency": {"efficiency": fixed},
        "all": {"dark_counts": dark + hot, "efficiency": fixed},
    }[name]


def recorded(name, motion="shake", rng=0):
    """Return a scene and its bits, recorded by a sensor with maps."""
    scene = jl.datasets.moving(
        motion=motion,
        sensor=jl.Sensor(frames=FRAMES, **pattern(name)),
        shape=SIZE,
        photons=PHOTONS,
        rng=rng,
    )
    return scene, jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "ratio"), [("dark counts", 1), ("all", 10)])
def test_a_pattern_of_the_jots_does_not_hold_the_motion(name, ratio):
    scene, bits = recorded(name)
    known, unaware = jl.align(bits), jl.align(bits, bits.sensor.without_maps())
    assert rms_error(known, scene) < 0.3
    assert rms_error(unaware, scene) > ratio * rms_error(known, scene)


@pytest.mark.slow
def test_a_pattern_of_the_jots_is_not_taken_for_motion():
    _, bits = recorded("all", "static")
    assert jl.align(bits).model == "none"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dark counts", "efficiency"])
def test_the_merged_image_is_nearly_that_of_equal_jots(name):
    scene, bits = recorded(name)
    image = jl.pretrained(scene.sensor).reconstruct(jl.merge(bits))
    equal, of_equal = record(
        "shake",
        frames=FRAMES,
        shape=SIZE,
        photons=PHOTONS,
        **{key: float(np.mean(value)) for key, value in pattern(name).items()},
    )
    other = jl.pretrained(equal.sensor).reconstruct(jl.merge(of_equal))
    inner = np.s_[8:-8, 8:-8]
    psnr, of_others = (
        jl.metrics.psnr(each[inner], scene.image()[inner]) for each in (image, other)
    )
    assert psnr > of_others - 1


@pytest.mark.slow
def test_hot_jots_are_left_out_of_scenes_that_move():
    dark = np.zeros(SIZE)
    dark[::9, ::9] = 1.5
    sensor = jl.Sensor(frames=FRAMES, dark_counts=dark)
    for motion, is_counted in [("shake", False), ("static", True)]:
        scene = jl.datasets.moving(motion=motion, sensor=sensor, shape=SIZE, photons=PHOTONS, rng=0)
        bits = jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.sensor)
        merged = jl.merge(bits)
        assert (np.max(merged.dark_counts) > 1) == is_counted
        assert (merged.trials.max() == FRAMES) or not is_counted


@pytest.mark.slow
def test_films_account_for_the_jots():
    from jotlight.motion.films.film import film

    scene, bits = recorded("all")
    parts = list(film(bits, window=48, step=8))
    assert [part.is_carried for part in parts] == [False, True, True]
    for number, part in enumerate(parts):
        start = 8 * number
        seen_from = scene.motion(start + 24)
        errors = [
            part.motion.at(time) - (scene.motion(start + time) - seen_from) for time in range(48)
        ]
        assert np.sqrt(np.mean(np.square(errors))) < 1
