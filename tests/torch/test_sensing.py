"""The sensor as a layer of PyTorch."""

import copy

import numpy as np
import pytest
from scipy.special import gammainc, gammaincc
from scipy.stats import binom, norm

import jotlight as jl
from jotlight.sensing.likelihood import Likelihood
from reference import sensing as twin

torch = pytest.importorskip("torch")
from jotlight.torch import Sensing  # noqa: E402
from jotlight.torch.response import detection_probability, log_probabilities  # noqa: E402

RNG = np.random.default_rng(0)
HEIGHT, WIDTH, SIDE = 4, 5, 3
MAPS = {
    "dark_counts": RNG.uniform(0, 0.3, (HEIGHT * SIDE, WIDTH * SIDE)),
    "efficiency": RNG.uniform(0.3, 1, (HEIGHT * SIDE, WIDTH * SIDE)),
    "mask": RNG.random((HEIGHT * SIDE, WIDTH * SIDE)) < 0.3,
}
SENSORS = {
    "plain": jl.Sensor(oversampling=SIDE),
    "threshold": jl.Sensor(oversampling=SIDE, frames=2, threshold=3, gain=60.0),
    "linear": jl.Sensor(oversampling=SIDE, kernel="linear"),
    "cubic": jl.Sensor(oversampling=SIDE, kernel="cubic", efficiency=0.6, threshold=2, gain=30.0),
    "maps": jl.Sensor(oversampling=SIDE, frames=2, **MAPS),
    "all": jl.Sensor(oversampling=SIDE, kernel="quadratic", threshold=2, gain=20.0, **MAPS),
}
every_sensor = pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)


def image(dtype=torch.float64, number=1):
    light = np.random.default_rng(1).uniform(0.1, 1, (number, 1, HEIGHT, WIDTH))
    return torch.from_numpy(light).to(dtype)


@every_sensor
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_chances_are_the_twins(sensor, dtype):
    light = image(dtype)
    expected = twin.probability(sensor, light[0, 0].numpy())
    given = Sensing(sensor).probability(light)
    assert given.dtype == dtype
    assert given.shape == (1, 1, *expected.shape)
    tolerance = 1e-5 if dtype == torch.float32 else 2e-7  # maps are kept in float32
    np.testing.assert_allclose(given[0, 0], expected, rtol=tolerance, atol=1e-9)
    bits = Sensing(sensor, output="bits", gradient="expectation")(light)
    assert bits.shape == (1, sensor.frames, *expected.shape)
    np.testing.assert_allclose(bits[0], [expected] * sensor.frames, rtol=tolerance, atol=1e-9)
    counts = Sensing(sensor, gradient="expectation")(light)
    blocks = expected.reshape(HEIGHT, SIDE, WIDTH, SIDE).sum((1, 3)) * sensor.frames
    np.testing.assert_allclose(counts[0, 0], blocks, rtol=tolerance)


@pytest.mark.parametrize("kernel", ["box", "linear", "quadratic", "cubic"])
@pytest.mark.parametrize("side", [1, 2, 5])
@pytest.mark.parametrize("size", [(1, 1), (2, 7), (9, 3)])
def test_kernels_spread_light_as_the_engine_does(kernel, side, size):
    sensor = jl.Sensor(oversampling=side, kernel=kernel, dark_counts=0.1, efficiency=0.5)
    light = np.random.default_rng(2).random((2, 1, *size))
    rates = Sensing(sensor).rate(torch.from_numpy(light))
    for one, given in zip(light[:, 0], rates[:, 0], strict=True):
        np.testing.assert_allclose(given, sensor.rate(one), rtol=1e-6)


@pytest.mark.parametrize("output", ["counts", "bits"])
@pytest.mark.parametrize("name", ["plain", "threshold", "cubic", "maps"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_draws_fire_as_often_as_they_should(output, name, dtype):
    """A right layer fails once in 10^9 times, all pixels and cases taken together."""
    sensor, number = SENSORS[name], 4000
    light = image()[:1].to(dtype)
    drawn = Sensing(sensor, output=output)(
        light.expand(number, -1, -1, -1), torch.Generator().manual_seed(5)
    )
    assert drawn.dtype == torch.float32
    ones = drawn.double().sum(0).numpy()
    chances = twin.probability(sensor, light[0, 0].double().numpy())
    assert np.isin(drawn[:10].numpy(), np.arange(1 + sensor.bits_per_pixel)).all()
    false_alarm = 1e-9 / (16 * ones.size)
    if output == "bits":
        assert drawn.max() == 1
        low, high = binom.ppf([[[[false_alarm / 2]]], [[[1 - false_alarm / 2]]]], number, chances)
        assert ((low <= ones) & (ones <= high)).all()
        return
    blocks = (chances.reshape(HEIGHT, SIDE, WIDTH, SIDE), sensor.frames * number)
    trials = blocks[1] * SIDE**2
    if name in ("plain", "threshold"):
        chance = blocks[0].mean((1, 3))
        low, high = binom.ppf([[[false_alarm / 2]], [[1 - false_alarm / 2]]], trials, chance)
        assert ((low <= ones[0]) & (ones[0] <= high)).all()
        # A binomial variable's spread, too: within 20 % of 4000 draws is beyond nine deviations.
        spread = drawn.double().var(0)[0].numpy()
        expected = sensor.bits_per_pixel * chance * (1 - chance)
        assert abs(spread / expected - 1).max() < 0.2
        return
    # Of jots that differ, by Hoeffding's inequality.
    mean = blocks[0].sum((1, 3)) * blocks[1]
    most = np.sqrt(0.5 * trials * np.log(2 / false_alarm))
    assert abs(ones[0] - mean).max() < most


def test_a_generator_gives_the_same_draw_again():
    sensing = Sensing(SENSORS["plain"])
    one, again, other = (
        sensing(image(), torch.Generator().manual_seed(seed)) for seed in (3, 3, 4)
    )
    assert torch.equal(one, again)
    assert not torch.equal(one, other)


@every_sensor
@pytest.mark.parametrize("output", ["counts", "bits"])
def test_gradients_of_the_expectation_are_those_of_differences(sensor, output):
    sensing = Sensing(sensor, output=output, gradient="expectation")
    light = image(number=2).requires_grad_()
    assert torch.autograd.gradcheck(sensing, light, fast_mode=True)
    assert torch.autograd.gradgradcheck(sensing, light, fast_mode=True)


@every_sensor
@pytest.mark.parametrize("output", ["counts", "bits"])
def test_gradients_of_draws_are_those_of_their_expectation(sensor, output):
    weights = None
    slopes = []
    for gradient in ("straight-through", "expectation"):
        light = image(number=2).requires_grad_()
        seen = Sensing(sensor, output=output, gradient=gradient)(light)
        if weights is None:
            weights = torch.randn(seen.shape, dtype=seen.dtype)
        (weights * seen).sum().backward()
        slopes.append(light.grad)
    torch.testing.assert_close(*slopes, rtol=1e-12, atol=0)


@pytest.mark.parametrize("threshold", [1, 2, 3, 8])
def test_chances_have_their_slope_at_no_light_and_at_much(threshold):
    rate = torch.tensor([0.0, 1e-8, 1.0, 500.0], dtype=torch.float64, requires_grad=True)
    chances = detection_probability(threshold, rate)
    chances.sum().backward()
    s = rate.detach().numpy()
    np.testing.assert_allclose(chances.detach(), gammainc(threshold, s), rtol=1e-12)
    slope = np.exp(-s) * s ** (threshold - 1) / np.prod(np.arange(1, threshold))
    np.testing.assert_allclose(rate.grad, slope, rtol=1e-12, atol=1e-16)


@pytest.mark.parametrize("threshold", [1, 2, 3, 8, 40])
def test_logarithms_keep_their_digits(threshold):
    s = np.concatenate([np.geomspace(1e-3, 30, 40), [0.999999, 1.0, 1.000001]])
    rate = torch.from_numpy(s).requires_grad_()
    fired, rested = log_probabilities(threshold, rate)
    np.testing.assert_allclose(fired.detach(), np.log(gammainc(threshold, s)), rtol=1e-8)
    np.testing.assert_allclose(
        rested.detach(), np.log(gammaincc(threshold, s)), rtol=1e-8, atol=1e-15
    )
    assert torch.autograd.gradcheck(
        lambda x: log_probabilities(threshold, x)[0], rate[5:].detach().requires_grad_()
    )
    dim = torch.tensor([1e-12], dtype=torch.float32, requires_grad=True)
    log_probabilities(threshold, dim)[0].sum().backward()
    np.testing.assert_allclose(dim.grad, threshold / 1e-12, rtol=1e-5)  # P is near s^q / q!


@every_sensor
def test_the_likelihood_of_bits_is_the_engines(sensor):
    sensing = Sensing(sensor, output="bits")
    light = image()
    bits = sensing(light, torch.Generator().manual_seed(1))
    of_jots = Likelihood(
        bits.sum(1)[0].numpy().astype(int),
        sensor.frames if sensor.mask is None else np.where(sensor.mask, 0, sensor.frames),
        threshold=sensor.threshold,
        efficiency=sensor.efficiency,
        dark_counts=sensor.dark_counts,
    )
    s = sensor.replace(efficiency=1.0, dark_counts=0.0).rate(light[0, 0].numpy())
    np.testing.assert_allclose(sensing.log_likelihood(bits, light), of_jots.value(s), rtol=1e-6)
    light.requires_grad_()
    assert torch.autograd.gradcheck(
        lambda c: sensing.log_likelihood(bits, c), light, fast_mode=True
    )


@pytest.mark.parametrize("name", ["plain", "threshold"])
def test_the_likelihood_of_counts_is_highest_at_the_closed_form(name):
    sensor = SENSORS[name].replace(max_intensity=50.0)
    sensing = Sensing(sensor)
    counts = torch.arange(1, sensor.bits_per_pixel).double()[None, None, None]
    best = torch.from_numpy(jl.mle(counts[0, 0].numpy().astype(int), sensor))[None, None].double()
    best.requires_grad_()
    value = sensing.log_likelihood(counts, best)
    (slope,) = torch.autograd.grad(value.sum(), best)
    assert abs(slope * best).max() < 1e-3
    for factor in (0.9, 1.1):
        assert sensing.log_likelihood(counts, factor * best) < value


def test_the_likelihood_and_its_slope_are_finite_without_light():
    for threshold in (1, 3):
        sensing = Sensing(jl.Sensor(threshold=threshold))
        light = torch.zeros(1, 1, 1, 2, requires_grad=True)
        value = sensing.log_likelihood(torch.tensor([[[[0.0, 1.0]]]]), light)
        value.sum().backward()
        assert torch.isfinite(value).all()
        assert light.grad[..., 0] <= 0 < light.grad[..., 1] < np.inf


def test_no_light_and_less_than_none_make_no_counts():
    light = torch.tensor([[[[0.0, -1.0]]]], requires_grad=True)
    for sensor in (jl.Sensor(oversampling=2), jl.Sensor(oversampling=2, threshold=2)):
        counts = Sensing(sensor)(light)
        assert counts.tolist() == [[[[0.0, 0.0]]]]
        counts.sum().backward()
    assert light.grad.tolist() == [[[[4.0, 0.0]]]]


@every_sensor
def test_autocast_and_copies_change_nothing(sensor):
    sensing = Sensing(sensor, gradient="expectation")
    expected = sensing(image(torch.float32))
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(sensing(image(torch.float32)), expected)
    assert torch.equal(copy.deepcopy(sensing)(image(torch.float32)), expected)
    assert sensing.state_dict() == {}


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="output: expected one of counts, bits, got 'sums'"):
        Sensing(jl.Sensor(), output="sums")
    with pytest.raises(ValueError, match="gradient: expected one of straight-through, expec"):
        Sensing(jl.Sensor(), gradient="score")
    with pytest.raises(ValueError, match=r"intensities: expected shape .*, got \(3, 4\)"):
        Sensing(jl.Sensor())(torch.zeros(3, 4))
    with pytest.raises(ValueError, match="dark_counts: expected one value per jot"):
        Sensing(SENSORS["maps"])(torch.zeros(1, 1, 2, 2))
    with pytest.raises(ValueError, match="data: expected bits for a smooth kernel"):
        Sensing(SENSORS["cubic"]).log_likelihood(image(), image())


def test_the_bound_of_the_spread_is_what_it_says():
    """The variance of 4000 draws lies within 20 % of its mean but for once in 10^9 times."""
    kurtosis = 3.5  # more than that of any of the binomial variables above
    assert norm.sf(0.2 / np.sqrt((kurtosis - 1) / 4000)) < 1e-9
