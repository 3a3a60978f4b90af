"""A training run on patches of images."""

import os

import numpy as np
import torch
from torch import Tensor

from jotlight.metrics import psnr
from jotlight.torch.ahead import AheadLoader
from jotlight.torch.distributed import ProcessGroup
from jotlight.torch.network import Network as TorchNetwork
from jotlight.torch.trainer import Trainer, flatten
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import Record
from jotlight.training.images import Images
from jotlight.training.optimizer import State

_AVERAGE_DECAY = 0.999
"""Decay rate of the moving average of the parameters: it spans about 1,000 steps."""

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

    def loss(self, step: int) -> Tensor:
        """Return this process's part of the mean square error over the patches of a step."""
        batch = self.ahead.batch(step, torch.get_num_threads())
        batch = batch.to(self.parameters[0].device)
        return batch.squared_errors(self.module).sum() / self.loader.batch_size

    def record(self, step: int, loss: float, gradient_norm: float, *, is_test: bool) -> Record:
        """Return the record of a step, with the cost ε of a whole patch."""
        test_psnr = self._test_psnr() if is_test and self.tests is not None else None
        return Record(step, 0.5 * self.loader.side**2 * loss, gradient_norm, test_psnr)

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
        with torch.no_grad():
            for average, parameter in zip(self.averages, self.parameters, strict=True):
                self.group.broadcast(average)
                parameter.copy_(average)
        return self.measure(len(self.history), is_test=True)

    def state(self) -> State:
        """Return what the next step needs besides parameters and records."""
        return {**super().state(), "average": flatten(self.averages)}

    def restore(self, checkpoint: Checkpoint, path: str | os.PathLike[str]) -> None:
        """Continue from a checkpoint; see :meth:`Trainer.restore`."""
        super().restore(checkpoint, path)
        self.averages = self.split(checkpoint.state["average"])

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
