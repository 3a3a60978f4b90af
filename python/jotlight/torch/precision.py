"""Precisions of training, and which of them is the fastest on a machine."""

import time

import torch
from torch import Tensor

from jotlight.networks.network import Network
from jotlight.networks.precision import BF16, F32
from jotlight.torch.distributed import choose_device, thread_limit
from jotlight.torch.network import Network as TorchNetwork

PRECISIONS = {F32: torch.float32, BF16: torch.bfloat16}
"""Data types of the products in filter banks, by precision. All sums and splines are in f32."""

_REPETITIONS = 5
"""Number of measurements of each data type; the fastest counts."""


def filter_dtype_of(network: Network, precision: str) -> torch.dtype:
    """Return the data type of the products of a network in a precision.

    Raises
    ------
    ValueError
        For an unknown precision, and for one that would not change the products of the network.
    """
    network.with_precision(precision)
    return PRECISIONS[precision]


def fastest_precision(
    network: Network,
    *,
    batch: int = 16,
    patch: int = 48,
    device: str | torch.device | None = None,
    threads: int | None = None,
) -> str:
    """Return the `precision` of :func:`jotlight.torch.train` that is the fastest on this machine.

    It times several forward and backward passes. Processors with matrix instructions (AMX) or dot
    products (AVX-512) for bfloat16 are faster with it; most others are not.

    Parameters
    ----------
    network : Network
        Network to train.
    batch, patch, device, threads
        Settings of the training.

    Returns
    -------
    str
        ``"f32"`` or ``"bf16"``. It is ``"f32"`` for a network whose products have no bfloat16, such
        as the network of two layers.

    Examples
    --------
    >>> network = jl.Network.conditional("small", rng=0)
    >>> fastest_precision(network, batch=2, patch=16) in PRECISIONS
    True
    """
    try:
        network.with_precision(BF16)
    except ValueError:
        return F32
    module = TorchNetwork(network).to(choose_device(device))
    parameters = [p for p in module.parameters() if p.requires_grad]
    inputs = 1 if network.tied else network.sensor.frames
    jots = patch * (1 if network.tied else network.sensor.oversampling)
    data = torch.ones((batch, inputs, jots, jots), device=parameters[0].device)
    trials = None if network.trials_range is None else network.trials_range[1]
    seconds = {name: float("inf") for name in PRECISIONS}
    with thread_limit(threads):
        # The first passes, which compile kernels, are slower and never count.
        for _ in range(1 + _REPETITIONS):
            for name, dtype in PRECISIONS.items():
                module.filter_dtype = dtype
                begun = time.perf_counter()
                _pass(module, data, trials)
                seconds[name] = min(seconds[name], time.perf_counter() - begun)
    return min(seconds, key=seconds.__getitem__)


def _pass(module: TorchNetwork, data: Tensor, trials: int | None) -> None:
    """Compute the gradients of a sum of estimates, and wait for the device."""
    module.zero_grad()
    total = module.last_sums(data, trials).sum()
    total.backward()
    total.item()
