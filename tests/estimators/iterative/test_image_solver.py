"""Data, sensors, and starts of the iterative methods, with both methods."""

import numpy as np
import pytest

import jotlight as jl
from reference.iterative import scene

METHODS = [jl.mle_iterative, jl.admm_tv]
SENSOR = jl.Sensor(oversampling=2)
SMOOTH = SENSOR.replace(kernel="cubic")
UNEQUAL = SENSOR.replace(dark_counts=np.linspace(0, 1, 64).reshape(8, 8))
BITS = jl.Bits.from_array(np.eye(8, dtype=bool))
PROBLEM = jl.Problem(jl.operators.spread((4,)), jl.Likelihood([0, 1, 1, 0]))


@pytest.mark.parametrize(
    ("method", "sensor", "shape"),
    [
        (jl.mle_iterative, jl.Sensor(oversampling=4, dark_counts=0.1), (9, 8)),
        (jl.admm_tv, jl.Sensor(oversampling=4), (16, 16)),
    ],
)
def test_bits_and_their_counts_give_the_same_estimate(method, sensor, shape):
    bits = sensor.expose(scene(*shape), rng=0)
    np.testing.assert_array_equal(method(bits, sensor), method(bits.counts(4), sensor))


@pytest.mark.parametrize("kernel", ["box", "quadratic"])
@pytest.mark.parametrize("method", METHODS)
def test_the_channels_of_a_color_image_are_estimated_independently(method, kernel):
    sensor = jl.Sensor(oversampling=2, frames=4, kernel=kernel, mask=np.eye(16, 20, dtype=bool))
    bits = sensor.expose(np.dstack([scene(8, 10), 0.3 * scene(8, 10)]), rng=11, channel_axis=-1)
    start = np.random.default_rng(11).uniform(0.2, 0.8, (8, 10, 2))
    estimate, histories = method(bits, sensor, start=start, return_history=True)
    assert (estimate.shape, len(histories)) == ((8, 10, 2), 2)
    for channel in range(2):
        alone, history = method(
            jl.Bits.from_array(bits.to_array()[..., channel]),
            sensor,
            start=start[..., channel],
            return_history=True,
        )
        np.testing.assert_array_equal(estimate[..., channel], alone)
        np.testing.assert_array_equal(histories[channel].weight, history.weight)
        assert histories[channel].objective == history.objective
        assert histories[channel].iterations == history.iterations


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("data", "sensor", "options", "error", "message"),
    [
        (BITS, SENSOR, {"start": np.zeros((4, 5))}, ValueError, r"\(4, 4\), got \(4, 5\)"),
        (BITS, SENSOR, {"start": np.zeros((4, 4, 3))}, ValueError, r"start: .*got .*\(4, 4, 3\)"),
        (BITS, SENSOR, {"start": np.ones((4, 4), int)}, TypeError, "expected floats .* got int64"),
        (BITS, SENSOR, {"start": np.full((4, 4), np.nan)}, ValueError, "start: .* got NaN"),
        (
            BITS,
            None,
            {},
            TypeError,
            "sensor: .* because these bits carry none",
        ),
        (PROBLEM, SENSOR, {}, TypeError, "sensor: expected none, since a Problem has its own"),
        (PROBLEM, None, {"start": np.zeros(5)}, ValueError, r"shape \(4,\), got \(5,\)"),
        (np.ones((4, 4), int), SMOOTH, {}, ValueError, "expected bits, because .* cubic kernel"),
        (np.ones((4, 4), int), UNEQUAL, {}, ValueError, "expected bits, because .* dark counts"),
        (
            BITS,
            SMOOTH.replace(mask=np.ones((8, 8), bool)),
            {},
            ValueError,
            "trials: expected at least one pixel with a valid bit, got none",
        ),
    ],
)
def test_data_sensor_and_start_that_do_not_fit_are_refused(
    method, data, sensor, options, error, message
):
    with pytest.raises(error, match=message):
        method(data, sensor, **options)


@pytest.mark.parametrize("method", [jl.mle_iterative, jl.admm_tv, jl.mle, jl.noniterative])
@pytest.mark.parametrize(("own", "stated"), [("cubic", "box"), ("box", "cubic")])
@pytest.mark.filterwarnings(
    "ignore:a cubic kernel spreads the light"
)  # some methods do not model it
def test_callers_may_state_another_kernel_than_the_bits(method, own, stated):
    bits = SMOOTH.replace(kernel=own).expose(scene(8, 8), rng=0)
    sensor = SMOOTH.replace(kernel=stated)
    found = method(bits, sensor)
    np.testing.assert_array_equal(found, method(jl.Bits(bits.packed, bits.width), sensor))


@pytest.mark.parametrize("method", ["mle-iterative", "admm-tv"])
@pytest.mark.parametrize("changes", [{"gain": [1, 2, 3]}, {"bit_depth": 3}, {"read_noise": 0.2}])
def test_other_readings_with_a_smooth_kernel_are_refused_with_advice_that_works(method, changes):
    sensor = SMOOTH.replace(frames=3, **changes)
    data = sensor.expose(scene(8, 8), rng=0)
    expected = "kernel: expected 'box', got 'cubic': deconvolution needs plain bits"
    with pytest.raises(ValueError, match=expected):
        jl.reconstruct(data, method=method)
    estimate = jl.reconstruct(data, sensor.replace(kernel="box"), method=method)
    assert estimate.shape == (8, 8)


@pytest.mark.parametrize("method", [jl.mle_iterative, jl.admm_tv])
@pytest.mark.parametrize("kernel", ["linear", "cubic"])
def test_counts_of_single_jots_suffice_for_smooth_kernels(method, kernel):
    dark_counts = np.random.default_rng(0).uniform(0, 0.5, (8, 8))
    mask = np.arange(64).reshape(8, 8) % 11 == 3
    sensor = jl.Sensor(frames=20, kernel=kernel, dark_counts=dark_counts, mask=mask)
    bits = sensor.expose(scene(8, 8), rng=0)
    np.testing.assert_array_equal(method(bits.counts(), sensor), method(bits))
