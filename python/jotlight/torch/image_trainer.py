"""A training run on patches of images."""

import os

import numpy as np
import torch
from torch import Tensor

from jotlight.errors import warn
from jotlight.metrics import psnr
from jotlight.torch.ahead import AheadLoader
from jotlight.torch.distributed import ProcessGroup
from jotlight.torch.network import Network as TorchNetwork
from jotlight.torch.trainer import Trainer, flatten
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import Record
from jotlight.training.images import Images
from jotlight.training.optimizer_protocol import State

_AVERAGE_DECAY = 0.999
"""Decay rate of the moving average of the parameters: it spans about 1,000 steps."""

_STUCK_STEPS = 10
"""Number of steps without a gradient after which a run with a high cost has failed. The cost alone
says little: at a high learning rate, that of a good run rises a hundredfold at first."""

_WORSE = 2.0
"""Factor by which the cost of a failed run exceeds that of the initial parameters, on the same
patches. It is large, because these are few."""

_TEST_STEP = 2**32 - 1
"""Step number whose random bits belong to the test images."""


class ImageTrainer(Trainer):
    """A run on patches of images, with a moving average of the parameters.

    Parameters
    ----------
    module, settings, learning_rate, group, optimizer
        See :class:`Trainer`.
    ahead : AheadLoader
        Source of the patches.
    tests : Images, optional
        Images whose PSNR is measured.
    """

    state_names = (*Trainer.state_names, "average")

    def __init__(
        self,
        module: TorchNetwork,
        ahead: AheadLoader,
        settings: dict[str, object],
        learning_rate: float,
        tests: Images | None,
        group: ProcessGroup,
        optimizer: str,
    ) -> None:
        super().__init__(module, settings, learning_rate, group, optimizer)
        self.ahead, self.loader, self.tests = ahead, ahead.loader, tests
        self.averages = [parameter.detach().clone() for parameter in self.parameters]
        self.initial = [parameter.detach().clone() for parameter in self.parameters]

    def loss(self, step: int) -> Tensor:
        """Return this process's part of the mean square error over the patches of a step."""
        batch = self.ahead.batch(step, torch.get_num_threads())
        self.batch = batch.to(self.parameters[0].device)
        return self._batch_loss()

    def record(self, step: int, loss: float, gradient_norm: float, *, is_test: bool) -> Record:
        """Return the record of a step, with the cost ε of a whole patch.

        Raises
        ------
        FloatingPointError
            When the cost has risen and no longer has a gradient, since all splines are constant.
        """
        self._check_convergence(step, loss, gradient_norm)
        test_psnr = self._test_psnr() if is_test and self.tests is not None else None
        return Record(step, self._cost(loss), gradient_norm, test_psnr)

    def update(self) -> None:
        """Change the parameters by one step, and update their averages."""
        super().update()
        taken = len(self.history) + 1
        # The first averages span only as many steps as there are.
        decay = min(_AVERAGE_DECAY, taken / (taken + 9))
        with torch.no_grad():
            for average, parameter in zip(self.averages, self.parameters, strict=True):
                average.lerp_(parameter, 1 - decay)

    def finish(self) -> Record:
        """Set the parameters to their averages, and return the record of the result.

        All processes get those of the main one: products of matrices may differ in their last
        digits between machines.
        """
        for average in self.averages:
            self.group.broadcast(average)
        self._copy(self.averages)
        record = self.measure(len(self.history), is_test=True)
        initial = self._initial_loss()
        if self.group.is_main and record.loss > _WORSE * self._cost(initial):
            warn(
                "the result is much worse than the network at the start: its cost is "
                f"{record.loss:.4g}, and {self._cost(initial):.4g} at the start, on the same "
                "patches; pass more steps= (--steps), or a lower learning_rate= (--learning-rate)"
            )
        return record

    def state(self) -> State:
        """Return what the next step needs besides parameters and records."""
        return {**super().state(), "average": flatten(self.averages)}

    def restore(self, checkpoint: Checkpoint, path: str | os.PathLike[str]) -> None:
        """Continue from a checkpoint; see :meth:`Trainer.restore`."""
        super().restore(checkpoint, path)
        self.averages = self.split(checkpoint.state["average"])

    def _cost(self, loss: float) -> float:
        """Return the cost ε of a patch, equation (12), from the mean square error."""
        return 0.5 * self.loader.side**2 * loss

    def _batch_loss(self) -> Tensor:
        """Return this process's part of the mean square error over the last patches drawn."""
        return self.batch.squared_errors(self.module).sum() / self.loader.batch_size

    def _initial_loss(self) -> float:
        """Return the mean square error of the initial parameters over the last patches drawn."""
        trained = [parameter.detach().clone() for parameter in self.parameters]
        with torch.no_grad():
            try:
                self._copy(self.initial)
                loss = self._batch_loss().detach()
            finally:
                self._copy(trained)
        self.group.all_reduce_sum(loss)
        return float(loss)

    def _copy(self, values: list[Tensor]) -> None:
        """Set the parameters."""
        with torch.no_grad():
            for parameter, value in zip(self.parameters, values, strict=True):
                parameter.copy_(value)

    def _check_convergence(self, step: int, loss: float, gradient_norm: float) -> None:
        """Raise FloatingPointError when no further step can lower a cost that has risen."""
        recent = [record.gradient_norm for record in self.history.records[1 - _STUCK_STEPS :]]
        if gradient_norm or any(recent) or len(recent) < _STUCK_STEPS - 1:
            return
        initial = self._initial_loss()
        if loss > _WORSE * initial:
            raise FloatingPointError(
                f"step {step}: the run diverges: the cost has no gradient and is "
                f"{self._cost(loss):.4g}, and {self._cost(initial):.4g} for the initial "
                f"parameters; lower the learning rate, now {self.learning_rate:g}"
            )

    def _test_psnr(self) -> float:
        """Return the mean PSNR of the test images in dB, for a peak of 1."""
        assert self.tests is not None
        network, sensor = self.module.to_network(), self.loader.sensor
        values = []
        for number, image in enumerate(self.tests):
            seed = np.random.SeedSequence(self.loader.seed, spawn_key=(_TEST_STEP, number))
            estimate = network.reconstruct(sensor.expose(image, seed), sensor)
            values.append(psnr(estimate, image, data_range=1.0))
        return float(np.mean(values))
