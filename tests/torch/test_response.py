"""P(q, s) and its logarithms in PyTorch."""

import numpy as np
import pytest
from scipy.special import gammainc, gammaincc

from jotlight import Likelihood

torch = pytest.importorskip("torch")
from jotlight.torch.response import detection_probability, log_probabilities  # noqa: E402


@pytest.mark.parametrize("threshold", [1, 2, 3, 8])
def test_probabilities_have_the_right_slope_without_light_and_at_saturation(threshold):
    rate = torch.tensor([0.0, 1e-8, 1.0, 500.0], dtype=torch.float64, requires_grad=True)
    probability = detection_probability(threshold, rate)
    probability.sum().backward()
    s = rate.detach().numpy()
    np.testing.assert_allclose(probability.detach(), gammainc(threshold, s), rtol=1e-12)
    slope = np.exp(-s) * s ** (threshold - 1) / np.prod(np.arange(1, threshold))
    np.testing.assert_allclose(rate.grad, slope, rtol=1e-12, atol=1e-16)


@pytest.mark.parametrize("threshold", [2, 100, 10_000])
def test_slopes_have_the_digits_of_single_precision(threshold):
    rate = torch.tensor([0.8, 1.0, 1.2]) * threshold
    slopes = []
    for rates in (rate, rate.double()):
        rates.requires_grad_()
        detection_probability(threshold, rates).sum().backward()
        slopes.append(rates.grad.double())
    torch.testing.assert_close(*slopes, rtol=2e-7, atol=1e-45)


@pytest.mark.parametrize("threshold", [2, 3, 8, 40, 1000, 65_535])
@pytest.mark.parametrize("reading", [0, 1])
def test_logarithms_and_slopes_are_those_of_the_engine_even_if_probabilities_underflow(
    threshold, reading
):
    factors = [1e-20, 1e-9, 0.01, 0.3, 0.8, 0.99, 1, 1.01, 1.2, 3, 40, 800]
    s = threshold * np.array(factors)
    likelihood = Likelihood(np.full(s.shape, reading), 1, threshold=threshold)
    values = likelihood.values(s)
    rate = torch.from_numpy(s).requires_grad_()
    logarithms = log_probabilities(threshold, rate)[1 - reading]
    np.testing.assert_allclose(logarithms.detach(), values, rtol=1e-8, atol=1e-300)
    (slope,) = torch.autograd.grad(logarithms.sum(), rate, create_graph=True)
    expected, curvature = likelihood.gradient_and_curvature(s)
    np.testing.assert_allclose(slope.detach(), expected, rtol=1e-7, atol=1e-300)
    (second,) = torch.autograd.grad(slope.sum(), rate)
    np.testing.assert_allclose(second, -curvature, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("threshold", [1, 2, 3, 8, 40])
def test_log_probabilities_are_accurate_in_value_and_slope(threshold):
    s = np.concatenate([np.geomspace(1e-3, 30, 40), [0.999999, 1.0, 1.000001]])
    rate = torch.from_numpy(s).requires_grad_()
    log_one, log_zero = log_probabilities(threshold, rate)
    one, zero = gammainc(threshold, s), gammaincc(threshold, s)
    expected = np.log(one)
    if threshold > 1:  # all digits near P = 1, too
        expected = np.where(one < 0.5, expected, np.log1p(-np.minimum(zero, 0.5)))
    np.testing.assert_allclose(log_one.detach(), expected, rtol=1e-8)
    np.testing.assert_allclose(log_zero.detach(), np.log(zero), rtol=1e-8, atol=1e-15)
    assert torch.autograd.gradcheck(
        lambda x: log_probabilities(threshold, x)[0], rate[5:].detach().requires_grad_()
    )
    tiny = torch.tensor([1e-12], dtype=torch.float32, requires_grad=True)
    log_probabilities(threshold, tiny)[0].sum().backward()
    # P is nearly s^q / q!
    np.testing.assert_allclose(tiny.grad, threshold / 1e-12, rtol=1e-5)
