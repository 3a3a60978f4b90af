"""Sensors with an efficiency map, and every method on their data."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import jotlight as jl
from jotlight.evaluation.methods import METHODS
from reference import methods, sensing

RNG = np.random.default_rng(4)
PIXELS = np.float32(RNG.uniform(0.3, 1.0, (6, 8)))
JOTS = np.float32(RNG.uniform(0.3, 1.0, (12, 16)))


@pytest.mark.parametrize("kernel", ["box", "linear", "cubic"])
def test_rate_and_probability_agree_with_the_reference(kernel):
    sensor = jl.Sensor(oversampling=2, kernel=kernel, efficiency=JOTS, dark_counts=0.1)
    image = RNG.random((6, 8))
    np.testing.assert_allclose(sensor.rate(image), sensing.rate(sensor, image), rtol=1e-6)
    np.testing.assert_allclose(
        sensor.probability(image), sensing.probability(sensor, image), rtol=1e-6
    )


def test_an_efficiency_map_gives_the_bits_of_correspondingly_dimmer_light():
    share = np.float32(2.0 ** -RNG.integers(0, 3, (6, 8)))
    image = np.float32(RNG.integers(0, 64, (6, 8)) / 64)
    dimmed = jl.Sensor(frames=50).expose(image * share, rng=1)
    bits = jl.Sensor(frames=50, efficiency=share).expose(image, rng=1)
    assert (bits.packed == dimmed.packed).all()


def test_each_pixel_is_estimated_with_its_own_efficiency():
    sensor = jl.Sensor(frames=40, threshold=2, gain=90.0, efficiency=PIXELS, dark_counts=0.05)
    counts = RNG.integers(0, 41, (6, 8))
    expected = methods.mle(
        counts, 40, threshold=2, sensitivity=PIXELS.astype(float) * 90 / 40, dark=0.05
    )
    np.testing.assert_allclose(jl.mle(counts, sensor), expected, atol=1e-6)


def test_where_jots_of_a_pixel_differ_the_estimate_maximizes_the_likelihood():
    dark = np.float32(RNG.uniform(0, 0.3, JOTS.shape))
    mask = RNG.random(JOTS.shape) < 0.2
    sensor = jl.Sensor(
        oversampling=2, frames=6, efficiency=JOTS, dark_counts=dark, mask=mask, gain=30.0
    )
    bits = sensor.expose(np.float32(RNG.random((6, 8))), rng=2)
    estimate = jl.mle(bits, sensor)
    ones = bits.to_array().sum(axis=0)
    light = 30 / 24
    for row, column in np.ndindex(estimate.shape):
        block = np.s_[2 * row : 2 * row + 2, 2 * column : 2 * column + 2]
        live = ~mask[block]
        if not live.any():
            continue
        live_ones, eta, d = ones[block][live], JOTS[block][live].astype(float), dark[block][live]

        def cost(c, live_ones=live_ones, eta=eta, d=d):
            return -methods.log_likelihood(c, live_ones, 6, d, sensitivity=eta * light)

        best = minimize_scalar(cost, bounds=(0, 1), method="bounded", options={"xatol": 1e-10})
        value = min(best.fun, cost(0.0), cost(1.0))
        assert cost(float(estimate[row, column])) <= value + 1e-6


def test_counts_are_refused_where_jots_of_a_pixel_differ():
    sensor = jl.Sensor(oversampling=2, efficiency=JOTS)
    with pytest.raises(ValueError, match=r"expected bits, because .* efficiency or dark counts"):
        jl.mle(np.ones((6, 8), int), sensor)
    with pytest.raises(ValueError, match="differ in their efficiency or dark counts"):
        jl.admm_tv(np.ones((6, 8), int), sensor)


@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if method.available])
def test_a_constant_map_is_equivalent_to_a_number(name):
    plain = jl.Sensor(frames=16, gain=32.0, efficiency=0.5)
    mapped = plain.replace(efficiency=np.full((24, 24), 0.5))
    counts = RNG.integers(0, 17, (24, 24))
    run = METHODS[name].run
    np.testing.assert_allclose(run(counts, mapped), run(counts, plain), atol=2e-4)


@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if method.available])
def test_the_pattern_of_the_map_is_invisible_in_the_estimate(name):
    """Jots that differ by a factor of two give a constant estimate of a constant scene."""
    share = np.float32(np.where(RNG.random((64, 64)) < 0.5, 0.5, 1.0))
    frames = 64 if METHODS[name].unsupported_reason(jl.Sensor(frames=64)) is None else 16
    truth = jl.Sensor(frames=frames, gain=frames / 0.75, efficiency=share)
    scene = np.full((64, 64), 0.4, np.float32)
    bits = truth.expose(scene, rng=3)
    sensor = truth.replace(gain=frames / float(np.median(share)))
    # The gain relative to the median jot is the one the networks were trained for.
    estimate = METHODS[name].run(bits, sensor) * (sensor.gain / truth.gain)
    by_share = [float(estimate[share == value].mean()) for value in (0.5, 1.0)]
    ignored = METHODS[name].run(bits, sensor.replace(efficiency=float(np.median(share))))
    ignored = [float(ignored[share == value].mean()) for value in (0.5, 1.0)]
    assert abs(by_share[0] - by_share[1]) < 0.012
    assert np.mean(by_share) == pytest.approx(0.4, abs=0.012)
    if name in ("mle", "mle-iterative"):
        assert ignored[1] - ignored[0] > 0.1


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_likelihood_is_that_of_the_detected_light(threshold):
    eta, dark = RNG.uniform(0.2, 1, 50), RNG.uniform(0, 0.2, 50)
    ones, s = RNG.integers(0, 9, 50), RNG.uniform(0.05, 4, 50)
    options = {"threshold": threshold, "dark_counts": dark}
    with_map = jl.Likelihood(ones, 8, efficiency=eta, **options)
    without = jl.Likelihood(ones, 8, **options)
    assert with_map.value(s) == pytest.approx(without.value(eta * s), rel=1e-12)
    gradient, curvature = with_map.gradient_and_curvature(s)
    g, h = without.gradient_and_curvature(eta * s)
    np.testing.assert_allclose(gradient, eta * g, rtol=1e-10)
    np.testing.assert_allclose(curvature, eta**2 * h, rtol=1e-10)
    np.testing.assert_allclose(
        with_map.information(s), eta**2 * without.information(eta * s), rtol=1e-10
    )


@pytest.mark.parametrize("threshold", [1, 3])
def test_the_proximal_map_minimizes_its_objective(threshold):
    eta, ones = RNG.uniform(0.2, 1, 40), RNG.integers(0, 9, 40)
    point = RNG.uniform(-1, 3, 40)
    likelihood = jl.Likelihood(ones, 8, threshold=threshold, efficiency=eta, dark_counts=0.1)
    x = likelihood.proximal(point, 2.0, max_light=2.5)
    for i in range(40):
        one = jl.Likelihood(
            ones[i : i + 1], 8, threshold=threshold, efficiency=eta[i], dark_counts=0.1
        )

        def cost(value, one=one, i=i):
            return -one.value([value]) + (value - point[i]) ** 2

        best = minimize_scalar(cost, bounds=(0, 2.5), method="bounded", options={"xatol": 1e-9})
        assert cost(x[i]) <= min(best.fun, cost(0.0), cost(2.5)) + 1e-8


def test_with_an_efficiency_map_the_iterative_estimate_is_the_closed_form():
    sensor = jl.Sensor(frames=40, gain=60.0, efficiency=PIXELS, dark_counts=0.02)
    counts = RNG.integers(1, 30, (6, 8))
    np.testing.assert_allclose(jl.mle_iterative(counts, sensor), jl.mle(counts, sensor), atol=1e-5)


def test_saved_bits_and_tiles_keep_the_map(tmp_path, capsys):
    sensor = jl.Sensor(oversampling=2, efficiency=JOTS)
    bits = sensor.expose(np.full((6, 8), 0.5), rng=0)
    jl.save(bits, tmp_path / "bits.npy")
    assert jl.open(tmp_path / "bits.npy").sensor == sensor
    part = sensor.expose(np.full((6, 8), 0.5), rng=0, tile=(slice(1, 3), slice(2, 5)))
    np.testing.assert_array_equal(part.sensor.efficiency, JOTS[2:6, 4:10])


@pytest.mark.slow
def test_a_network_trained_for_a_map_gives_the_same_estimate_after_saving(tmp_path):
    sensor = jl.Sensor(frames=9, efficiency=PIXELS)
    start = jl.Network.initial(sensor)
    scenes = RNG.random((4, 16, 16))
    trained, _ = jl.train(start, scenes, sensor, steps=2, batch=4, rng=0)
    trained.save(tmp_path / "network.safetensors")
    loaded = jl.Network.load(tmp_path / "network.safetensors")
    counts = RNG.integers(0, 10, (6, 8))
    np.testing.assert_array_equal(
        loaded.reconstruct(counts, sensor), trained.reconstruct(counts, sensor)
    )


@pytest.mark.parametrize(
    ("efficiency", "message"),
    [
        (np.zeros((2, 2)), "efficiency: expected numbers from 1e-18 to 1, got 0; .*mask"),
        (np.full((2, 2), 1.5), r"relative to the mean.*gain"),
        (np.full((2, 2), np.nan), "from 1e-18 to 1"),
        (np.full((2, 2), 1e-19), "from 1e-18 to 1"),
        (np.ones((2, 2, 2)), "a map of numbers with one per jot"),
        (np.array([["a"]]), "a map of numbers"),
        (0.0, "from 1e-18 to 1, got 0.0"),
        (1.5, "from 1e-18 to 1, got 1.5$"),
        (40, "from 1e-18 to 1, got 40; write 0.4 for 40 %"),
    ],
)
def test_invalid_efficiencies_are_refused(efficiency, message):
    with pytest.raises(ValueError, match=message):
        jl.Sensor(efficiency=efficiency)


def test_maps_of_different_shapes_are_refused():
    with pytest.raises(ValueError, match=r"efficiency: expected the shape of the map of dark"):
        jl.Sensor(efficiency=np.ones((2, 2)), dark_counts=np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"efficiency: expected one value per jot"):
        jl.Sensor(efficiency=np.ones((2, 2))).expose(np.ones((3, 3)))


def test_the_command_line_accepts_a_map(tmp_path, monkeypatch):
    from jotlight.cli.app import run

    monkeypatch.chdir(tmp_path)
    np.save("share.npy", PIXELS)
    np.save("counts.npy", RNG.integers(0, 5, (6, 8)))
    words = "reconstruct counts.npy -o out.npy --frames 8 --efficiency share.npy"
    words += " --method mle --max-intensity 1"
    assert run(words.split()) == 0
    expected = jl.mle(np.load("counts.npy"), jl.Sensor(frames=8, efficiency=PIXELS))
    np.testing.assert_array_equal(np.load("out.npy"), expected)
