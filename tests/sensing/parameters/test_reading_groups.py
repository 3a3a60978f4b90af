"""Sensors whose readings differ in their gain or threshold: parameters, bits, and files."""

import json
import pickle
import re

import mpmath
import numpy as np
import pytest
from scipy import stats

import jotlight as jl
from jotlight.sensing.parameters.reading_groups import group_readings

GAINS = [1.0, 8.0, 64.0, 1.0, 8.0, 64.0]
CHECKERBOARD = np.where(np.indices((12, 16)).sum(axis=0) % 2, 1, 4)
DEAD = np.eye(12, 16, dtype=bool)
SENSORS = [
    jl.Sensor(frames=6, gain=GAINS),
    jl.Sensor(frames=6, oversampling=2, threshold=[1, 2, 2, 5, 1, 1], gain=30.0, mask=DEAD),
    jl.Sensor(frames=6, oversampling=2, threshold=CHECKERBOARD, gain=60.0, mask=DEAD),
    jl.Sensor(
        frames=6,
        oversampling=2,
        gain=GAINS,
        threshold=CHECKERBOARD,
        dark_counts=0.3,
        efficiency=0.5,
    ),
]


def image(sensor):
    height, width = 12 // sensor.oversampling, 16 // sensor.oversampling
    return np.random.default_rng(0).random((height, width))


def one_reading(sensor, frame, threshold):
    """A sensor all of whose readings are those of one frame and one threshold."""
    gain = np.broadcast_to(
        sensor.gain if np.ndim(sensor.gain) else sensor.gain / sensor.frames, sensor.frames
    )
    return sensor.replace(gain=float(gain[frame]) * sensor.frames, threshold=threshold)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_each_bit_is_that_of_a_sensor_whose_readings_are_all_like_its_own(sensor):
    bits = sensor.expose(image(sensor), rng=3).to_array()
    thresholds = np.broadcast_to(sensor.threshold, 6) if np.ndim(sensor.threshold) < 2 else None
    for frame in range(6):
        if thresholds is not None:
            plain = one_reading(sensor, frame, int(thresholds[frame]))
            expected = plain.expose(image(sensor), rng=3).to_array()[frame]
        else:
            each = [
                one_reading(sensor, frame, q).expose(image(sensor), rng=3).to_array()[frame]
                for q in (1, 4)
            ]
            expected = np.where(CHECKERBOARD == 1, *each)
        np.testing.assert_array_equal(bits[frame], expected)


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_tiles_frames_and_threads_do_not_change_the_bits(sensor, threads):
    scene = image(sensor)
    whole = sensor.expose(scene, rng=1)
    side = sensor.oversampling
    tile = slice(1, 4), slice(2, 6)
    part = sensor.expose(scene, rng=1, tile=tile, frames=slice(1, 5), threads=threads)
    jots = tuple(slice(each.start * side, each.stop * side) for each in tile)
    np.testing.assert_array_equal(part.to_array(), whole.to_array()[1:5][:, *jots])
    assert part.sensor.frames == 4
    again = part.sensor.probability(scene[tile])
    probability = sensor.probability(scene)
    rows = probability[1:5] if probability.ndim == 3 else probability
    np.testing.assert_array_equal(again, rows[..., *jots])


def test_the_bits_of_a_stack_and_of_channels_are_drawn():
    sensor = SENSORS[0]
    scenes = np.random.default_rng(1).random((2, 12, 16))
    first = sensor.expose(scenes[0], rng=5)
    stack = sensor.expose(scenes, rng=5)
    np.testing.assert_array_equal(stack[0].packed, first.packed)
    fractions = []
    color = sensor.expose(scenes, rng=5, channel_axis=0, progress=fractions.append)
    assert color.shape == (6, 12, 16, 2)
    np.testing.assert_array_equal(color.channels()[0].packed, first.packed)
    assert fractions[-1] == 1


@pytest.mark.parametrize("threshold", [1, 2, 7])
def test_probabilities_agree_with_mpmath(threshold):
    gains = [1e-6, 0.3, 5.0, 40.0]
    sensor = jl.Sensor(
        frames=8,
        gain=gains * 2,
        threshold=[threshold] * 4 + [threshold + 1] * 4,
        efficiency=0.7,
        dark_counts=0.01,
    )
    probability = sensor.probability(np.array([[0.25, 1.0]]))
    assert probability.shape == (8, 1, 2)
    for frame in range(8):
        for column, intensity in enumerate((0.25, 1.0)):
            rate = np.float32(0.7 * gains[frame % 4] * intensity + 0.01)
            q = threshold + frame // 4
            expected = mpmath.gammainc(q, 0, mpmath.mpf(float(rate)), regularized=True)
            assert probability[frame, 0, column] == pytest.approx(float(expected), rel=3e-6)


def test_rates_have_one_value_for_each_frame_only_if_gains_differ():
    scene = image(SENSORS[0])
    np.testing.assert_allclose(SENSORS[0].rate(scene)[1], 8 * SENSORS[0].rate(scene)[0])
    plain = jl.Sensor(frames=6, gain=12.0)
    thresholds = plain.replace(threshold=[1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(thresholds.rate(scene), plain.rate(scene))
    assert thresholds.probability(scene).shape == (6, *scene.shape)
    checkerboard = plain.replace(threshold=CHECKERBOARD)
    np.testing.assert_array_equal(checkerboard.rate(scene), plain.rate(scene))
    assert checkerboard.probability(scene).shape == scene.shape


def test_the_sampler_passes_exact_binomial_tests():
    sensor = jl.Sensor(frames=4, gain=[0.1, 1.0, 3.0, 3.0], threshold=[1, 1, 1, 3])
    scene = np.full((300, 300), 0.8)
    ones = sensor.expose(scene, rng=11).to_array().sum(axis=(1, 2))
    probabilities = sensor.probability(scene[:1, :1])[:, 0, 0].astype(float)
    for count, p in zip(ones, probabilities, strict=True):
        # 4 tests: one run in 25,000 fails by chance.
        assert stats.binomtest(int(count), scene.size, p).pvalue > 1e-5


def test_noisy_bits_of_a_bracket_and_a_map_of_thresholds_pass_binomial_tests():
    checkerboard = np.where(np.indices((200, 200)).sum(axis=0) % 2, 3, 1)
    sensor = jl.Sensor(frames=4, gain=[0.5, 2.0, 4.0, 2.0], threshold=checkerboard, read_noise=0.3)
    scene = np.full((200, 200), 0.8)
    bits, probability = sensor.expose(scene, rng=11).to_array(), sensor.probability(scene)
    for own in (checkerboard == 1, checkerboard == 3):
        for frame in range(4):
            p = float(probability[frame][own][0])
            ones = int(bits[frame][own].sum())
            # 8 tests: one run in 12,500 fails by chance.
            assert stats.binomtest(ones, int(own.sum()), p).pvalue > 1e-5


def test_groups_cover_each_reading_of_a_live_jot_once():
    for sensor in SENSORS:
        seen = np.zeros((6, 12, 16), int)
        for group in sensor.groups():
            assert not group.sensor.readings_differ
            live = np.ones((12, 16), bool) if group.sensor.mask is None else ~group.sensor.mask
            seen[group.frames] += live
        dead = np.zeros((12, 16), bool) if sensor.mask is None else sensor.mask
        assert (seen == ~dead).all()
    assert len(group_readings(jl.Sensor(frames=5))) == 1


def test_equal_values_are_one_number():
    assert jl.Sensor(frames=3, gain=[2.0, 2.0, 2.0]) == jl.Sensor(frames=3, gain=6.0)
    assert jl.Sensor(frames=2, threshold=[3, 3]).threshold == 3
    assert jl.Sensor(threshold=np.full((4, 4), 2)).threshold == 2
    assert jl.Sensor(gain=[2.5]).gain == 2.5


@pytest.mark.parametrize("sensor", SENSORS, ids=repr)
def test_sensors_are_compared_copied_and_stored(sensor, tmp_path):
    assert sensor == sensor.replace() == pickle.loads(pickle.dumps(sensor))
    assert hash(sensor) == hash(sensor.replace())
    assert sensor != sensor.replace(frames=6, gain=6.0, threshold=1)
    scalars = json.loads(json.dumps(sensor.scalars()))
    assert jl.Sensor.from_parts(scalars, sensor.maps()) == sensor
    assert "Sensor" in sensor._repr_html_()
    bits = sensor.expose(image(sensor), rng=0)
    for name in ("a.npy", "a.npy.gz", "a.h5", "a.zarr"):
        jl.save(bits, tmp_path / name)
        opened = jl.open(tmp_path / name)
        assert opened.sensor == sensor
        np.testing.assert_array_equal(np.asarray(opened.packed), bits.packed)
    again = jl.open(tmp_path / "a.npy", frames=slice(0, 2), rotate=90)
    assert again.sensor.frames == 2
    assert again.shape == (2, 16, 12)


def test_values_for_each_frame_are_read_only_copies():
    gains = np.array(GAINS)
    sensor = jl.Sensor(frames=6, gain=gains, threshold=[1, 2, 3, 1, 2, 3])
    gains[:] = 5
    assert sensor.gain.tolist() == GAINS
    for values in (sensor.gain, sensor.threshold):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1


def test_parts_of_bits_keep_the_gain_of_each_frame():
    bits = SENSORS[0].expose(image(SENSORS[0]), rng=0)
    assert bits[1:4].sensor.gain.tolist() == [8.0, 64.0, 1.0]
    assert bits[::3].sensor == jl.Sensor(frames=2, gain=2.0)
    assert next(bits.windows(2)).sensor.gain.tolist() == [1.0, 8.0]
    thresholds = jl.Sensor(frames=4, gain=8.0, threshold=[1, 2, 3, 4])
    assert thresholds.select_frames(slice(0, 2)).gain == 4.0
    assert jl.Sensor(frames=4, gain=8.0).select_frames(slice(0, 2)) == jl.Sensor(frames=2, gain=4.0)


def test_replace_keeps_the_light_of_each_jot():
    sensor = jl.Sensor(frames=2, gain=[1.0, 4.0])
    assert sensor.replace(oversampling=2).gain.tolist() == [4.0, 16.0]
    assert sensor.replace(frames=3, gain=[1, 2, 3]).frames == 3
    assert sensor.replace(frames=3, gain=3.0) == jl.Sensor(frames=3)
    with pytest.raises(ValueError, match=r"frames: expected 2.* a gain for each frame.*got 3"):
        sensor.replace(frames=3)
    with pytest.raises(ValueError, match=r"frames: expected 2.* a threshold for each"):
        jl.Sensor(frames=2, threshold=[1, 2]).replace(frames=3)


def test_the_text_states_the_number_and_the_range_of_values():
    text = repr(jl.Sensor(frames=6, gain=GAINS, threshold=CHECKERBOARD))
    assert text == "Sensor(frames=6, gain=<6 values, 1 to 64>, threshold=<12 x 16 map>)"


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"frames": 3, "gain": [1, 2]}, r"gain: .*each of the 3 frames, got int64 of shape \(2,\)"),
        ({"gain": [1, 2]}, r"gain: .*state the number of frames too, as in Sensor\(frames=2"),
        ({"frames": 2, "gain": [[1, 2]]}, r"gain: .*shape \(1, 2\)"),
        ({"frames": 2, "gain": [1, 0]}, "gain: expected a number from 1e-18 to 1e.18 for each"),
        ({"frames": 2, "gain": [1, np.nan]}, "gain: expected a number from 1e-18"),
        ({"frames": 2, "gain": [9e17, 2e17]}, "gain: expected a number from 1e-18"),
        ({"frames": 2, "gain": ["a", "b"]}, "gain: expected a number, or one for each"),
        ({"frames": 2, "threshold": [1, 70_000]}, "threshold: expected whole .* 1 to 65535, got"),
        ({"frames": 2, "threshold": [1, 1.5]}, "threshold: expected whole numbers"),
        ({"frames": 2, "threshold": [1, 2, 3]}, r"threshold: .*each of the 2 frames, or a map"),
        ({"threshold": [[1, 70_000]]}, "threshold: .*in a map of the jots, got 1 to 70000"),
        ({"threshold": [[0, 1]]}, "threshold: .*mark jots that never report 1 in the mask"),
        ({"threshold": [[1.5, 2.0]]}, "threshold: expected whole numbers"),
        ({"threshold": [[True, False]]}, "threshold: expected whole numbers"),
        ({"threshold": [[1, 2]], "mask": [[False]]}, "threshold: expected the shape of the map"),
        ({"threshold": np.ones((2, 2, 2), int)}, "threshold: expected"),
    ],
)
def test_bad_values_are_refused_and_named(parameters, message):
    if "mask" in parameters:
        parameters["mask"] = np.array(parameters["mask"])
    with pytest.raises(ValueError, match=f"^{message}"):
        jl.Sensor(**parameters)


def test_a_map_of_another_size_than_the_image_is_refused():
    with pytest.raises(ValueError, match=r"threshold: expected one value per jot, shape \(3, 3\)"):
        jl.Sensor(threshold=CHECKERBOARD).expose(np.ones((3, 3)))


USES = {
    "light_per_intensity": lambda sensor, bits: sensor.light_per_intensity,
    "pixel_response": lambda sensor, bits: sensor.pixel_response(),
    "engine_arguments": lambda sensor, bits: sensor.engine_arguments(),
    "merged": lambda sensor, bits: jl.Merged([[1]], 6, sensor),
    "plan": lambda sensor, bits: jl.plan(sensor, 1.0),
    "admm": lambda sensor, bits: jl.admm_tv(bits),
    "iterative": lambda sensor, bits: jl.mle_iterative(bits),
    "noniterative": lambda sensor, bits: jl.noniterative(bits),
    "network": lambda sensor, bits: jl.pretrained(sensor, "small").reconstruct(bits),
    "initial": lambda sensor, bits: jl.Network.initial(sensor),
    "hot jots": lambda sensor, bits: jl.calibration.find_hot_jots(bits),
}


OTHER_ADVICE = {
    "plan": r"state one of each; jotlight\.plan_brackets",
    "initial": r"reconstruct takes this sensor with the networks",
}


@pytest.mark.parametrize("name", USES)
def test_code_for_one_gain_and_threshold_refuses_others_and_says_what_to_do(name):
    sensor = SENSORS[0]
    bits = sensor.expose(image(sensor), rng=0)
    advice = OTHER_ADVICE.get(name, r"pass the data to jotlight\.reconstruct")
    message = f"sensor: expected .*one gain and (one )?threshold.*; {advice}"
    with pytest.raises(ValueError, match=message):
        USES[name](sensor, bits)


@pytest.mark.parametrize("frames", [[0, 1], 3, None])
def test_frames_are_selected_by_a_slice(frames):
    message = rf"frames: expected a slice, such as slice\(0, 16\), got {re.escape(repr(frames))}"
    for sensor in (jl.Sensor(frames=4), jl.Sensor(frames=4, gain=[1.0, 2.0, 1.0, 2.0])):
        with pytest.raises(TypeError, match=message):
            sensor.select_frames(frames)


def test_the_error_of_a_map_of_thresholds_for_several_bits_is_short():
    with pytest.raises(ValueError, match=r"got an array of \w+ of shape \(64, 64\)") as caught:
        jl.Sensor(bit_depth=4, threshold=1 + np.indices((64, 64)).sum(axis=0) % 2)
    assert len(str(caught.value)) < 250
