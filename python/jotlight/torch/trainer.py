"""The training loop: steps of an optimizer, their records, and checkpoints."""

import contextlib
import math
import os
import time
from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from jotlight.array_types import Array
from jotlight.torch.distributed import ProcessGroup
from jotlight.torch.network import Network as TorchNetwork
from jotlight.torch.optimizers import OPTIMIZERS
from jotlight.training.checkpoint import Checkpoint, CheckpointWriter
from jotlight.training.history import History, Record
from jotlight.training.optimizer_protocol import State
from jotlight.training.reporting import StepReport

_MAX_GRADIENT_NORM = 0.1
"""Norm to which larger gradients are clipped."""

_WARMUP = 0.1
"""Fraction of the steps over which the learning rate rises."""

_INITIAL_RATE = 0.04
"""First learning rate, as a fraction of the largest."""

_TESTS = 20
"""Approximate number of tests per run."""


class Trainer:
    """A run of an optimizer: the parameters, the state of the optimizer, and the records so far.

    A subclass defines the cost, :meth:`loss`, and what each step records, :meth:`record`.

    Parameters
    ----------
    module : jotlight.torch.Network
        Network to train, in place.
    settings : dict
        Settings that identify the run in a checkpoint. JSON can hold them.
    learning_rate : float
        Largest learning rate: about the largest change of a parameter per step.
    group : ProcessGroup
        Processes that train together.
    optimizer : str
        A name in :data:`jotlight.torch.optimizers.OPTIMIZERS`.
    """

    state_names: tuple[str, ...] = ("exp_avg", "exp_avg_sq")
    """Names of the vectors in :meth:`state`, each as long as the vector of parameters."""

    def __init__(
        self,
        module: TorchNetwork,
        settings: dict[str, object],
        learning_rate: float,
        group: ProcessGroup,
        optimizer: str = "adam",
    ) -> None:
        self.module, self.settings = module, settings
        self.learning_rate, self.group = learning_rate, group
        self.parameters = [p for p in module.parameters() if p.requires_grad]
        if not self.parameters:
            raise ValueError(
                'network: expected trainable parameters, got layers with trainable="nothing" only; '
                'set trainable="all" of some, as by dataclasses.replace(layer, trainable="all")'
            )
        self.optimizer = OPTIMIZERS[optimizer](self.parameters, lr=learning_rate)
        self.history = History()
        # True while parameters and records do not match; an interrupt may come in between.
        self._is_updating = False

    def loss(self, step: int) -> Tensor:
        """Return this process's part of the cost; the cost is the sum over the processes."""
        raise NotImplementedError

    def record(self, step: int, loss: float, gradient_norm: float, *, is_test: bool) -> Record:
        """Return the record of a step, with a test of the parameters if `is_test`."""
        raise NotImplementedError

    def begin(self, checkpoint: str | os.PathLike[str] | None, resume: bool) -> None:
        """Continue from the checkpoint, or check that the run may write it.

        Raises
        ------
        OSError, ValueError
            When there is no checkpoint to resume from, when it is damaged or belongs to another
            run, or when another file would be overwritten.
        """
        if resume:
            self.restore(Checkpoint.load(checkpoint, self.settings), str(checkpoint))
        elif checkpoint is not None:
            Checkpoint.refuse_overwrite(checkpoint)

    def run(
        self,
        steps: int,
        checkpoint: str | os.PathLike[str] | None,
        report: StepReport,
        seconds: float | None = None,
    ) -> None:
        """Take the remaining steps, until the time is up or `report` ends the run.

        Parameters
        ----------
        steps : int
            Number of steps of the whole run.
        checkpoint : path, optional
            File that the main process writes after the first step, every 20 seconds, and when the
            run ends or stops.
        report : callable
            Function that gets the :class:`Record` of each step, in the main process, and returns
            whether the run goes on.
        seconds : float, optional
            Time limit. The run stops before the step that would exceed it, but takes one step.
            Default: none.
        """
        # The first checkpoint shows a full disk before hours of work.
        begun, saved, longest = time.monotonic(), -math.inf, 0.0
        limit = math.inf if seconds is None else seconds
        path = checkpoint if self.group.is_main else None
        is_stopped = False
        try:
            while len(self.history) < steps:
                now = time.monotonic()
                # Reserve time for the next step and for the measurement of its result.
                is_late = longest > 0 and now - begun + 2 * longest > limit
                if self._is_over(is_late or is_stopped):
                    break
                record = self.step(len(self.history), steps)
                if path is not None and now - saved > CheckpointWriter.INTERVAL:
                    self._save(path)
                    saved = now
                if self.group.is_main:
                    is_stopped = not report(record)
                longest = max(longest, time.monotonic() - now)
        finally:
            # Also after Ctrl-C or an error.
            if path is not None:
                self._save(path)

    def step(self, step: int, steps: int) -> Record:
        """Take one step and return its record. `steps` is the number of steps of the run."""
        record = self.measure(step, is_test=step % max(1, steps // _TESTS) == 0)
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate * _schedule(step / steps)
        self._is_updating = True
        self.update()
        self.history.records.append(record)
        self._is_updating = False
        return record

    def update(self) -> None:
        """Change the parameters by one step of the optimizer."""
        self.optimizer.step()

    def measure(self, step: int, *, is_test: bool) -> Record:
        """Compute the cost and its gradient and return their record.

        Raises
        ------
        FloatingPointError
            When they are not finite.
        """
        self.optimizer.zero_grad()
        loss = self.loss(step)
        loss.backward()
        total = self._reduce(loss.detach())
        norm = float(nn.utils.clip_grad_norm_(self.parameters, _MAX_GRADIENT_NORM))
        if not (math.isfinite(total) and math.isfinite(norm)):
            raise FloatingPointError(
                f"step {step}: the run reached infinity or NaN (cost {total:.4g}, gradient norm "
                f"{norm:.4g}); lower the learning rate, now {self.learning_rate:g}"
            )
        return self.record(step, total, norm, is_test=is_test)

    def parameter_vector(self) -> Array:
        """Return all trainable parameters as one vector."""
        return flatten(self.parameters)

    def set_parameters(self, vector: Array) -> None:
        """Set all trainable parameters."""
        with torch.no_grad():
            for parameter, values in zip(self.parameters, self.split(vector), strict=True):
                parameter.copy_(values)

    def state(self) -> State:
        """Return what the next step needs besides parameters and records."""
        return {
            name: flatten([self.optimizer.state[p][name] for p in self.parameters])
            for name in Trainer.state_names
        }

    def checkpoint(self) -> Checkpoint:
        """Return the state of the run between two steps."""
        history = History(list(self.history.records))
        return Checkpoint(self.settings, self.parameter_vector(), self.state(), history)

    def restore(self, checkpoint: Checkpoint, path: str | os.PathLike[str]) -> None:
        """Continue from a checkpoint; `path` is for the error message.

        Raises
        ------
        ValueError
            When it does not fit the network.
        """
        if missing := sorted(set(self.state_names) - set(checkpoint.state)):
            raise ValueError(
                f"{path}: damaged checkpoint: it has no state.{missing[0]}; start again with "
                "resume=False (--restart)"
            )
        shape = (sum(p.numel() for p in self.parameters),)
        vectors = [checkpoint.vector, *checkpoint.state.values()]
        if any(vector.shape != shape for vector in vectors):
            raise ValueError(f"{path}: damaged checkpoint: it does not fit the network")
        self.set_parameters(checkpoint.vector)
        moments = {name: self.split(checkpoint.state[name]) for name in Trainer.state_names}
        for number, parameter in enumerate(self.parameters):
            step = torch.tensor(float(len(checkpoint.history)))
            own = {name: parts[number] for name, parts in moments.items()}
            self.optimizer.state[parameter] = {"step": step, **own}
        self.history = History(list(checkpoint.history.records))

    def _save(self, path: str | os.PathLike[str]) -> None:
        """Write a checkpoint between two steps; within a step, the last one stays."""
        if not self._is_updating and len(self.history):
            self.checkpoint().save(path)

    def _is_over(self, is_over: bool) -> bool:
        """Return whether the main process ends the run."""
        flag = torch.tensor(float(is_over))
        self.group.broadcast(flag)
        return bool(flag)

    def _reduce(self, loss: Tensor) -> float:
        """Add the gradients and losses of all processes and return the cost."""
        gradients = [p.grad if p.grad is not None else torch.zeros_like(p) for p in self.parameters]
        flat = torch.cat([loss.view(1), *(gradient.flatten() for gradient in gradients)])
        self.group.all_reduce_sum(flat)
        start = 1
        for parameter in self.parameters:
            part = flat[start : start + parameter.numel()]
            parameter.grad = part.view_as(parameter).clone()
            start += parameter.numel()
        return float(flat[0])

    def split(self, vector: Array) -> list[Tensor]:
        """Return each parameter's part of a vector."""
        sizes = [p.numel() for p in self.parameters]
        parts = torch.from_numpy(vector).split(sizes)
        return [part.to(p).view_as(p) for part, p in zip(parts, self.parameters, strict=True)]


@contextlib.contextmanager
def recorded_gradients() -> Iterator[None]:
    """Return a context that records gradients, also in torch.no_grad and torch.inference_mode.

    Examples
    --------
    >>> with torch.no_grad(), recorded_gradients():
    ...     torch.is_grad_enabled()
    True
    """
    with torch.inference_mode(False), torch.enable_grad():
        yield


def _schedule(progress: float) -> float:
    """Return the learning rate as a fraction of the largest: a rise, then half a cosine to 0."""
    if progress < _WARMUP:
        return _INITIAL_RATE + (1 - _INITIAL_RATE) * progress / _WARMUP
    return 0.5 * (1 + math.cos(math.pi * (progress - _WARMUP) / (1 - _WARMUP)))


def flatten(tensors: Sequence[Tensor]) -> Array:
    """Return the values of all tensors as one vector."""
    return np.asarray(torch.cat([x.detach().flatten() for x in tensors]).cpu(), np.float64)
