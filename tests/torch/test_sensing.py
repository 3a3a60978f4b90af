"""The sensor as a PyTorch layer."""

import copy
import re

import numpy as np
import pytest
from scipy.stats import binom, norm

import jotlight as jl
from jotlight.sensing.likelihood.likelihood import Likelihood
from reference import sensing as twin

torch = pytest.importorskip("torch")
from jotlight.torch import Sensing  # noqa: E402

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
def test_probabilities_agree_with_the_twin(sensor, dtype):
    light = image(dtype)
    expected = twin.probability(sensor, light[0, 0].numpy())
    actual = Sensing(sensor).probability(light)
    assert actual.dtype == dtype
    assert actual.shape == (1, 1, *expected.shape)
    tolerance = 1e-5 if dtype == torch.float32 else 2e-7  # maps are float32
    np.testing.assert_allclose(actual[0, 0], expected, rtol=tolerance, atol=1e-9)
    bits = Sensing(sensor, output="bits", gradient="expectation")(light)
    assert bits.shape == (1, sensor.frames, *expected.shape)
    np.testing.assert_allclose(bits[0], [expected] * sensor.frames, rtol=tolerance, atol=1e-9)
    counts = Sensing(sensor, gradient="expectation")(light)
    blocks = expected.reshape(HEIGHT, SIDE, WIDTH, SIDE).sum((1, 3)) * sensor.frames
    np.testing.assert_allclose(counts[0, 0], blocks, rtol=tolerance)


@pytest.mark.parametrize("kernel", ["box", "linear", "quadratic", "cubic"])
@pytest.mark.parametrize("side", [1, 2, 5])
@pytest.mark.parametrize("size", [(1, 1), (2, 7), (9, 3)])
def test_rates_agree_with_the_engine_for_every_kernel(kernel, side, size):
    sensor = jl.Sensor(oversampling=side, kernel=kernel, dark_counts=0.1, efficiency=0.5)
    light = np.random.default_rng(2).random((2, 1, *size))
    rates = Sensing(sensor).rate(torch.from_numpy(light))
    for image, actual in zip(light[:, 0], rates[:, 0], strict=True):
        np.testing.assert_allclose(actual, sensor.rate(image), rtol=1e-6)


@pytest.mark.parametrize("output", ["counts", "bits"])
@pytest.mark.parametrize("name", ["plain", "threshold", "cubic", "maps"])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_random_data_have_the_distribution_of_the_twin(output, name, dtype):
    """A correct layer fails once in 10^9 times, over all pixels and cases together."""
    sensor, number = SENSORS[name], 4000
    light = image()[:1].to(dtype)
    samples = Sensing(sensor, output=output)(
        light.expand(number, -1, -1, -1), torch.Generator().manual_seed(5)
    )
    assert samples.dtype == torch.float32
    ones = samples.double().sum(0).numpy()
    probability = twin.probability(sensor, light[0, 0].double().numpy())
    assert np.isin(samples[:10].numpy(), np.arange(1 + sensor.trials)).all()
    false_alarm = 1e-9 / (16 * ones.size)
    if output == "bits":
        assert samples.max() == 1
        low, high = binom.ppf(
            [[[[false_alarm / 2]]], [[[1 - false_alarm / 2]]]], number, probability
        )
        assert ((low <= ones) & (ones <= high)).all()
        return
    blocks, trials_per_jot = probability.reshape(HEIGHT, SIDE, WIDTH, SIDE), sensor.frames * number
    trials = trials_per_jot * SIDE**2
    if name in ("plain", "threshold"):
        p = blocks.mean((1, 3))
        low, high = binom.ppf([[[false_alarm / 2]], [[1 - false_alarm / 2]]], trials, p)
        assert ((low <= ones[0]) & (ones[0] <= high)).all()
        # The variance is binomial, too; the last test of this file justifies the bound.
        variance = samples.double().var(0)[0].numpy()
        expected = sensor.trials * p * (1 - p)
        assert abs(variance / expected - 1).max() < 0.2
        return
    # Hoeffding's inequality bounds the sum over jots that differ.
    mean = blocks.sum((1, 3)) * trials_per_jot
    bound = np.sqrt(0.5 * trials * np.log(2 / false_alarm))
    assert abs(ones[0] - mean).max() < bound


def test_the_same_generator_state_returns_the_same_data():
    sensing = Sensing(SENSORS["plain"])
    first, again, other = (
        sensing(image(), torch.Generator().manual_seed(seed)) for seed in (3, 3, 4)
    )
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


@every_sensor
@pytest.mark.parametrize("output", ["counts", "bits"])
def test_gradients_of_the_expectation_agree_with_finite_differences(sensor, output):
    sensing = Sensing(sensor, output=output, gradient="expectation")
    light = image(number=2).requires_grad_()
    assert torch.autograd.gradcheck(sensing, light, fast_mode=True)
    assert torch.autograd.gradgradcheck(sensing, light, fast_mode=True)


@every_sensor
@pytest.mark.parametrize("output", ["counts", "bits"])
def test_straight_through_gradients_are_those_of_the_expectation(sensor, output):
    weights = None
    gradients = []
    for gradient in ("straight-through", "expectation"):
        light = image(number=2).requires_grad_()
        data = Sensing(sensor, output=output, gradient=gradient)(light)
        if weights is None:
            weights = torch.randn(data.shape, dtype=data.dtype)
        (weights * data).sum().backward()
        gradients.append(light.grad)
    torch.testing.assert_close(*gradients, rtol=1e-12, atol=0)


@every_sensor
def test_the_likelihood_of_bits_agrees_with_the_engine(sensor):
    sensing = Sensing(sensor, output="bits")
    light = image()
    bits = sensing(light, torch.Generator().manual_seed(1))
    expected = Likelihood(
        bits.sum(1)[0].numpy().astype(int),
        sensor.frames if sensor.mask is None else np.where(sensor.mask, 0, sensor.frames),
        threshold=sensor.threshold,
        efficiency=sensor.efficiency,
        dark_counts=sensor.dark_counts,
    )
    s = sensor.replace(efficiency=1.0, dark_counts=0.0).rate(light[0, 0].numpy())
    np.testing.assert_allclose(sensing.log_likelihood(bits, light), expected.value(s), rtol=1e-6)
    light.requires_grad_()
    assert torch.autograd.gradcheck(
        lambda c: sensing.log_likelihood(bits, c), light, fast_mode=True
    )


@pytest.mark.parametrize("name", ["plain", "threshold"])
def test_the_closed_form_maximizes_the_likelihood_of_counts(name):
    sensor = SENSORS[name].replace(max_intensity=50.0)
    sensing = Sensing(sensor)
    counts = torch.arange(1, sensor.trials).double()[None, None, None]
    best = torch.from_numpy(jl.mle(counts[0, 0].numpy().astype(int), sensor))[None, None].double()
    best.requires_grad_()
    value = sensing.log_likelihood(counts, best)
    (slope,) = torch.autograd.grad(value.sum(), best)
    assert abs(slope * best).max() < 1e-3
    for factor in (0.9, 1.1):
        assert sensing.log_likelihood(counts, factor * best) < value


def test_the_likelihood_and_its_gradient_are_finite_without_light():
    for threshold in (1, 3):
        sensing = Sensing(jl.Sensor(threshold=threshold))
        light = torch.zeros(1, 1, 1, 2, requires_grad=True)
        value = sensing.log_likelihood(torch.tensor([[[[0.0, 1.0]]]]), light)
        value.sum().backward()
        assert torch.isfinite(value).all()
        assert light.grad[..., 0] <= 0 < light.grad[..., 1] < np.inf


@pytest.mark.parametrize("threshold", [1, 2, 100])
def test_the_likelihood_and_its_gradient_are_finite_in_bright_light(threshold):
    sensing = Sensing(jl.Sensor(frames=16, threshold=threshold, max_intensity=1e4))
    light = torch.full((1, 1, 1, 2), 5000.0, requires_grad=True)
    value = sensing.log_likelihood(torch.tensor([[[[16.0, 15.0]]]]), light)
    value.sum().backward()
    assert -5000 <= value < -4000
    assert light.grad[..., 0] == 0
    assert -1 <= light.grad[..., 1] < -0.9


def test_intensities_of_0_and_less_produce_no_counts():
    light = torch.tensor([[[[0.0, -1.0]]]], requires_grad=True)
    for sensor in (jl.Sensor(oversampling=2), jl.Sensor(oversampling=2, threshold=2)):
        counts = Sensing(sensor)(light)
        assert counts.tolist() == [[[[0.0, 0.0]]]]
        counts.sum().backward()
    assert light.grad.tolist() == [[[[4.0, 0.0]]]]


@every_sensor
def test_autocast_and_copies_do_not_change_the_output(sensor):
    sensing = Sensing(sensor, gradient="expectation")
    expected = sensing(image(torch.float32))
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(sensing(image(torch.float32)), expected)
    assert torch.equal(copy.deepcopy(sensing)(image(torch.float32)), expected)
    assert sensing.state_dict() == {}


def test_invalid_arguments_are_refused():
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


@pytest.mark.parametrize("dtype", [torch.uint8, torch.int64, torch.bool, torch.complex64])
def test_intensities_of_an_unknown_scale_are_refused(dtype):
    light = torch.ones((1, 1, HEIGHT, WIDTH), dtype=dtype)
    for method in (Sensing(jl.Sensor()), Sensing(jl.Sensor()).probability):
        with pytest.raises(TypeError, match=f"expected floats in units of intensity, got {dtype}"):
            method(light)


@pytest.mark.parametrize("output", ["counts", "bits"])
def test_gray_levels_are_reported(output):
    sensing = Sensing(jl.Sensor(frames=4), output=output)
    levels = torch.arange(256.0).reshape(1, 1, 16, 16)
    with pytest.warns(jl.JotlightWarning, match=r"whole numbers up to 255; .* intensities / 255"):
        sensing(levels)
    sensing(levels / 255)
    sensing(levels.requires_grad_())


@pytest.mark.parametrize(
    ("shape", "convert"),
    [
        ((5, 6), lambda intensities: intensities[None, None]),
        ((2, 5, 6), lambda intensities: intensities[:, None]),
        ((2, 3, 5, 6), lambda intensities: intensities.flatten(0, 1)[:, None]),
    ],
)
def test_the_message_about_a_shape_says_how_to_convert_it(shape, convert):
    sensing, intensities = Sensing(jl.Sensor(frames=4)), torch.rand(shape)
    with pytest.raises(ValueError, match=r"got \(.*\); .* write intensities") as caught:
        sensing(intensities)
    code = str(caught.value).partition(" write ")[2]
    converted = eval(code, {"intensities": intensities})
    assert torch.equal(converted, convert(intensities))
    assert sensing(converted).shape == converted.shape


@pytest.mark.parametrize("output", ["counts", "bits"])
def test_the_likelihood_refuses_data_of_another_shape(output):
    """PyTorch would repeat them, and the sum would be wrong."""
    sensing = Sensing(jl.Sensor(frames=4), output=output)
    light = torch.rand((3, 1, 5, 6))
    data = sensing(light)
    for wrong in (data[:2], data[0, 0], data[:, :, :1], data[..., :1], data[:, :, :, None]):
        with pytest.raises(ValueError, match=rf"data: expected {output} of shape .*, got \("):
            sensing.log_likelihood(wrong, light)


def test_the_likelihood_takes_several_images_of_one_capture_and_the_reverse():
    sensing, light = Sensing(jl.Sensor(frames=4)), torch.rand((3, 1, 5, 6))
    data = sensing(light)
    expected = [float(sensing.log_likelihood(data[:1], each[None])) for each in light]
    assert sensing.log_likelihood(data[:1], light).tolist() == pytest.approx(expected)
    expected = [float(sensing.log_likelihood(each[None], light[:1])) for each in data]
    assert sensing.log_likelihood(data, light[:1]).tolist() == pytest.approx(expected)


def test_a_layer_prints_its_arguments():
    expected = "Sensing(Sensor(frames=4), output='counts', gradient='straight-through')"
    assert repr(Sensing(jl.Sensor(frames=4))) == expected


@pytest.mark.parametrize(
    "options", [{"gain": [1.0, 2.0, 3.0]}, {"threshold": [1, 2, 3]}, {"bit_depth": 4}]
)
def test_other_sensors_are_referred_to_the_function_that_simulates_them(options):
    sensor = jl.Sensor(frames=3, **options)
    with pytest.raises(ValueError, match=r"; jotlight\.Sensor\.expose simulates such a sensor"):
        Sensing(sensor)
    assert len(sensor.expose(np.full((4, 5), 0.5))) == 3


def test_other_types_are_refused():
    with pytest.raises(TypeError, match=r"sensor: expected a jotlight\.Sensor, .*got 8"):
        Sensing(8)
    array = np.full((HEIGHT, WIDTH), 0.5)
    message = r"got ndarray; pass (torch.*) for an image \(H, W\)"
    with pytest.raises(TypeError, match=message) as error:
        Sensing(jl.Sensor())(array)
    call = re.search(message, str(error.value))[1]
    converted = eval(call, {"torch": torch, "image": array})
    assert Sensing(jl.Sensor())(converted).shape == (1, 1, HEIGHT, WIDTH)


def test_the_bound_on_the_variance_fails_less_than_once_in_10_to_the_9():
    """The variance of 4000 samples is within 20 % of its mean, except once in 10^9 times."""
    kurtosis = 3.5  # above that of every binomial variable in this file
    assert norm.sf(0.2 / np.sqrt((kurtosis - 1) / 4000)) < 1e-9


def test_data_out_of_range_are_refused():
    counts = torch.full((1, 1, 4, 4), 9)
    sensing = Sensing(jl.Sensor(frames=8))
    with pytest.raises(ValueError, match="data: expected counts from 0 to 8, got 9 to 9"):
        sensing.log_likelihood(counts, torch.full((1, 1, 4, 4), 0.5))
    bits = torch.full((1, 8, 4, 4), -1.0)
    sensing = Sensing(jl.Sensor(frames=8), output="bits")
    with pytest.raises(ValueError, match="data: expected bits from 0 to 1, got -1"):
        sensing.log_likelihood(bits, torch.full((1, 1, 4, 4), 0.5))


@pytest.mark.parametrize("name", ["uint8", "uint16", "int64", "float16"])
def test_the_likelihood_takes_counts_of_any_type(name):
    sensing = Sensing(jl.Sensor(frames=4000))
    counts, image = torch.tensor([[[[0, 3, 200]]]]), torch.tensor([[[[0.1, 0.2, 0.3]]]])
    found = sensing.log_likelihood(counts.to(getattr(torch, name)), image)
    assert torch.equal(found, sensing.log_likelihood(counts.float(), image))
