"""Moving scenes: image, motion, occlusion, and bits fit together."""

import functools
import tracemalloc

import numpy as np
import pytest
import scipy.stats
from scipy.ndimage import gaussian_filter, map_coordinates

import jotlight as jl
from jotlight.datasets import MOTIONS, moving
from jotlight.datasets.moving_scenes.kinds import _blob
from jotlight.sensing.likelihood.multibit import reading_probability

CAMERA = gaussian_filter(jl.datasets.photograph()[100:356, 150:406], 2)
COINS = gaussian_filter(jl.datasets.photograph("coins")[:160, :160], 2)
SHAPE = 150, 160
FRAMES = 64
WITH_OUTLINES = "layers", "appear", "parallax", "two", "three", "five", "small", "stop", "person"


def scene_of(motion, photograph=CAMERA, foreground=COINS, **options):
    options = {"sensor": jl.Sensor(frames=FRAMES), "shape": SHAPE, "rng": 0, **options}
    return moving(photograph, motion, foreground=foreground, **options)


@functools.cache
def scene_of_kind(motion):
    return scene_of(motion)


ALIKE = "two", "five", "small", "spin", "parallax"
"""Motions of which the fast tests have similar ones."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "motion",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in ALIKE)) for name in MOTIONS],
)
def test_the_image_follows_the_motion_where_it_is_visible(motion):
    scene = scene_of_kind(motion)
    positions = np.indices(SHAPE)
    for time in (20.5, FRAMES - 1):
        visible = scene.visible(time)
        assert visible.mean() > 0.5
        place = positions + scene.motion(time)
        moved = map_coordinates(scene.image(time), place, order=3, mode="mirror")
        factor = np.median(moved[visible] / scene.image()[visible])
        assert factor == pytest.approx(1, abs=0.31 if motion == "flicker" else 0.001)
        error = abs(moved / factor - scene.image())[visible]
        # At outlines, both images mix foreground and background, and may do so differently. At
        # borders, the interpolation of the image above is inaccurate.
        share = 0.95 if motion in WITH_OUTLINES else 0.99
        assert np.quantile(error, share) < 0.01


@pytest.mark.parametrize("motion", MOTIONS)
def test_nothing_has_moved_at_the_time_of_the_points(motion):
    scene = scene_of_kind(motion)
    for time in (5.25, scene.reference):
        np.testing.assert_allclose(scene.motion(time, at=time), 0, atol=1e-5)
        # Only at outlines, planes in front hide a part of a pixel.
        assert scene.visible(time, at=time).mean() > (0.96 if motion in WITH_OUTLINES else 0.9999)


def test_motion_between_two_times_inverts_the_motion_between_the_reverse():
    scene = scene_of("sheet")
    forth, back = scene.motion(40, at=10), scene.motion(10, at=40)
    positions = np.indices(SHAPE) + forth
    returned = np.stack([map_coordinates(each, positions, order=3) for each in back])
    inside = (slice(None), slice(30, -30), slice(30, -30))
    np.testing.assert_allclose((forth + returned)[inside], 0, atol=2e-3)


def test_whole_shifts_of_an_array_shift_the_image():
    shifts = np.cumsum(np.random.default_rng(0).integers(-2, 3, (FRAMES, 2)), axis=0)
    scene = scene_of(shifts)
    larger = scene_of(shifts, shape=(230, 240)).image(0)
    for time in (3, 60):
        rows, columns = shifts[time] - shifts[0]
        expected = larger[40 - rows : 190 - rows, 40 - columns : 200 - columns]
        np.testing.assert_allclose(scene.image(time), expected, atol=1e-5)
        expected = np.broadcast_to((shifts[time] - shifts[0]).reshape(2, 1, 1), (2, *SHAPE))
        np.testing.assert_allclose(scene.motion(time, at=0), expected, atol=1e-5)


def test_rotation_and_zoom_have_the_closed_form():
    poses = np.zeros((3, 4))
    poses[:, 3] = 1
    poses[2] = 4, -3, 90, 2
    rows, columns = np.indices(SHAPE) - (np.array(SHAPE).reshape(2, 1, 1) - 1) / 2
    expected = np.stack([4 - 2 * columns - rows, -3 + 2 * rows - columns])
    scene = scene_of(poses, sensor=jl.Sensor(frames=3))
    np.testing.assert_allclose(scene.motion(2), expected, atol=1e-4)


def test_the_background_is_hidden_exactly_behind_the_object():
    scene, time = scene_of("layers", sensor=jl.Sensor(frames=3)), 2
    rows, columns = np.indices(SHAPE) - (np.array(SHAPE).reshape(2, 1, 1) - 1) / 2
    # The shifts of the background and of the object between the middle and the last frame.
    background, object_ = np.array([-3, 6]), np.array([8, -20])
    moved = np.stack([rows + background[0], columns + background[1]])
    hidden = _blob(moved - object_.reshape(2, 1, 1)) > 0.1
    inside = (abs(moved) <= np.array(SHAPE).reshape(2, 1, 1) / 2).all(axis=0)
    is_object = _blob(np.stack([rows, columns])) > 0.5
    np.testing.assert_array_equal(scene.visible(time), is_object | (inside & ~hidden))
    assert 0.02 < hidden[~is_object].mean() < 0.3


def test_an_object_that_appears_is_not_visible_before():
    scene = scene_of("appear")
    late = 0.7 * FRAMES
    is_object = scene.motion(0, at=late)[0] < 0  # the background moves down, the object up
    assert 0.2 < is_object.mean() < 0.6
    assert not scene.visible(10, at=late)[is_object].any()
    assert scene.visible(late + 5, at=late)[is_object].all()


def test_planes_are_numbered_from_back_to_front():
    scene = scene_of("layers")
    grid = np.indices(SHAPE) - (np.array(SHAPE).reshape(2, 1, 1) - 1) / 2
    np.testing.assert_array_equal(scene.planes(), _blob(grid) > 0.5)
    assert (scene.planes(0) != scene.planes()).any()
    assert not scene_of("shake").planes().any()


@pytest.mark.parametrize(("motion", "number"), [("two", 2), ("three", 3), ("five", 5)])
def test_several_objects_move_differently(motion, number):
    scene = scene_of(motion, shape=(256, 256))
    fields = np.round(scene.motion(FRAMES - 1) - scene.motion(0), 1).reshape(2, -1).T
    moves, counts = np.unique(fields, axis=0, return_counts=True)
    assert len(moves) == number + 1
    assert counts.min() > 500


@pytest.mark.slow
def test_an_object_that_stops_moves_until_then():
    scene = scene_of("stop")
    center = (slice(None), SHAPE[0] // 2, SHAPE[1] // 2)
    path = np.array([scene.motion(time)[center] for time in range(FRAMES)])
    steps = np.hypot(*np.diff(path, axis=0).T)
    assert steps[: int(0.6 * FRAMES)].min() > 0.1
    np.testing.assert_allclose(steps[int(0.6 * FRAMES) :], 0, atol=1e-6)


def test_the_limbs_of_a_person_turn_and_the_body_does_not():
    scene = scene_of("person", shape=(256, 256))
    change = scene.motion(FRAMES - 1) - scene.motion(scene.reference)
    body, foot = change[:, 128, 128], change[:, 128 + 78, 128 - 13]
    background = change[:, 10, 10]
    assert np.hypot(*(body - background)) > 5
    assert np.hypot(*(foot - body)) > 3
    assert np.ptp(change[:, 120:140, 122:134], axis=(1, 2)).max() < 1e-4


@pytest.mark.parametrize(
    "sensor",
    [jl.Sensor(oversampling=2, frames=FRAMES), jl.Sensor(frames=FRAMES, gain=300.0, threshold=2)],
)
def test_bits_have_the_probabilities_of_the_image(sensor):
    scene = scene_of("fast", sensor=sensor)
    bits = scene.bits.to_array()
    for frame in (0, 40):
        p = scene.sensor.replace(frames=1).probability(scene.image(frame)).astype(np.float64)
        for weights in (np.ones_like(p), p - p.mean(), np.gradient(p)[1]):
            excess = ((bits[frame] - p) * weights).sum()
            deviation = np.sqrt((p * (1 - p) * weights**2).sum())
            assert abs(excess) < 4.5 * deviation  # false alarm: 7 in a million
        wrong = scene.sensor.replace(frames=1).probability(scene.image(frame + 3))
        excess = ((bits[frame] - wrong) * (p - wrong)).sum()
        assert excess > 10 * np.sqrt((p * (1 - p) * (p - wrong) ** 2).sum())


def test_maps_of_the_sensor_are_used():
    mask = np.zeros(SHAPE, bool)
    mask[3, 4] = True
    dark = np.zeros(SHAPE)
    dark[7, 8] = 100
    counts = scene_of("shake", sensor=jl.Sensor(frames=FRAMES, mask=mask, dark_counts=dark)).bits
    counts = counts.counts()
    assert counts[3, 4] == 0
    assert counts[7, 8] == FRAMES


def test_frames_are_the_same_each_time_and_in_each_part():
    shape = (60, 70)
    scene = scene_of("shake", shape=shape)
    whole = scene.bits.to_array()
    np.testing.assert_array_equal(scene.bits[10:13].to_array(), whole[10:13])
    np.testing.assert_array_equal(scene_of("shake", shape=shape).bits.to_array(), whole)
    assert (scene_of("shake", rng=1, shape=shape).bits[:1].to_array() != whole[:1]).any()
    repeated = (whole[1:] == whole[:-1]).mean(axis=(1, 2))
    assert repeated.max() < 0.99


def test_a_generator_advances():
    rng = np.random.default_rng(3)
    first, second = (scene_of("shake", rng=rng).motion(0) for _ in range(2))
    assert abs(first - second).max() > 1


def test_samples_per_frame_average_the_light_of_a_frame():
    sensor = jl.Sensor(frames=3, gain=6.0)
    shifts = [[0, 0], [0, 10], [0, 20]]
    bits = scene_of(shifts, sensor=sensor, samples_per_frame=5).bits[1:2].to_array()[0]
    scene = scene_of(shifts, sensor=sensor)
    blurred = np.mean([scene.image(time) for time in (0.6, 0.8, 1.0, 1.2, 1.4)], axis=0)
    for image, fits in ((blurred, True), (scene.image(1), False)):
        p = sensor.replace(frames=1, gain=2.0).probability(image).astype(np.float64)
        weights = sensor.replace(frames=1, gain=2.0).probability(blurred) - p + 1e-3
        excess = ((bits - p) * weights).sum() / np.sqrt((p * (1 - p) * weights**2).sum())
        assert (abs(excess) < 4.5) == fits


def test_photons_are_the_mean_at_the_reference_and_leave_the_motion_alone():
    bright, dim = (scene_of("shake", photons=photons) for photons in (0.7, 0.05))
    for scene, photons in ((bright, 0.7), (dim, 0.05)):
        assert scene.sensor.rate(scene.image()).mean() == pytest.approx(photons, rel=1e-5)
    np.testing.assert_array_equal(bright.motion(3), dim.motion(3))
    np.testing.assert_array_equal(
        bright.with_photons(0.05).bits[:2].to_array(), dim.bits[:2].to_array()
    )


def test_photons_scale_all_gains_of_a_bracket():
    gain = np.repeat([8.0, 1.0], FRAMES // 2)
    scene = scene_of("static", sensor=jl.Sensor(frames=FRAMES, gain=gain), photons=0.3)
    assert scene.sensor.rate(scene.image()).mean() == pytest.approx(0.3, rel=1e-5)
    np.testing.assert_allclose(scene.sensor.gain / scene.sensor.gain[-1], gain)


def test_color_photographs_move_like_gray_ones():
    color = np.stack([CAMERA, CAMERA[::-1], CAMERA[:, ::-1]], axis=2)
    scene = scene_of("layers", color, np.stack([COINS] * 3, axis=2))
    gray = scene_of("layers")
    assert scene.bits.shape == (FRAMES, *SHAPE, 3)
    np.testing.assert_allclose(scene.image(9)[..., 0], gray.image(9), atol=1e-6)
    np.testing.assert_array_equal(scene.motion(9), gray.motion(9))


def test_long_bursts_take_little_memory():
    scene = scene_of("shake", sensor=jl.Sensor(frames=200_000), shape=(32, 32))
    tracemalloc.start()
    scene.bits[100_000:100_020].counts()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2e6


@pytest.mark.parametrize("motion", MOTIONS)
def test_one_frame_is_possible(motion):
    scene = scene_of(motion, sensor=jl.Sensor(), shape=(20, 30))
    assert np.isfinite(scene.image()).all()
    assert scene.bits.shape == (1, 20, 30)


@pytest.mark.parametrize(("frames", "motion"), [(64, "shake"), (1000, "shake"), (256, "fast")])
def test_paths_have_their_lengths(frames, motion):
    scene = scene_of(motion, sensor=jl.Sensor(frames=frames), shape=(1, 1))
    shifts = np.array([scene.motion(time).ravel() for time in range(frames)])
    if motion == "fast":
        assert np.linalg.norm(np.diff(shifts, axis=0), axis=1).mean() == pytest.approx(1, rel=1e-5)
    else:
        assert 12 <= np.linalg.norm(np.ptp(shifts, axis=0)) <= 36


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"motion": "walk"}, ValueError, "motion: expected one of static, .*, got 'walk'"),
        ({"motion": np.zeros((3, 3))}, ValueError, r"2 numbers .* got shape \(3, 3\)"),
        ({"motion": np.zeros((3, 4))}, ValueError, "zooms above 0"),
        ({"motion": [[0, np.nan]]}, ValueError, "expected finite numbers"),
        ({"motion": np.zeros((3, 2))}, ValueError, "the sensor's 64 frames, got 3"),
        ({"photograph": np.zeros((4, 4), int)}, TypeError, "int"),
        ({"foreground": np.zeros((9, 9, 3))}, ValueError, "foreground: expected as many channels"),
        ({"shape": (0, 3)}, ValueError, "shape: expected rows and columns"),
        ({"photons": 0}, ValueError, "photons"),
        ({"photograph": np.zeros((9, 9)), "photons": 1}, ValueError, "that is not black"),
        ({"samples_per_frame": 0}, ValueError, "samples_per_frame"),
        ({"sensor": jl.Sensor(frames=FRAMES, mask=np.zeros((3, 3), bool))}, ValueError, "mask"),
    ],
)
def test_bad_arguments_are_refused(arguments, error, message):
    arguments = {"motion": "static", **arguments}
    with pytest.raises(error, match=message):
        scene_of(**arguments)


def test_the_default_is_a_shaken_photograph_of_256_frames():
    scene = moving()
    assert scene.bits.shape == (256, 512, 512)
    assert repr(scene).startswith("<MovingScene: 512 x 512 pixels, 1 plane, Sensor(frames=256")
    # Two scenes without a seed are different.
    assert scipy.stats.pearsonr(scene.image(0).ravel(), moving().image(0).ravel())[0] < 0.9999


def test_a_pixel_integrates_over_the_detail_of_the_photograph():
    """At rest, pixels are means of 2 x 2 pixels of the slightly blurred photograph."""
    blurred = gaussian_filter(CAMERA, 0.6, mode="mirror")
    scene = moving(CAMERA, "static", sensor=jl.Sensor(frames=1), detail=2, rng=0)
    assert scene.shape == (128, 128)
    fine = scene.image(upsample=2)
    np.testing.assert_allclose(fine, blurred, atol=1e-5)
    expected = fine.reshape(128, 2, 128, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(scene.image(), expected, atol=1e-6)


def test_detail_moves_with_the_scene():
    """A shift by a quarter of a pixel is one by half a pixel of the photograph."""
    shifts = [(0, 0), (0.5, -1), (0.25, 0.75)]
    sensor = jl.Sensor(frames=3)
    scene = moving(CAMERA, shifts, sensor=sensor, shape=(60, 64), detail=2, rng=0)
    # The texture of detail 2 is that of detail 1, in other units.
    plain = moving(CAMERA, 2 * np.array(shifts), sensor=sensor, shape=(120, 128), rng=0)
    for time in range(3):
        np.testing.assert_allclose(scene.image(time, upsample=2), plain.image(time), atol=1e-6)
    # Motions are in pixels of the sensor.
    for moved, expected in zip(scene.motion(2), (-0.25, 1.75), strict=True):
        np.testing.assert_allclose(moved, expected, atol=1e-6)
    assert scene.bits.shape == (3, 60, 64)


@pytest.mark.parametrize("upsample", [0, 2, 4])
def test_detail_that_a_scene_has_not_is_refused(upsample):
    scene = moving(CAMERA, "static", sensor=jl.Sensor(frames=1), detail=3, shape=(8, 8), rng=0)
    assert scene.image(upsample=3).shape == (24, 24)
    with pytest.raises(ValueError, match="upsample: expected a divisor"):
        scene.image(upsample=upsample)
    with pytest.raises(ValueError, match="detail: expected"):
        moving(CAMERA, "static", detail=0)


def test_readings_of_several_bits_are_drawn_frame_by_frame():
    sensor = jl.Sensor(frames=20, gain=40.0, bit_depth=3, read_noise=0.2)
    scene = scene_of("shake", sensor=sensor, shape=(40, 48))
    readings = scene.bits
    assert (readings.shape, readings.sensor) == ((20, 40, 48), sensor)
    # The same frame is the same readings, and those of its own image.
    np.testing.assert_array_equal(readings[7], readings.to_array()[7])
    for frame in (0, 13):
        light = 2.0 * scene.image(frame)
        mean = reading_probability(np.arange(8)[:, None, None], light, bit_depth=3, read_noise=0.2)
        expected = np.tensordot(np.arange(8), mean, axes=1)
        assert readings[frame].mean() == pytest.approx(expected.mean(), abs=0.12)
        assert np.corrcoef(readings[frame].ravel(), expected.ravel())[0, 1] > 0.4
