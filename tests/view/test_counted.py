"""What the page counts, in brackets and in readings of several bits."""

import functools

import numpy as np
import pytest

import jotlight as jl
from jotlight.estimators.brightness import unit_scale
from jotlight.view.alignment import merge_window
from jotlight.view.counted import EQUIVALENT, ONES, counted_by
from jotlight.view.estimate import estimate, fraction_at
from jotlight.view.facts import describe_capture
from jotlight.view.overlays import DEAD, JotMap, find_errors, find_saturated
from jotlight.view.running_counts import RunningCounts
from jotlight.view.saving import save_view
from jotlight.view.state import ViewState
from jotlight.view.timeline import firing_rates
from jotlight.view.viewed import Viewed
from moving import in_memory

PHOTO = jl.datasets.photograph("camera")[100:124, 180:212]
SEVERAL = jl.Sensor(frames=12, bit_depth=4, gain=60.0)
BRACKET = jl.Sensor(frames=14, gain=np.resize([0.25, 1.0, 4.0], 14))


@functools.cache
def viewed_of(sensor):
    return Viewed.from_data(sensor.expose(PHOTO, rng=0))


def made(viewed, span, method="mle", merged=None):
    return estimate(viewed, span, method, RunningCounts(viewed).move(span), merged)


def test_readings_are_summed_out_of_the_largest_sum():
    viewed = viewed_of(SEVERAL)
    shown = made(viewed, range(2, 8), "counts")
    total = viewed.data.to_array()[2:8].sum(axis=0)
    np.testing.assert_array_equal(shown.counts, total)
    np.testing.assert_array_equal(shown.image, (total / (6 * 15)).astype(np.float32))
    assert shown.counted == counted_by(SEVERAL)
    assert shown.title == "sum of readings"
    assert shown.mean_reading == pytest.approx(total.mean() / 6)


def test_readings_of_the_jots_of_a_pixel_are_summed():
    viewed = viewed_of(SEVERAL.replace(oversampling=2, frames=3))
    jots = viewed.data.to_array().sum(axis=0).reshape(24, 2, 32, 2)
    counts = RunningCounts(viewed).move(range(3))
    np.testing.assert_array_equal(counts, jots.sum(axis=(1, 3)))


@pytest.mark.parametrize("sensor", [SEVERAL, SEVERAL.replace(read_noise=0.4), BRACKET])
def test_an_intensity_becomes_the_mean_fraction_of_its_readings(sensor):
    bright = sensor.expose(np.full((200, 200), 0.7), rng=0)
    mean = bright.to_array().mean() / sensor.max_reading
    assert fraction_at(0.7, sensor) == pytest.approx(mean, rel=0.02)


def test_windows_and_times_are_whole_cycles():
    viewed = viewed_of(BRACKET)
    assert (viewed.cycle, viewed.frames) == (3, range(12))
    facts = describe_capture(viewed)
    assert (facts["cycle"], facts["state"]["window"], facts["end"]) == (3, 12, 12)
    assert ["gain α per frame", "0.25, 1, 4 photons"] in facts["sensor"]
    rates, each = firing_rates(viewed)
    expected = viewed.data.to_array()[:12].reshape(4, -1).mean(axis=1)
    np.testing.assert_allclose(rates, expected, rtol=1e-6)
    assert each == 3
    with pytest.raises(ValueError, match="whole cycles of 3 frames of 0 to 11, got 1 to 6"):
        save_view(viewed, ViewState(1, 6), "png")


def test_a_bracket_that_does_not_repeat_is_refused():
    bits = jl.Sensor(frames=4, gain=[8.0, 8.0, 1.0, 1.0]).expose(PHOTO, rng=0)
    with pytest.raises(ValueError, match=r"exposures that repeat .* bits\[:2\]"):
        Viewed.from_data(bits)


def test_saturated_readings_are_all_the_largest_one():
    scene = np.full((4, 4), 0.02)
    scene[1, 2], mask = 50.0, np.eye(4, dtype=bool)
    sensor = SEVERAL.replace(mask=mask, max_intensity=100.0)
    viewed = Viewed.from_data(sensor.expose(scene, rng=0))
    shown = made(viewed, range(12), "counts")
    assert np.argwhere(find_saturated(shown)).tolist() == [[1, 2]]
    found, note = JotMap(viewed).find()
    assert (found == np.where(mask, DEAD, 0)).all()
    assert "hot jots are not searched: expected single bits, got readings of 4 bits;" in note


def test_methods_that_do_not_take_the_readings_state_why():
    smooth = jl.Sensor(frames=6, gain=[1.0, 4.0] * 3, oversampling=2, kernel="linear")
    for sensor, refused in ((smooth, "admm-tv"), (SEVERAL, None)):
        methods = describe_capture(viewed_of(sensor))["methods"]
        reasons = {each["name"]: each.get("reason") for each in methods}
        assert methods[0]["title"] == counted_by(sensor).title
        assert reasons["mle"] is reasons["network-medium"] is None
        if refused:
            assert "other than plain bits" in reasons[refused]
            with pytest.raises(ValueError, match="expected"):
                jl.reconstruct(viewed_of(sensor).data, method=refused)


@functools.cache
def moving(name):
    gain = np.tile([0.5, 2.0], 24)
    sensors = {
        "several": jl.Sensor(frames=48, bit_depth=4, read_noise=0.3),
        "noisy": jl.Sensor(frames=48, read_noise=0.3),
        "bracket": jl.Sensor(frames=48, gain=gain),
    }
    scene = jl.datasets.moving(
        motion="shake", sensor=sensors[name], shape=(64, 64), photons=1.5, rng=0
    )
    if name == "several":
        return jl.Readings(scene.bits.to_array(), scene.sensor)
    return in_memory(scene)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["several", "noisy", "bracket"])
def test_an_aligned_window_equals_that_of_the_library(name):
    data, span = moving(name), range(4, 44)
    viewed = Viewed.from_data(data)
    merged, _ = merge_window(viewed, span, "mle")
    shown = made(viewed, span, "network-medium", merged)
    expected = jl.merge(data[4:44])
    np.testing.assert_array_equal(shown.image, jl.reconstruct(expected))
    assert shown.counted == EQUIVALENT != ONES
    assert shown.sensor.has_plain_bits is False
    if name != "bracket":
        photons = unit_scale(merged.sensor, "photons", merged)
        assert unit_scale(shown.sensor, "photons") == pytest.approx(photons)
    known = jl.uncertainty(expected, estimate=shown.image)
    np.testing.assert_array_equal(find_errors(shown), known.standard_error)
    with pytest.raises(ValueError, match="saturated: equivalent counts do not show"):
        find_saturated(shown)
