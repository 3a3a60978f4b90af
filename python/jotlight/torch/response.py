"""P(q, s) and its logarithms in PyTorch, differentiable in s."""

import math
from typing import Any

import torch
from torch import Tensor

from jotlight.sensing.parameters.response import probability_formula

_TINY = 1e-280
"""Probabilities below it are near the underflow."""


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

    Both and their derivatives are finite where the probabilities themselves underflow.

    Parameters
    ----------
    threshold : int
        q.
    rate : Tensor
        s: expected detections per frame, above 0, of any shape.

    Examples
    --------
    >>> rate = torch.tensor([1e-30, 1.0, 900.0])
    >>> [x.numpy().round(4).tolist() for x in log_probabilities(2, rate)]
    [[-138.8483, -1.3309, -0.0], [-0.0, -0.3069, -893.1965]]
    """
    if threshold == 1:
        return torch.log(detection_probability(1, rate)), -rate
    logarithms: tuple[Tensor, Tensor] = _LogProbabilities.apply(rate.double(), threshold)
    return logarithms


class _LogProbabilities(torch.autograd.Function):
    """log P(q, s) and log(1 - P(q, s)), with derivatives of any order."""

    generate_vmap_rule = True

    @staticmethod
    def forward(rate: Tensor, threshold: int) -> tuple[Tensor, Tensor]:
        order = torch.full_like(rate, threshold)
        one, zero = torch.special.gammainc(order, rate), torch.special.gammaincc(order, rate)
        # P(Y = q) for Y ~ Poisson(s)
        log_mass = threshold * torch.log(rate) - rate - math.lgamma(threshold + 1)
        log_upper = log_mass + torch.log(_upper_sum(threshold, rate))
        log_lower = log_mass + torch.log(_lower_sum(threshold, rate))
        return _logarithm(one, zero, log_upper), _logarithm(zero, one, log_lower)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, int], output: tuple[Tensor, Tensor]) -> None:
        rate, ctx.threshold = inputs
        ctx.save_for_backward(rate, *output)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        rate, log_one, log_zero = ctx.saved_tensors
        q = ctx.threshold
        # ∂P/∂s = s^(q - 1) exp(-s) / (q - 1)!
        log_density = (q - 1) * torch.log(rate) - rate - math.lgamma(q)
        one, zero = gradients
        return one * torch.exp(log_density - log_one) - zero * torch.exp(
            log_density - log_zero
        ), None


def _logarithm(probability: Tensor, complement: Tensor, log_tail: Tensor) -> Tensor:
    """Return log p from p, 1 - p, and log p where p underflows."""
    logarithm = torch.where(probability < 0.5, torch.log(probability), torch.log1p(-complement))
    return torch.where(probability < _TINY, log_tail, logarithm)


def _upper_sum(threshold: int, rate: Tensor) -> Tensor:
    """Return P(Y ≥ q) / P(Y = q) = 1 + s/(q + 1) + s²/((q + 1)(q + 2)) + ... for tiny P(Y ≥ q)."""
    total = torch.ones_like(rate)
    for term in range(_number_of_terms(threshold), 0, -1):
        total = 1 + total * rate / (threshold + term)
    return total


def _lower_sum(threshold: int, rate: Tensor) -> Tensor:
    """Return P(Y < q) / P(Y = q) = q/s + q(q - 1)/s² + ... for tiny P(Y < q)."""
    total = torch.zeros_like(rate)
    for factor in range(threshold - _number_of_terms(threshold) + 1, threshold + 1):
        total = (1 + total) * factor / rate
    return total


def _number_of_terms(threshold: int) -> int:
    """Return how many terms the sums need where a probability is below 10⁻²⁸⁰.

    The rate is so far from q that each term is at most exp(-36/√q) times the one before it.
    """
    return min(threshold, 10 + math.ceil(1.2 * math.sqrt(threshold)))


def _gammainc(order: int, x: Tensor) -> Tensor:
    # The derivative in single precision has few digits for large q.
    result: Tensor = torch.special.gammainc(
        torch.full_like(x, order, dtype=torch.float64), x.double()
    )
    return result.to(x.dtype)
