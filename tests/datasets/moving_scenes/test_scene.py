"""Moving scenes: image, motion, occlusion, and bits fit together."""

import tracemalloc

import numpy as np
import pytest
import scipy.stats
from scipy.ndimage import gaussian_filter, map_coordinates

import jotlight as jl
from jotlight.datasets import MOTIONS, moving
from jotlight.datasets.moving_scenes.kinds import _blob

CAMERA = gaussian_filter(jl.datasets.photograph()[100:356, 150:406], 2)
COINS = gaussian_filter(jl.datasets.photograph("coins")[:160, :160], 2)
SHAPE = 150, 160
FRAMES = 64


def scene_of(motion, photograph=CAMERA, foreground=COINS, **options):
    options = {"sensor": jl.Sensor(frames=FRAMES), "shape": SHAPE, "rng": 0, **options}
    return moving(photograph, motion, foreground=foreground, **options)


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_image_follows_the_motion_where_it_is_visible(motion):
    scene = scene_of(motion)
    positions = np.indices(SHAPE)
    for time in (0, 20.5, FRAMES - 1):
        visible = scene.visible(time)
        assert visible.mean() > 0.5
        place = positions + scene.motion(time)
        moved = map_coordinates(scene.image(time), place, order=3, mode="mirror")
        factor = np.median(moved[visible] / scene.image()[visible])
        assert factor == pytest.approx(1, abs=0.31 if motion == "flicker" else 0.001)
        error = abs(moved / factor - scene.image())[visible]
        # At outlines, both images mix foreground and background, and may do so differently. At
        # borders, the interpolation of the image above is inaccurate.
        share = {"layers": 0.97, "appear": 0.97, "parallax": 0.95}.get(motion, 0.99)
        assert np.quantile(error, share) < 0.01


@pytest.mark.parametrize("motion", MOTIONS)
def test_nothing_has_moved_at_the_time_of_the_points(motion):
    scene = scene_of(motion)
    for time in (5.25, scene.reference):
        np.testing.assert_allclose(scene.motion(time, at=time), 0, atol=1e-5)
        # Only at outlines, planes in front hide a part of a pixel.
        assert scene.visible(time, at=time).mean() > (
            0.97 if motion in ("layers", "appear", "parallax") else 0.9999
        )


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
    scene = scene_of("shake")
    whole = scene.bits.to_array()
    np.testing.assert_array_equal(scene.bits[10:13].to_array(), whole[10:13])
    np.testing.assert_array_equal(scene_of("shake").bits.to_array(), whole)
    assert (scene_of("shake", rng=1).bits[:1].to_array() != whole[:1]).any()
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
