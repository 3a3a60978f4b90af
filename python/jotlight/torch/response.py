"""P(q, s) and its logarithms in PyTorch, differentiable in s."""

import math

import torch
from torch import Tensor

from jotlight.sensing.parameters.response import probability_formula

_SERIES_TERMS = 18
"""Number of series terms of P for s < 1; the remainder is below the rounding error."""


def detection_probability(threshold: int, rate: Tensor) -> Tensor:
    """Return P(q, s), the probability that a jot at rate s reports 1: equation (3).

    Its derivative is ∂P/∂s = s^(q - 1) exp(-s) / (q - 1)!.

    Parameters
    ----------
    threshold : int
        q: the number of photons from which on the jot reports 1.
    rate : Tensor
        s: expected detections per frame, 0 or more, of any shape.

    Examples
    --------
    >>> detection_probability(2, torch.tensor([0.0, 1.0])).numpy().round(4).tolist()
    [0.0, 0.26420000195503235]
    """
    return probability_formula(threshold, rate, torch.expm1, _gammainc)


def log_probabilities(threshold: int, rate: Tensor) -> tuple[Tensor, Tensor]:
    """Return log P(q, s) and log(1 - P(q, s)), in double precision for q > 1.

    Double precision is necessary, because P(q, s) of small s underflows in single precision.

    Parameters
    ----------
    threshold : int
        q.
    rate : Tensor
        s: expected detections per frame, above 0, of any shape.

    Examples
    --------
    >>> rate = torch.tensor([1e-30, 1.0])
    >>> [x.numpy().round(4).tolist() for x in log_probabilities(2, rate)]
    [[-138.8483, -1.3309], [0.0, -0.3069]]
    """
    if threshold == 1:
        return torch.log(detection_probability(1, rate)), -rate
    rate = rate.double()
    order = torch.full_like(rate, threshold)
    is_small = rate < 1
    # Each branch gets harmless values where the other one is used, so that no gradient is NaN.
    small, large = torch.where(is_small, rate, 1), torch.where(is_small, 1, rate)
    # P = s^q exp(-s) / q! · (1 + s/(q + 1) + s²/((q + 1)(q + 2)) + ...)
    series = torch.ones_like(small)
    for term in range(_SERIES_TERMS, 0, -1):
        series = 1 + series * small / (threshold + term)
    log_small = threshold * torch.log(small) - small - math.lgamma(threshold + 1)
    log_small = log_small + torch.log(series)
    log_large = torch.log(detection_probability(threshold, large))
    log_complement = torch.log(torch.special.gammaincc(order, rate))
    return torch.where(is_small, log_small, log_large), log_complement


def _gammainc(order: int, x: Tensor) -> Tensor:
    result: Tensor = torch.special.gammainc(torch.full_like(x, order), x)
    return result
