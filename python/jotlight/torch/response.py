"""P(q, s) and its logarithms, differentiable in s, in operations of PyTorch alone."""

import math

import torch
from torch import Tensor

from jotlight.sensing.response import probability_formula

_TERMS = 18
"""Of the series of P below s = 1, where the rest is less than the rounding."""


def detection_probability(threshold: int, rate: Tensor) -> Tensor:
    """P(q, s) of jots that detect s photons per frame in the mean, s of 0 or more.

    Its derivative is ∂P/∂s = s^(q - 1) exp(-s) / (q - 1)!.

    Examples
    --------
    >>> detection_probability(2, torch.tensor([0.0, 1.0])).numpy().round(4).tolist()
    [0.0, 0.26420000195503235]
    """
    return probability_formula(threshold, rate, torch.expm1, _gammainc)


def logarithms(threshold: int, rate: Tensor) -> tuple[Tensor, Tensor]:
    """The logarithms of P(q, s) and 1 - P(q, s), s above 0; beyond q = 1 in double precision.

    Examples
    --------
    >>> rate = torch.tensor([1e-30, 1.0])
    >>> [x.numpy().round(4).tolist() for x in logarithms(2, rate)]
    [[-138.8483, -1.3309], [0.0, -0.3069]]
    """
    if threshold == 1:
        return torch.log(detection_probability(1, rate)), -rate
    rate = rate.double()
    order = torch.full_like(rate, threshold)
    below = rate < 1
    small, large = torch.where(below, rate, 1), torch.where(below, 1, rate)
    # P = s^q exp(-s) / q! · (1 + s/(q + 1) + s²/((q + 1)(q + 2)) + ...)
    series = torch.ones_like(small)
    for term in range(_TERMS, 0, -1):
        series = 1 + series * small / (threshold + term)
    near = threshold * torch.log(small) - small - math.lgamma(threshold + 1) + torch.log(series)
    far = torch.log(detection_probability(threshold, large))
    rests = torch.log(torch.special.gammaincc(order, rate))
    return torch.where(below, near, far), rests


def _gammainc(order: int, x: Tensor) -> Tensor:
    result: Tensor = torch.special.gammainc(torch.full_like(x, order), x)
    return result
