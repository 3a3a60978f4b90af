"""The optimizers of the training with PyTorch, by name."""

from collections.abc import Callable
from functools import partial

from torch.optim import Adam

from jotlight.torch.muon import BETAS, Muon

OPTIMIZERS: dict[str, Callable[..., Adam]] = {"muon": Muon, "adam": partial(Adam, betas=BETAS)}
"""Functions of the parameters and of the learning rate, which return an optimizer."""
