"""Training in several processes, as PyTorch's launcher `torchrun` starts them, and its devices."""

import contextlib
import dataclasses
import functools
import itertools
import os
import time
from collections.abc import Iterator
from typing import Any, TypeVar

import torch
import torch.distributed
from torch import Tensor

from jotlight.checks import check_threads

_c10d: Any = torch.distributed
"""Names that the annotations of PyTorch lack."""

Value = TypeVar("Value")

_groups = itertools.count()
"""Numbers of the groups that this process joins."""

_SHUTDOWN_SECONDS = 0.2
"""Pause after the group is destroyed, for its threads to release their tensors."""


@dataclasses.dataclass(frozen=True)
class ProcessGroup:
    """The processes of a run, as one of them sees the group. The default is a single process.

    Examples
    --------
    >>> list(range(8))[ProcessGroup(rank=1, world_size=3).shard]
    [1, 4, 7]
    """

    rank: int = 0
    """Number of this process, from 0."""
    world_size: int = 1
    """Number of processes."""
    handle: Any = None
    """PyTorch's group. None: its default one."""

    @property
    def is_main(self) -> bool:
        """Whether this process reports progress and writes files."""
        return self.rank == 0

    @property
    def shard(self) -> slice:
        """Which patches of a batch belong to this process."""
        return slice(self.rank, None, self.world_size)

    def all_reduce_sum(self, tensor: Tensor) -> None:
        """Replace the tensor by the sum of the tensors of all processes, in place."""
        if self.world_size > 1:
            torch.distributed.all_reduce(tensor, group=self.handle)

    def broadcast(self, tensor: Tensor) -> None:
        """Replace the tensor by that of the main process, in place."""
        if self.world_size > 1:
            torch.distributed.broadcast(tensor, 0, self.handle)

    def shared(self, value: Value) -> Value:
        """Return the main process's value, such as a seed: one drawn at random differs elsewhere.

        Examples
        --------
        >>> ProcessGroup().shared(2**70) == 2**70
        True
        """
        values = [value]
        if self.world_size > 1:
            torch.distributed.broadcast_object_list(values, 0, self.handle)
        return values[0]


def rank() -> int:
    """Return the number of this process in its group; 0 without a launcher.

    The launcher states it before the group exists.
    """
    if _has_default_group():
        return int(torch.distributed.get_rank())
    return int(os.environ.get("RANK", "0"))


def choose_device(device: str | torch.device | None) -> torch.device:
    """Return the device of this process; with several GPUs, each process has its own.

    Parameters
    ----------
    device : str, torch.device, or None
        None: a GPU if there is one, and the CPU otherwise.

    Raises
    ------
    ValueError
        When PyTorch knows no such device, or when it is a GPU and PyTorch finds none.

    Examples
    --------
    >>> choose_device("cpu")
    device(type='cpu')
    """
    if device is None:
        device = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        chosen = torch.device(device)
    except RuntimeError as error:
        raise ValueError(
            f"device: expected 'cpu', 'cuda', or another device of PyTorch, got {device!r}"
        ) from error
    if chosen.type != "cuda":
        return chosen
    if not torch.cuda.is_available():
        raise ValueError("device: expected cpu, since PyTorch finds no GPU, got cuda")
    index = int(os.environ.get("LOCAL_RANK", "0")) if chosen.index is None else chosen.index
    return torch.device("cuda", index)


@contextlib.contextmanager
def process_group(device: torch.device) -> Iterator[ProcessGroup]:
    """Return a context in which this process belongs to a group, if there are several processes.

    The processes are those of PyTorch's default group, which stays as it is, or of the launcher.

    Parameters
    ----------
    device : torch.device
        Device of this process's network, which decides how gradients travel.
    """
    # Gradients are on the network's device, but seeds and flags are on the CPU.
    backend = "cpu:gloo,cuda:nccl" if device.type == "cuda" else "gloo"
    handle = None
    if _has_default_group():
        # The default group may have no backend for one of these devices.
        handle = torch.distributed.new_group(backend=backend)
    elif int(os.environ.get("WORLD_SIZE", "1")) > 1:
        _join(backend)
    else:
        yield ProcessGroup()
        return
    try:
        size = torch.distributed.get_world_size()
        yield ProcessGroup(torch.distributed.get_rank(), size, handle)
    finally:
        torch.distributed.destroy_process_group(handle)
        # Threads of the group still release their last tensors, which takes the interpreter. The
        # process would abort if the interpreter were already shutting down.
        time.sleep(_SHUTDOWN_SECONDS)


def _has_default_group() -> bool:
    return bool(torch.distributed.is_available() and torch.distributed.is_initialized())


def _join(backend: str) -> None:
    """Join the launcher's processes as PyTorch's default group."""
    store, number, size = _rendezvous()
    # The store keeps the addresses of earlier groups, so each group has keys of its own.
    own = _c10d.PrefixStore(f"jotlight {next(_groups)}", store)
    torch.distributed.init_process_group(backend, store=own, rank=number, world_size=size)


@functools.cache
def _rendezvous() -> tuple[Any, int, int]:
    """Return the store of the launcher, the number of this process, and that of processes.

    The process keeps the store, because other processes may still read from it.
    """
    found: tuple[Any, int, int] = next(_c10d.rendezvous("env://"))
    return found


@contextlib.contextmanager
def thread_limit(threads: int | None) -> Iterator[None]:
    """Return a context in which PyTorch uses at most `threads` CPU threads; None: its default.

    Raises
    ------
    TypeError, ValueError
        When `threads` is not a whole number from 1 to 1024.

    Examples
    --------
    >>> with thread_limit(1):
    ...     torch.get_num_threads()
    1
    """
    check_threads(threads)
    before = torch.get_num_threads()
    try:
        if threads is not None:
            torch.set_num_threads(threads)
        yield
    finally:
        torch.set_num_threads(before)
