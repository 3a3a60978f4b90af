"""Several processes that learn together, as PyTorch's launcher `torchrun` starts them."""

import contextlib
import dataclasses
import os
import time
from collections.abc import Iterator

import torch
import torch.distributed as group
from torch import Tensor

from jotlight.checks import whole_number

_LETTING_GO = 0.2
"""Seconds."""


@dataclasses.dataclass(frozen=True)
class Processes:
    """One process among those that learn together."""

    rank: int = 0
    number: int = 1

    @property
    def first(self) -> bool:
        """Whether this is the one that tells and writes."""
        return self.rank == 0

    @property
    def share(self) -> slice:
        """Which patches of a step are its own."""
        return slice(self.rank, None, self.number)

    def sum(self, tensor: Tensor) -> None:
        """Add the tensors of all processes, in place."""
        if self.number > 1:
            group.all_reduce(tensor)

    def spread(self, tensor: Tensor) -> None:
        """Give all processes the tensor of the first, in place."""
        if self.number > 1:
            group.broadcast(tensor, 0)


def rank() -> int:
    """Give the number of this process among those that the launcher started; 0 without one."""
    return int(os.environ.get("RANK", "0"))


def place(device: str | torch.device | None) -> torch.device:
    """Give the device of this process: of several GPUs each process has its own.

    Raises
    ------
    ValueError
        When it is a GPU, and there is none.
    """
    found = torch.device(device or ("cuda" if torch.cuda.is_available() else "cpu"))
    if found.type != "cuda":
        return found
    if not torch.cuda.is_available():
        raise ValueError("device: expected cpu, since PyTorch finds no GPU, got cuda")
    own = int(os.environ.get("LOCAL_RANK", "0")) if found.index is None else found.index
    return torch.device("cuda", own)


@contextlib.contextmanager
def together(device: torch.device) -> Iterator[Processes]:
    """Join the processes that the launcher started, if it did."""
    if int(os.environ.get("WORLD_SIZE", "1")) == 1:
        yield Processes()
        return
    # Numbers about the run are on the CPU, gradients where the network is.
    group.init_process_group("cpu:gloo,cuda:nccl" if device.type == "cuda" else "gloo")
    try:
        yield Processes(group.get_rank(), group.get_world_size())
    finally:
        group.destroy_process_group()
        # Its threads still let go of the last tensors, for which they need the interpreter: were it
        # on its way out by then, the process would be aborted.
        time.sleep(_LETTING_GO)


@contextlib.contextmanager
def with_threads(number: int | None) -> Iterator[None]:
    """Let PyTorch use so many threads of the CPU, or as many as it does, while the block runs."""
    before = torch.get_num_threads()
    try:
        if number is not None:
            torch.set_num_threads(whole_number("threads", number, 1))
        yield
    finally:
        torch.set_num_threads(before)
