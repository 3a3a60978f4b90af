"""P(q, s) and its logarithms in PyTorch."""

import numpy as np
import pytest
from scipy.special import gammainc, gammaincc

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


@pytest.mark.parametrize("threshold", [1, 2, 3, 8, 40])
def test_log_probabilities_are_accurate_in_value_and_slope(threshold):
    s = np.concatenate([np.geomspace(1e-3, 30, 40), [0.999999, 1.0, 1.000001]])
    rate = torch.from_numpy(s).requires_grad_()
    log_one, log_zero = log_probabilities(threshold, rate)
    np.testing.assert_allclose(log_one.detach(), np.log(gammainc(threshold, s)), rtol=1e-8)
    np.testing.assert_allclose(
        log_zero.detach(), np.log(gammaincc(threshold, s)), rtol=1e-8, atol=1e-15
    )
    assert torch.autograd.gradcheck(
        lambda x: log_probabilities(threshold, x)[0], rate[5:].detach().requires_grad_()
    )
    tiny = torch.tensor([1e-12], dtype=torch.float32, requires_grad=True)
    log_probabilities(threshold, tiny)[0].sum().backward()
    # P is nearly s^q / q!
    np.testing.assert_allclose(tiny.grad, threshold / 1e-12, rtol=1e-5)
