"""Maps of thresholds: motion, merged counts, and films of jots with different thresholds."""

import functools

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.metrics import psnr
from jotlight.motion.films.estimates import FilmEstimates
from jotlight.motion.films.film import film
from jotlight.motion.films.live_film import LiveFilm
from jotlight.motion.merging.threshold_maps import join_thresholds, sensors_of_thresholds
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.parameters.response import detection_probability

SIZE, FRAMES = (96, 112), 96


def checkerboard(low, high, size=SIZE):
    return np.where(np.indices(size).sum(axis=0) % 2, high, low)


@functools.cache
def scene_of(motion="shake", gain=3.0, oversampling=1, **options):
    """Return a moving scene and its bits, which are kept in memory."""
    size = tuple(oversampling * side for side in SIZE)
    sensor = jl.Sensor(
        frames=FRAMES,
        gain=gain * oversampling**2 * FRAMES,
        threshold=checkerboard(1, 3, size),
        oversampling=oversampling,
        **options,
    )
    photograph = jl.datasets.photograph("camera").astype(float)
    scene = jl.datasets.moving(photograph, motion, sensor=sensor, shape=SIZE, rng=1)
    return scene, jl.Bits(np.asarray(scene.bits.packed), scene.bits.width, scene.bits.sensor)


@functools.cache
def aligned(motion="shake", **options):
    """Return a scene, its bits, and their estimated motion."""
    scene, bits = scene_of(motion, **options)
    return scene, bits, jl.align(bits)


def quality(data, truth):
    inner = (slice(8, -8),) * 2
    return psnr(jl.reconstruct(data)[inner], truth[inner], data_range=1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("oversampling", "loss"), [(1, 1.0), (2, 3.5)])
def test_a_moving_scene_is_about_as_good_as_one_that_stands_still(oversampling, loss):
    """With an oversampling of 2, scenes with one threshold lose as much."""
    scene, bits, motion = aligned(oversampling=oversampling)
    pixels = motion.at(80)[:, ::oversampling, ::oversampling] / oversampling
    error = pixels - scene.motion(80, FRAMES // 2)
    assert np.sqrt((error**2).mean()) < 0.2
    truth, merged = scene.image(FRAMES // 2), jl.merge(bits, motion=motion)
    assert merged.shape == SIZE
    still = scene.sensor.expose(truth, rng=0)
    assert quality(merged, truth) > quality(still, truth) - loss
    assert quality(merged, truth) > quality(bits, truth) + 10
    assert merged.flags.mean() < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["rotate", "layers"])
@pytest.mark.parametrize("gain", [0.5, 6.0])
def test_other_motions_and_light_are_served(motion, gain):
    scene, bits = scene_of(motion, gain)
    truth = scene.image(FRAMES // 2)
    assert quality(jl.merge(bits), truth) > quality(bits, truth) + 3


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["shake", "static"])
def test_merging_alone_is_merging_along_what_align_returns(motion):
    _, bits, found = aligned(motion)
    merged, expected = jl.merge(bits), jl.merge(bits, motion=found)
    for name in ("ones", "trials", "flags"):
        np.testing.assert_array_equal(getattr(merged, name), getattr(expected, name))


@pytest.mark.slow
def test_merged_counts_of_a_still_scene_are_about_as_good_as_its_bits(recwarn):
    scene, bits = scene_of("static")
    merged, truth = jl.merge(bits), scene.image(0)
    assert not recwarn
    assert quality(merged, truth) > quality(bits, truth) - 0.8
    assert merged.flags.mean() < 0.1


@pytest.mark.parametrize("thresholds", [(1, 2), (1, 5), (2, 3, 7)])
@pytest.mark.parametrize("intensity", [0.02, 0.3, 0.9])
def test_joined_counts_have_no_bias_and_state_their_noise(thresholds, intensity):
    """The exact maximum of the likelihood of all counts is the oracle of the noise."""
    rng, size, trials = np.random.default_rng(0), (64, 64), 60
    dark, efficiency = rng.uniform(0, 0.05, size), rng.uniform(0.7, 1, size)
    places = np.arange(size[0] * size[1]).reshape(size) % len(thresholds)
    sensor = jl.Sensor(
        frames=trials * len(thresholds),
        gain=4.0 * trials * len(thresholds),
        threshold=np.array(thresholds)[places],
    )
    merged, information = [], 0.0
    for own in sensors_of_thresholds(sensor):
        rate = own.light_per_intensity * efficiency * intensity + dark
        p, step = detection_probability(own.threshold, rate), 1e-5
        slope = (detection_probability(own.threshold, rate + step) - p) / step
        slope *= own.light_per_intensity * efficiency
        information = information + trials * slope**2 / (p * (1 - p))
        merged.append(
            Merged(
                rng.binomial(trials, p).astype(np.int32),
                np.full(size, float(trials)),
                own,
                dark_counts=dark,
                efficiency=efficiency,
                flags=np.zeros(size, bool),
                acceptance=np.ones(size, np.float32),
                posterior_error=np.zeros(size, np.float32),
            )
        )
    joined = join_thresholds(merged, sensor)
    light = joined.sensor.light_per_intensity * joined.efficiency
    rate = light * intensity + joined.dark_counts
    p, step = detection_probability(joined.sensor.threshold, rate), 1e-5
    slope = light * (detection_probability(joined.sensor.threshold, rate + step) - p) / step
    excess = joined.ones - joined.trials * p
    # The counts are linear in the bits near the true intensity, so their sum has a normal error.
    expected = joined.trials * slope**2 / (p * (1 - p))
    gradient = excess * slope / (p * (1 - p))
    error = gradient.sum() / expected.sum()
    assert abs(error) < 4 / np.sqrt(information.sum()) + 0.01 * intensity
    assert expected.mean() == pytest.approx(information.mean(), rel=0.1)
    assert not joined.flags.any()
    photons = jl.reconstruct(joined, method="mle", units="photons").mean()
    assert photons == pytest.approx(sensor.gain / sensor.frames * jl.mle(joined).mean())


def test_saturated_pixels_have_no_part_of_a_zero():
    size = 16, 24
    sensor = jl.Sensor(frames=8, threshold=checkerboard(4, 5, size), max_intensity=40.0)
    none = np.zeros(size, np.float32)
    ones, others = np.full(size, 8, np.int32), {"acceptance": none + 1, "posterior_error": none}
    merged = [
        Merged(ones, ones.astype(float), own, flags=none > 0, **others)
        for own in (jl.Sensor(frames=8, threshold=each, max_intensity=40.0) for each in (4, 5))
    ]
    joined = join_thresholds(merged, sensor)
    np.testing.assert_array_equal(joined.ones, joined.trials)


def test_each_jot_is_in_the_sensor_of_its_threshold():
    thresholds = np.random.default_rng(0).choice([1, 2, 5], size=(8, 9))
    mask = np.zeros((8, 9), bool)
    mask[2, 3] = True
    sensor = jl.Sensor(frames=4, gain=8.0, threshold=thresholds, mask=mask)
    live = np.zeros((8, 9), int)
    for own in sensors_of_thresholds(sensor):
        assert own.gain == sensor.gain
        live += own.threshold * ~own.mask
    np.testing.assert_array_equal(live, np.where(mask, 0, thresholds))


@pytest.mark.slow
@pytest.mark.parametrize("causal", [pytest.param(False, marks=pytest.mark.exhaustive), True])
def test_films_and_live_films_are_about_as_good_as_merging(causal):
    scene, bits = scene_of()
    images = list(film(bits, window=64, step=16, causal=causal))
    assert images[-1].is_carried
    for image in images:
        truth = scene.image(image.time)
        fresh = jl.merge(bits[image.start : image.start + 64], at=image.time - image.start)
        assert quality(image.data, truth) > quality(fresh, truth) - 0.5
    if causal:
        live = LiveFilm(bits.sensor, window=64, step=16)
        found = [each for start in range(0, 96, 11) for each in live.add(bits[start : start + 11])]
        for one, other in zip(found, images, strict=True):
            np.testing.assert_array_equal(one.merged.ones, other.merged.ones)


def test_a_film_of_a_still_scene_shows_its_bits_and_has_no_film_network():
    _, bits = scene_of("static")
    (image,) = film(bits[:48], window=48)
    np.testing.assert_array_equal(np.asarray(image.data.packed), np.asarray(bits.packed[:48]))
    with pytest.raises(ValueError, match="expected gray counts on the grid of the sensor"):
        FilmEstimates().add(image)


@pytest.mark.slow
def test_stacks_of_counts_have_the_motion_of_their_bits():
    scene, bits = scene_of()
    pairs = bits.to_array().reshape(FRAMES // 2, 2, *SIZE).sum(axis=1).astype(np.uint8)
    stack = CountStack(pairs, Provenance("npy", "a.npy"), 2)
    merged, truth = jl.merge(stack, bits.sensor), scene.image(FRAMES // 2 + 0.5)
    assert quality(merged, truth) > quality(jl.merge(bits, at=FRAMES // 2 + 0.5), truth) - 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"gain": np.tile([1.0, 3.0], FRAMES // 2)},
            "a map or exposures that repeat, but not both",
        ),
        ({"read_noise": 0.2}, "without noise, got single bits with read noise 0.2"),
        ({"mosaic": "RGGB"}, "got a threshold for each jot"),
    ],
)
def test_other_readings_with_a_map_are_refused(options, message):
    sensor = jl.Sensor(frames=FRAMES, threshold=checkerboard(1, 2), **options)
    bits = jl.Bits.from_array(np.zeros((FRAMES, *SIZE), bool), sensor=sensor)
    for call in (jl.align, jl.merge, functools.partial(film, window=32)):
        with pytest.raises(ValueError, match=message):
            call(bits)


def test_a_finer_grid_is_refused():
    _, bits = scene_of()
    with pytest.raises(ValueError, match="expected 1 for a sensor with a map of thresholds, got 2"):
        jl.merge(bits, upsample=2)
