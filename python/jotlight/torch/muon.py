"""Muon: an optimizer that changes filter banks by orthogonal matrices, and the rest by Adam."""

from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor, nn

MIN_CHANNELS = 5
"""Smallest number of input and of output channels of a filter bank that takes Muon's steps."""

_MOMENTUM = 0.95
"""Decay of the sum of the gradients of filter banks."""

BETAS = (0.9, 0.99)
"""Decays of the means of gradients and of their squares, of Adam."""

_ADAM_RMS = 0.2
"""Usual root mean square of a change of Adam, relative to the learning rate."""

_ITERATIONS, _NEWTON_SCHULZ = 5, (3.4445, -4.7750, 2.0315)
"""Number of steps, and coefficients of x, x³, and x⁵, that bring singular values close to 1."""


class Muon(torch.optim.Adam):
    """An optimizer for networks of filter banks.

    A bank of filters is a matrix with a row for each output channel. Adam changes each number by
    itself, so the strongest directions of the gradient dominate. Muon adds up the gradients with
    decaying weights, and changes the bank by the orthogonal matrix that is closest to this sum. So
    all directions change equally. Banks with fewer than five input or output channels, splines, and
    all other parameters take the steps of Adam. Both kinds of steps have about the same size, so
    one learning rate serves both.

    A parameter with five axes holds a bank for each parameter set of a K-conditioned network. Sets
    with smaller gradients than others take smaller steps: in proportion to the root of the norm.

    Source: K. Jordan et al., "Muon: an optimizer for hidden layers in neural networks", 2024. The
    size of the steps is that of J. Liu et al., "Muon is scalable for LLM training", 2025.

    Parameters
    ----------
    params : iterable of nn.Parameter or dict
        Parameters of a network, or groups of them that differ in `lr`.
    lr : float
        Learning rate: about the largest change of a number per step.

    Raises
    ------
    ValueError
        When a group has other options, which banks would ignore.

    Examples
    --------
    >>> bank = nn.Parameter(torch.zeros(8, 8, 3, 3))
    >>> optimizer = Muon([bank], lr=0.01)
    >>> (bank * torch.randn(8, 8, 3, 3)).sum().backward()
    >>> optimizer.step()
    >>> round(float(bank.detach().square().mean().sqrt()), 3)
    0.002
    """

    def __init__(
        self, params: Iterable[nn.Parameter] | Iterable[dict[str, Any]], lr: float = 3e-3
    ) -> None:
        super().__init__(params, lr=lr, betas=BETAS)
        for group in self.param_groups:
            for name, value in self.defaults.items():
                if name != "lr" and group[name] != value:
                    raise ValueError(
                        f"{name}: expected groups that differ in lr alone, got {group[name]}"
                    )

    def step(self, closure: Any = None) -> Any:
        """Return the loss of the closure, if there is one, after a change of all parameters."""
        loss = None
        if closure is not None:
            with torch.enable_grad():
                loss = closure()
        with torch.no_grad():
            self._step_all()
        return loss

    def _step_all(self) -> None:
        """Change all parameters."""
        gradients = {}
        try:
            for group in self.param_groups:
                for parameter in filter(is_bank, group["params"]):
                    if parameter.grad is not None:
                        self._step_bank(parameter, group["lr"])
                        gradients[parameter], parameter.grad = parameter.grad, None
            super().step()
        finally:
            for parameter, gradient in gradients.items():
                parameter.grad = gradient

    def _step_bank(self, bank: Tensor, learning_rate: float) -> None:
        """Change a filter bank."""
        state = self.state[bank]
        if not state:
            # Checkpoints hold the same vectors for all parameters.
            state["step"] = torch.zeros(())
            state["exp_avg"], state["exp_avg_sq"] = (torch.zeros_like(bank) for _ in range(2))
        state["step"] += 1
        total = state["exp_avg"]
        total.mul_(_MOMENTUM).add_(bank.grad)
        matrices = (bank.grad + _MOMENTUM * total).flatten(-3)
        size = _ADAM_RMS * max(matrices.shape[-2:]) ** 0.5
        change = orthogonalize(matrices) * _relative_sizes(matrices)
        bank.add_(change.view_as(bank), alpha=-learning_rate * size)


def is_bank(parameter: Tensor) -> bool:
    """Return whether a parameter is a filter bank with enough channels, with or without sets."""
    return bool(parameter.dim() >= 4 and min(parameter.shape[-4:-2]) >= MIN_CHANNELS)


def _relative_sizes(matrices: Tensor) -> Tensor:
    """Return the root of the norm of each matrix, relative to the largest one, (…, 1, 1).

    Without it, a parameter set whose K is no longer drawn would move on along its last gradients.
    """
    norms = matrices.norm(dim=(-2, -1), keepdim=True)
    sizes: Tensor = (norms / norms.max().clamp(min=1e-30)).sqrt()
    return sizes


def orthogonalize(matrices: Tensor) -> Tensor:
    """Return matrices with nearly the same singular vectors, and other singular values.

    Most of the values become 0.7 to 1.2. Those that are far below the largest one remain smaller,
    and a matrix of zeros remains one.

    Parameters
    ----------
    matrices : Tensor, shape (…, M, N)
        Matrices.

    Examples
    --------
    >>> found = orthogonalize(torch.diag(torch.tensor([3.0, -1.0])))
    >>> bool((found.diagonal().abs() - 1).abs().max() < 0.35)
    True
    """
    is_tall = matrices.shape[-2] > matrices.shape[-1]
    x = matrices.mT if is_tall else matrices
    # Divided by the largest number first: the squares of small ones would underflow in the norm.
    x = x / x.abs().amax((-2, -1), keepdim=True).clamp(min=1e-30)
    x = x / x.norm(dim=(-2, -1), keepdim=True).clamp(min=1e-30)
    a, b, c = _NEWTON_SCHULZ
    for _ in range(_ITERATIONS):
        products = x @ x.mT
        x = a * x + (b * products + c * products @ products) @ x
    found: Tensor = x.mT if is_tall else x
    return found
