"""The blend of methods under which held-out bits are most likely."""

import numpy as np
import pytest

import jotlight as jl
from jotlight.evaluation import held_out as held_out_module
from jotlight.evaluation.choice import choose_method
from jotlight.evaluation.held_out import held_out
from jotlight.evaluation.many_trials import MAX_NETWORK_TRIALS
from jotlight.evaluation.methods import BLEND_METHOD, METHODS
from jotlight.sensing.data.pixel_counts import count_pixels
from jotlight.sensing.merged import Merged

PHOTOGRAPH = jl.datasets.photograph("camera", gray=True)[100:292, 150:342]
PARTS = "network-medium", "admm-tv", "mle"


@pytest.mark.slow
@pytest.mark.parametrize("frames", [256, 20_000, 1_000_000])
def test_the_blend_is_as_good_as_its_best_part(frames):
    scene = jl.datasets.moving(
        PHOTOGRAPH, "static", photons=0.2, sensor=jl.Sensor(frames=frames), rng=0
    )
    truth, sensor = scene.image(), scene.sensor
    counts = np.random.default_rng(0).binomial(frames, sensor.probability(truth).astype(float))
    quality = {name: jl.metrics.psnr(METHODS[name].run(counts, sensor), truth) for name in PARTS}
    assert jl.metrics.psnr(held_out(counts, sensor), truth) > max(quality.values()) - 0.05


@pytest.mark.slow
def test_the_result_is_reproducible():
    counts = np.random.default_rng(1).binomial(3000, 0.2 + 0.1 * np.eye(24))
    sensor = jl.Sensor(frames=3000)
    first, second = held_out(counts, sensor), held_out(counts, sensor, threads=1)
    np.testing.assert_allclose(first, second, atol=1e-5)


def test_one_warning_about_dead_pixels_comes_from_all_bits():
    trials = np.full((48, 48), 2000)
    trials[3, 4] = 0
    counts = np.random.default_rng(2).binomial(trials, 0.1 + 0.4 * PHOTOGRAPH[80:128, 80:128])
    with pytest.warns(jl.JotlightWarning) as caught:
        estimate = held_out(counts, jl.Sensor(frames=2000), trials=trials)
    assert [str(each.message).split(" ")[0] for each in caught] == ["1"]
    around = estimate[2:5, 3:6]
    assert around.min() < estimate[3, 4] < around.max()


def test_jots_that_differ_inside_a_pixel_are_served():
    efficiency = np.where(np.arange(48) % 2, 0.5, 1.0) * np.ones((48, 1))
    sensor = jl.Sensor(oversampling=2, frames=500, efficiency=efficiency)
    image = np.outer(np.linspace(0.2, 0.6, 24), np.ones(24))
    assert jl.metrics.psnr(held_out(sensor.expose(image, rng=0)), image) > 35


def test_it_is_the_default_for_many_trials():
    assert choose_method(jl.Sensor(frames=MAX_NETWORK_TRIALS)).method == "network-medium"
    assert choose_method(jl.Sensor(frames=MAX_NETWORK_TRIALS + 1)).method == BLEND_METHOD
    assert not METHODS[BLEND_METHOD].is_distinct(jl.Sensor(frames=16))


def test_a_smooth_kernel_is_refused():
    sensor = jl.Sensor(oversampling=2, frames=1000, kernel="cubic")
    with pytest.raises(ValueError, match="sensor: expected the box kernel for a blend"):
        held_out(sensor.expose(np.ones((4, 4)), rng=0))
    assert choose_method(sensor).method == "network-medium"


def test_small_weights_that_are_left_out_do_not_darken_the_image(monkeypatch):
    weights = np.float32([0.0009, 0.0009, 0.9982])[:, None, None, None] * np.ones((1, 24, 24))
    monkeypatch.setattr(held_out_module, "_choose_weights", lambda *_: weights)
    counts = np.random.default_rng(3).binomial(3000, 0.2, (24, 24))
    sensor = jl.Sensor(frames=3000)
    np.testing.assert_allclose(held_out(counts, sensor), jl.mle(counts, sensor), rtol=1e-6)


def test_fractional_zeros_are_held_out_as_often_as_whole_bits():
    counts = np.full((100, 100), 3, np.int32)
    merged = Merged(counts, np.full(counts.shape, 3.5), jl.Sensor(frames=4))
    pixels = count_pixels(merged, merged.sensor, None)
    ones, trials = held_out_module.hold_out(pixels)
    assert (trials - ones).mean() == pytest.approx(0.2 * 0.5, rel=0.1)
    assert ones.mean() == pytest.approx(0.2 * 3, rel=0.05)
