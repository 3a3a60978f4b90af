"""The trainer of a run: steps of Adam, what is remembered between them, and where it is kept."""

import math
import os
import time
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor, nn

from jotlight.torch.distributed import Processes
from jotlight.torch.network import Network
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import History, Record
from jotlight.training.optimizer import State
from jotlight.training.parameters import Vector

_CLIP = 0.1
"""The largest norm of a gradient that is followed as it is."""
_WARM = 0.1
"""The share of the steps over which the rate rises."""
_LOOKS = 20
"""How often a run is tested, about."""
_SAVE_EVERY = 20.0
"""Seconds between two checkpoints."""


class Trainer:
    """A run of Adam: the parameters, what the optimizer remembers, and the records so far.

    What is learned from is said by `loss`, what it is tested on by `test`.

    Parameters
    ----------
    module : Network
        Whose parameters learn, where they begin.
    run : dict
        What the run is, its `steps` among it; JSON can hold it.
    rate : float
        The largest step of a parameter, about.
    processes : Processes
        Those that learn together.
    """

    remembers: tuple[str, ...] = ("exp_avg", "exp_avg_sq")
    """The vectors of :meth:`state`, each as long as that of the parameters."""

    def __init__(
        self, module: Network, run: dict[str, object], rate: float, processes: Processes
    ) -> None:
        self.module, self.settings, self.rate, self.processes = module, run, rate, processes
        self.parameters = [p for p in module.parameters() if p.requires_grad]
        self.optimizer = torch.optim.Adam(self.parameters, lr=rate, betas=(0.9, 0.99))
        self.history = History()
        self.walking = False
        """Whether parameters and records do not belong together just now."""

    def loss(self, step: int) -> Tensor:
        """Give this process's part of the cost on what a step draws; those of all add up."""
        raise NotImplementedError

    def record(self, step: int, cost: float, norm: float, *, tested: bool) -> Record:
        """Give the record of what a step found, and of a test where it is due."""
        raise NotImplementedError

    def begin(self, checkpoint: str | os.PathLike[str] | None, resume: bool) -> None:
        """Go on from the checkpoint, or see that nothing else stands where it is to be.

        Raises
        ------
        OSError, ValueError
            When there is no checkpoint, or one of another run, or a file that is none.
        """
        if resume:
            if checkpoint is None:
                raise ValueError("resume: expected a checkpoint to resume from, got none")
            self.restore(Checkpoint.load(checkpoint, self.settings), checkpoint)
        elif checkpoint is not None:
            Checkpoint.refuse_overwrite(checkpoint)

    def run(
        self,
        steps: int,
        checkpoint: str | os.PathLike[str] | None,
        callback: Callable[[Record], object] | None,
        seconds: float | None = None,
    ) -> None:
        """Take the steps that are left."""
        begun = saved = time.monotonic()
        place = checkpoint if self.processes.first else None
        try:
            while len(self.history) < steps:
                now = time.monotonic()
                if self._late(seconds is not None and now - begun > seconds):
                    break
                record = self.step(len(self.history), steps)
                if place is not None and now - saved > _SAVE_EVERY:
                    self._save(place)
                    saved = now
                if self.processes.first and callback is not None:
                    callback(record)
        finally:
            # Also when Ctrl-C or an error ended the loop.
            if place is not None:
                self._save(place)

    def _save(self, checkpoint: str | os.PathLike[str]) -> None:
        """Write what there is between two steps; amid one, what was written last stays."""
        if not self.walking and len(self.history):
            self.checkpoint().save(checkpoint)

    def _late(self, late: bool) -> bool:
        """Whether the first process is out of time."""
        flag = torch.tensor(float(late))
        self.processes.spread(flag)
        return bool(flag)

    def step(self, step: int, steps: int) -> Record:
        """Take one step; gives what it found before it walked on."""
        record = self.measure(step, tested=step % max(1, steps // _LOOKS) == 0)
        for group in self.optimizer.param_groups:
            group["lr"] = self.rate * _share_of_rate(step / steps)
        self.walking = True
        self.update()
        self.history.records.append(record)
        self.walking = False
        return record

    def update(self) -> None:
        """Change the parameters."""
        self.optimizer.step()

    def measure(self, step: int, *, tested: bool) -> Record:
        """Find cost and gradient on what a step draws.

        Raises
        ------
        FloatingPointError
            When they are not numbers.
        """
        self.optimizer.zero_grad()
        loss = self.loss(step)
        loss.backward()
        cost = self._gathered(loss.detach())
        norm = float(nn.utils.clip_grad_norm_(self.parameters, _CLIP))
        if not (math.isfinite(cost) and math.isfinite(norm)):
            raise FloatingPointError(
                f"step {step}: not a number any more (cost {cost:.4g}, gradient norm "
                f"{norm:.4g}); lower the rate, now {self.rate:g}"
            )
        return self.record(step, cost, norm, tested=tested)

    def _gathered(self, loss: Tensor) -> float:
        """Add the gradients and costs of all processes; gives the cost."""
        gradients = [p.grad if p.grad is not None else torch.zeros_like(p) for p in self.parameters]
        flat = torch.cat([loss.view(1), *(gradient.flatten() for gradient in gradients)])
        self.processes.sum(flat)
        start = 1
        for parameter in self.parameters:
            part = flat[start : start + parameter.numel()]
            parameter.grad = part.view_as(parameter).clone()
            start += parameter.numel()
        return float(flat[0])

    def vector(self) -> Vector:
        """Give all parameters that learn, one after the other."""
        return _flat(self.parameters)

    def set_parameters(self, vector: Vector) -> None:
        """Set the parameters that learn."""
        with torch.no_grad():
            for parameter, values in zip(self.parameters, self._parts(vector), strict=True):
                parameter.copy_(values)

    def _parts(self, vector: Vector) -> list[Tensor]:
        """The part of each parameter in a vector of all."""
        sizes = [p.numel() for p in self.parameters]
        parts = torch.from_numpy(vector).split(sizes)
        return [part.to(p).view_as(p) for part, p in zip(parts, self.parameters, strict=True)]

    def state(self) -> State:
        """Give what is remembered between two steps, beside parameters and records."""
        return {
            name: _flat([self.optimizer.state[p][name] for p in self.parameters])
            for name in Trainer.remembers
        }

    def checkpoint(self) -> Checkpoint:
        """Give all that there is between two steps."""
        history = History(list(self.history.records))
        return Checkpoint(self.settings, self.vector(), self.state(), history)

    def restore(self, kept: Checkpoint, path: str | os.PathLike[str]) -> None:
        """Go on from what a checkpoint keeps.

        Raises
        ------
        ValueError
            When it does not fit the network.
        """
        shape = (sum(p.numel() for p in self.parameters),)
        vectors = [kept.vector, *kept.state.values()]
        if sorted(kept.state) != sorted(self.remembers) or any(v.shape != shape for v in vectors):
            raise ValueError(f"{path}: damaged checkpoint: it does not fit the network")
        self.set_parameters(kept.vector)
        moments = {name: self._parts(kept.state[name]) for name in Trainer.remembers}
        for number, parameter in enumerate(self.parameters):
            step = torch.tensor(float(len(kept.history)))
            own = {name: parts[number] for name, parts in moments.items()}
            self.optimizer.state[parameter] = {"step": step, **own}
        self.history = History(list(kept.history.records))


def _share_of_rate(share: float) -> float:
    """The rate over a run, as a share of its largest: a rise, and half a cosine down to 0."""
    if share < _WARM:
        return 0.04 + 0.96 * share / _WARM
    return 0.5 * (1 + math.cos(math.pi * (share - _WARM) / (1 - _WARM)))


def _flat(tensors: Sequence[Tensor]) -> Vector:
    return np.asarray(torch.cat([x.detach().flatten() for x in tensors]).cpu(), np.float64)
