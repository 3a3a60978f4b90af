"""A training run: its settings, its steps, and its result."""

import dataclasses
import os
import time
from typing import Any

import numpy as np

from jotlight.array_types import Array
from jotlight.errors import warn
from jotlight.networks.network import Network
from jotlight.networks.stages import with_run
from jotlight.sensing.sensor import Sensor
from jotlight.training.admissible import AdmissibleSet
from jotlight.training.checkpoint import Checkpoint, CheckpointWriter
from jotlight.training.cost import Cost, mean_psnr
from jotlight.training.history import History, Record
from jotlight.training.images import fingerprint_images
from jotlight.training.optimizer_protocol import Optimizer, Step
from jotlight.training.parameters import fingerprint_network, with_parameters
from jotlight.training.patches import PatchSampler
from jotlight.training.reporting import StepReport

FilePath = str | os.PathLike[str]

_MIN_TESTS = 100
"""Minimum number of measurements on the test images, in a run of at least this number of steps."""

_DIVERGED = 2.0
"""Factor by which the cost of a diverged run exceeds the cost of the initial parameters."""


@dataclasses.dataclass(frozen=True)
class Run:
    """A run of :func:`jotlight.train`. Its settings have been checked."""

    network: Network
    sampler: PatchSampler
    tests: dict[str, Any] | None
    """Test images, as :meth:`PatchSampler.whole_images` describes them."""
    optimizer: Optimizer
    admissible: AdmissibleSet
    steps: int
    threads: int | None

    def settings(self) -> dict[str, Any]:
        """Return the settings that identify the run in checkpoints and in the network's history."""
        return {
            "network": fingerprint_network(self.network),
            "sensor": self.sampler.sensor.scalars(),
            "images": fingerprint_images(self.sampler.images),
            "test": None if self.tests is None else fingerprint_images(self.tests["images"]),
            "optimizer": repr(self.optimizer),
            "admissible": repr(self.admissible),
            "steps": self.steps,
            "batch": self.sampler.patches,
            "patch": self.sampler.side,
            "seed": self.sampler.seed,
        }

    def begin(self, start: Array, checkpoint: FilePath | None, resume: bool) -> Checkpoint:
        """Return the state before the first step, or that of the checkpoint.

        Raises
        ------
        OSError, ValueError
            When there is no checkpoint to resume from, when it is damaged or belongs to another
            run, or when another file would be overwritten.
        """
        settings = self.settings()
        if not resume:
            if checkpoint is not None:
                Checkpoint.refuse_overwrite(checkpoint)
            return Checkpoint(settings, start, {}, History())
        state = Checkpoint.load(checkpoint, settings)
        if state.vector.shape != start.shape or len(state.history) > self.steps:
            raise ValueError(f"{checkpoint}: damaged checkpoint: it does not fit the network")
        projected = self.admissible.project(self.network, state.vector)
        if not np.allclose(projected, state.vector, rtol=0, atol=1e-6):
            raise ValueError(
                f"{checkpoint}: damaged checkpoint: its parameters are not in the admissible set"
            )
        return state

    def take_steps(
        self,
        start: Array,
        state: Checkpoint,
        checkpoint: FilePath | None,
        resume: bool,
        seconds: float | None,
        report: StepReport,
    ) -> Checkpoint:
        """Return the state after the last step.

        The time limit, and the function that gets the record of each step, can end the run earlier.
        """
        resumed_steps = len(state.history)
        writer = CheckpointWriter(checkpoint, resumed_steps)
        begun, longest = time.monotonic(), 0.0
        try:
            while len(state.history) < self.steps:
                now = time.monotonic()
                # Reserve time for the next step and for the measurement of its result.
                if seconds is not None and longest and now - begun + 2 * longest > seconds:
                    break
                is_first_resumed = resume and len(state.history) == resumed_steps
                state = self._take_step(start, state, checkpoint if is_first_resumed else None)
                if not report(state.history.records[-1]):
                    break
                writer.update(state)
                longest = max(longest, time.monotonic() - now)
        finally:
            # Also after Ctrl-C or an error: `state` is always the state between two steps.
            writer.close(state)
        return state

    def _take_step(
        self, start: Array, state: Checkpoint, resumed_from: FilePath | None
    ) -> Checkpoint:
        """Return the state after the next step.

        If it is the first one after resuming, `resumed_from` is the checkpoint.
        """
        cost = self._cost(len(state.history))
        try:
            step = self.optimizer.take_step(cost, state.vector, state.state)
        except (KeyError, ValueError, TypeError) as error:
            if resumed_from is None:
                raise
            is_missing = isinstance(error, KeyError)
            reason = f"it has no state.{error.args[0]}" if is_missing else str(error)
            raise ValueError(
                f"{resumed_from}: damaged checkpoint: {self.optimizer} cannot continue from it "
                f"({reason}); start again with resume=False (--restart)"
            ) from error
        is_tested = cost.step % max(1, self.steps // _MIN_TESTS) == 0
        psnr = self._test_psnr(state.vector) if is_tested else None
        record = Record(cost.step, step.loss, float(np.linalg.norm(step.gradient)), psnr)
        records = [*state.history.records, record]
        self._check_convergence(records, step, cost, start)
        return Checkpoint(state.run, step.vector, step.state, History(records))

    def _check_convergence(
        self, records: list[Record], step: Step, cost: Cost, start: Array
    ) -> None:
        """Raise FloatingPointError when the run diverges."""
        record, optimizer = records[-1], self.optimizer
        with np.errstate(over="ignore"):
            usable = np.isfinite(step.vector.astype(np.float32)).all()
        if not (np.isfinite([record.loss, record.gradient_norm]).all() and usable):
            raise FloatingPointError(
                f"step {record.step}: the run reached infinity or NaN (cost {record.loss:.4g}, "
                f"gradient norm {record.gradient_norm:.4g}); optimizer {optimizer}: "
                f"{optimizer.advice}"
            )
        recent = [record.loss for record in records[-10:]]
        if len(recent) < 10 or np.mean(recent) < 1.5 * records[0].loss:
            return
        # Harder patches raise the cost, too. So compare with the start on the same patches.
        at_start = cost.value(start)
        if record.loss > _DIVERGED * at_start:
            raise FloatingPointError(
                f"step {record.step}: the run diverges: the cost is {record.loss:.4g}, and "
                f"{at_start:.4g} for the initial parameters; optimizer {optimizer}: "
                f"{optimizer.advice}"
            )

    def finish(
        self, start: Array, state: Checkpoint, sensor: Sensor, report: StepReport
    ) -> tuple[Network, History]:
        """Return the trained network for a sensor, and the history with a record of the result.

        Warns
        -----
        JotlightWarning
            When the result is much worse than the parameters `start`.
        """
        taken = len(state.history)
        cost = self._cost(taken)
        loss, gradient = cost.gradient(state.vector)
        at_start = cost.value(start)
        if loss > _DIVERGED * at_start:
            warn(
                "the result is much worse than the network at the start: its cost is "
                f"{loss:.4g}, and {at_start:.4g} at the start, on the same patches; optimizer "
                f"{self.optimizer}: {self.optimizer.advice}, or pass more steps= (--steps)"
            )
        psnr = self._test_psnr(state.vector)
        record = Record(taken, loss, float(np.linalg.norm(gradient)), psnr)
        report(record)
        history = History([*state.history.records, record])
        stages = with_run(self.network.history, "train", state.run, history.to_json())
        layers = with_parameters(self.network, state.vector).layers
        return Network(layers, sensor, stages), history

    def _cost(self, step: int) -> Cost:
        return Cost(self.network, self.sampler, step, self.steps, self.admissible, self.threads)

    def _test_psnr(self, vector: Array) -> float | None:
        if self.tests is None:
            return None
        return mean_psnr(self.network, vector, self.tests, self.threads)
