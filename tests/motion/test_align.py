"""Alignment of moving scenes, against their exact motion."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.formats.capture import CountStack
from jotlight.sensing.parameters.provenance import Provenance
from moving import aligned, in_memory, moved, photographed, record, rms_error

PROVENANCE = Provenance("npy", "counts.npy")


def assert_same(one, other):
    for name in ("nodes", "labels", "times", "information"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert (one.reference, one.model) == (other.reference, other.model)


LIMITS = {"shake": 0.25, "rotate": 0.35, "fast": 0.35, "spin": 0.45, "flicker": 0.35}


@pytest.mark.parametrize(
    "motion",
    ["shake"]
    + [
        pytest.param(name, marks=pytest.mark.slow) for name in ("rotate", "fast", "spin", "flicker")
    ],
)
def test_the_motion_of_the_camera_is_found(motion):
    # One in twenty scenes of this size has another model.
    scene, _, found = aligned(motion, rng=1)
    assert found.model == "affine"
    assert rms_error(found, scene) < LIMITS[motion]


@pytest.mark.slow
@pytest.mark.parametrize("photons", [0.05, pytest.param(0.3, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("motion", LIMITS)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.exhaustive)])
def test_the_motion_of_the_camera_is_found_in_larger_scenes(motion, photons, seed):
    options = {"frames": 96, "shape": (160, 144), "photons": photons, "rng": seed}
    scene, _, found = aligned(motion, **options)
    assert rms_error(found, scene) < LIMITS[motion] * (1 if photons > 0.1 else 2)


@pytest.mark.slow
def test_an_object_in_front_of_its_background_is_found():
    options = {"frames": 128, "shape": (192, 208), "photons": 0.5}
    scene, _, found = aligned("layers", **options)
    assert found.model in ("segments", "tiles")
    errors = np.concatenate(
        [
            np.hypot(*(found.at(time) - scene.motion(time)))[scene.visible(time)]
            for time in range(0, 128, 8)
        ]
    )
    # Pixels at the outline may follow the wrong motion.
    assert np.median(errors) < 0.5
    assert (errors > 3).mean() < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, pytest.param(3, marks=pytest.mark.exhaustive)])
def test_three_objects_are_found_although_they_cover_much_of_the_scene(seed):
    scene = photographed("three", 192, sensor=jl.Sensor(frames=64), photons=0.2, rng=seed)
    bits = in_memory(scene)
    found = jl.align(bits)
    assert found.model == "segments"
    # 28.3 and 28.8 dB along tiles, which explain the scene if objects are not searched.
    image = jl.reconstruct(jl.merge(bits, motion=found))
    truth = scene.image(found.reference)
    assert jl.metrics.psnr(image, truth, data_range=1.0) > 29.0


@pytest.mark.parametrize("photons", [0.03, pytest.param(0.5, marks=pytest.mark.slow)])
def test_a_scene_that_stands_still_has_no_motion(photons):
    _, _, found = aligned("static", photons=photons)
    assert found.model == "none"
    assert (found.nodes == 0).all()
    assert (found.at(11.5) == 0).all()


@pytest.mark.parametrize(
    "frames",
    [17, pytest.param(16, marks=pytest.mark.slow), pytest.param(64, marks=pytest.mark.slow)],
)
def test_few_frames_are_aligned(frames):
    scene, bits = moved(np.outer(np.arange(frames) - 8, (0.6, -0.4)), shape=(96, 96), photons=0.5,
                        rng=0)  # fmt: skip
    found = jl.align(bits)
    assert found.reference == frames // 2
    assert rms_error(found, scene, 1) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("at", [0, 12, 30.5])
def test_the_reference_time_may_be_any(at):
    scene, bits, _ = aligned("shake")
    found = jl.align(bits, at=at)
    assert found.reference == at
    np.testing.assert_allclose(found.at(at), 0, atol=1e-3)
    assert rms_error(found, scene) < 0.35
    assert_same(found, aligned("shake")[2].seen_from(at))


@pytest.mark.slow
def test_a_requested_model_is_used():
    _, bits, found = aligned("shake")
    assert jl.align(bits, model="none").model == "none"
    affine = jl.align(bits, model="affine")
    assert affine.model == "affine"
    np.testing.assert_allclose(affine.nodes, found.nodes, atol=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["segments", "tiles"])
def test_models_with_more_freedom_find_the_motion_of_the_camera_too(model):
    scene, bits, _ = aligned("shake")
    assert rms_error(jl.align(bits, model=model), scene) < 0.6


@pytest.mark.parametrize(
    ("motion", "shape"),
    [
        ("shake", (64, 64)),
        pytest.param("shake", (96, 96), marks=pytest.mark.slow),
        pytest.param("layers", (64, 64), marks=pytest.mark.slow),
        pytest.param("layers", (96, 96), marks=[pytest.mark.slow, pytest.mark.exhaustive]),
    ],
)
def test_any_number_of_threads_gives_the_same_motion_and_sums(motion, shape):
    _, bits = record(motion, shape=shape)
    one, *others = (jl.align(bits, threads=threads) for threads in (1, 3))
    for other in others:
        assert_same(one, other)
    one, *others = (jl.merge(bits, motion=one, threads=threads) for threads in (1, 3))
    for other in others:
        for name in ("ones", "trials", "acceptance", "posterior_error"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["shake", "rotate", "fast"])
def test_reversed_time_mirrors_the_motion(motion):
    """The same bits in reversed order have the mirrored motion.

    The velocity from which the alignment starts compares frames before with frames after the
    reference time, whose noise differs. Blocks are also aligned one after another. So the results
    are different estimates from the same bits: they differ by less than their errors. In rare
    scenes, they even have different models.
    """
    scene, bits = record(motion, frames=48, rng=1)
    reverse = jl.Bits(np.asarray(bits.packed)[::-1].copy(), bits.width, bits.sensor)
    at = 20
    forward, backward = jl.align(bits, at=at), jl.align(reverse, at=47 - at)
    assert forward.model == backward.model
    np.testing.assert_allclose(backward.times, 47 - forward.times[::-1])
    differences, errors = [], []
    for time in range(0, 48, 5):
        visible = scene.visible(time, at=at)
        mirrored = backward.at(47 - time)
        differences.append((forward.at(time) - mirrored)[:, visible].ravel())
        errors.append((forward.at(time) - scene.motion(time, at=at))[:, visible].ravel())
        errors.append((mirrored - scene.motion(time, at=at))[:, visible].ravel())
    difference, error = (
        np.sqrt(np.mean(np.concatenate(each) ** 2)) for each in (differences, errors)
    )
    assert difference < error
    assert difference < 0.3
    # Each block agrees within its posterior standard deviation, which is that of one estimate.
    rows, mixed, columns = np.moveaxis(forward.information.astype(float), 2, 0)
    deviations = np.sqrt(
        np.stack([columns, rows], axis=2) / (rows * columns - mixed**2)[:, :, None]
    )
    apart = abs(forward.nodes - backward.nodes[:, ::-1]) / deviations
    assert (apart < 3).mean() > 0.99


@pytest.mark.slow
def test_reversed_static_scenes_stand_still():
    _, bits, _ = aligned("static")
    reverse = jl.Bits(np.asarray(bits.packed)[::-1].copy(), bits.width, bits.sensor)
    assert_same(jl.align(reverse, at=23), jl.align(bits, at=23))


@pytest.mark.slow
def test_counts_of_one_reading_are_bits():
    _, bits, found = aligned("shake", shape=(64, 64))
    stack = CountStack(bits.to_array().astype(np.uint8), PROVENANCE, 1)
    assert_same(jl.align(stack), found)
    merged, expected = jl.merge(stack, motion=found), jl.merge(bits, motion=found)
    np.testing.assert_array_equal(merged.ones, expected.ones)
    np.testing.assert_array_equal(merged.trials, expected.trials)


@pytest.mark.filterwarnings("ignore:the motion does not explain the scene")
@pytest.mark.slow
@pytest.mark.parametrize(("frames", "size", "limit"), [(20, 64, 2), (48, 96, 0.3)])
def test_colors_have_the_motion_of_the_counts_of_their_channels(frames, size, limit):
    photo = np.stack([jl.datasets.photograph()] * 3, axis=2) * np.float32([1, 0.8, 0.6])
    scene = jl.datasets.moving(
        photo, sensor=jl.Sensor(frames=frames), shape=(size, size), photons=0.2, rng=0
    )
    bits = in_memory(scene)
    found = jl.align(bits)
    assert rms_error(found, scene) < limit
    stack = CountStack(bits.to_array().sum(axis=3, dtype=np.uint8), PROVENANCE, 3)
    assert_same(jl.align(stack), found)
    merged, counts = jl.merge(bits, motion=found), jl.merge(stack, motion=found)
    assert merged.shape == (size, size, 3)
    np.testing.assert_array_equal(merged.ones.sum(axis=2), counts.ones)
    np.testing.assert_array_equal(merged.trials.sum(axis=2), counts.trials)


@pytest.mark.slow
def test_counts_of_eight_bits_have_the_motion_of_the_scene():
    """Each image counts 255 readings during which the scene stands still."""
    scene, _ = record("shake")
    rng = np.random.default_rng(0)
    images = np.stack([scene.image(time) for time in range(48)])
    counts = rng.binomial(255, 1 - np.exp(-0.02 * images)).astype(np.uint8)
    found = jl.align(CountStack(counts, PROVENANCE, 255))
    assert rms_error(found, scene) < 0.3
    sensor = jl.Sensor(frames=48 * 255)
    assert_same(jl.align(CountStack(counts, PROVENANCE), sensor), found)


def test_counts_without_trials_need_a_sensor():
    stack = CountStack(np.ones((20, 32, 32), np.uint8), PROVENANCE)
    with pytest.raises(ValueError, match="counts of an unknown number of trials"):
        jl.align(stack)
    with pytest.raises(ValueError, match=r"multiple of the 20 images .* got 50; .*frames=1000 "):
        jl.align(stack, jl.Sensor(frames=50))
    stack = CountStack(np.ones((20, 32, 32), np.uint8), PROVENANCE, 3)
    with pytest.raises(ValueError, match=r"sensor: expected 60 frames.*sensor\.replace\(frames=60"):
        jl.align(stack, jl.Sensor(frames=20))
    with pytest.raises(ValueError, match=r"an oversampling of 1.*frames=80 \(--frames 80\)"):
        jl.align(stack, jl.Sensor(oversampling=2, frames=20))


@pytest.mark.parametrize("number", [40, pytest.param(3, marks=pytest.mark.slow)])
def test_hot_jots_do_not_hold_the_motion(number):
    """They stand still while the scene moves, and are as bright as the brightest parts."""
    dark = np.full((96, 96), 0.001)
    rng = np.random.default_rng(0)
    dark[rng.integers(0, 96, 8 * number), rng.integers(0, 96, 8 * number)] = 2.0
    scene, _ = record("shake", photons=0.15)
    sensor = scene.sensor.replace(dark_counts=dark)
    bits = moved(scene_shifts(scene), sensor=sensor, shape=(96, 96), rng=0)[1]
    found = jl.align(bits)
    assert found.model == "affine"
    assert rms_error(found, scene) < 0.4


def scene_shifts(scene):
    return np.stack([scene.motion(time)[:, 0, 0] for time in range(scene.sensor.frames)])


@pytest.mark.slow
def test_dead_jots_do_not_hold_the_motion():
    mask = np.random.default_rng(1).random((96, 96)) < 0.2
    scene, _ = record("shake")
    sensor = scene.sensor.replace(mask=mask)
    bits = moved(scene_shifts(scene), sensor=sensor, shape=(96, 96), rng=0)[1]
    assert rms_error(jl.align(bits), scene) < 0.3


def test_frames_may_be_read_from_files():
    scene, bits, found = aligned("shake", shape=(64, 64))
    packed, read = np.asarray(bits.packed), []

    def read_frames(start, stop):
        read.append(stop - start)
        return packed[start:stop]

    frames = jl.sensing.bits.frames.Frames(packed.shape, read_frames)
    assert_same(jl.align(jl.Bits(frames, bits.width, scene.sensor)), found)
    assert read


def test_progress_rises_from_0_to_1():
    _, bits, motion = aligned("shake", shape=(64, 64))
    for call in (
        lambda progress: jl.align(bits, progress=progress),
        lambda progress: jl.align(bits, model="none", progress=progress),
        lambda progress: jl.merge(bits, progress=progress),
        lambda progress: jl.merge(bits, motion=motion, progress=progress),
    ):
        seen = []
        call(seen.append)
        assert seen[-1] == 1
        assert seen == sorted(seen)
        assert min(seen) >= 0
