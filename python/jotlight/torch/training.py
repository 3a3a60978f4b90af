"""Learning the parameters of deep members with PyTorch."""

import math
import operator
import os
import secrets
import time
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

import jotlight
from jotlight import metrics
from jotlight.sensor import Sensor
from jotlight.torch.examples import Patches
from jotlight.torch.network import Network
from jotlight.torch.processes import Processes, place, together
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.examples import (
    Scenes,
    Source,
    checked_scenes,
    fingerprint,
    made_scenes,
    sensor_of_patches,
    side_of_patches,
)
from jotlight.training.history import History, Record
from jotlight.training.loop import Images, fingerprint_of

STEPS = 20_000
BATCH, PATCH = 16, 48
RATE = 3e-3
_CLIP = 0.1
"""The largest norm of a gradient that is followed as it is."""
_WARM = 0.1
"""The share of the steps over which the rate rises."""
_TESTS = 20
"""Tests of a run, at most."""
_SAVE_EVERY = 20.0
"""Seconds between two checkpoints."""


def train(
    network: jotlight.Network,
    images: Images,
    sensor: Sensor | None = None,
    *,
    steps: int | None = None,
    seconds: float | None = None,
    batch: int | None = None,
    patch: int | None = None,
    rate: float = RATE,
    rng: int | None = None,
    test: npt.NDArray[np.floating] | Sequence[npt.ArrayLike] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    callback: Callable[[Record], object] | None = None,
    device: str | torch.device | None = None,
    threads: int | None = None,
) -> tuple[jotlight.Network, History]:
    """Learn the parameters with the least mean square error, by Adam.

    Each step draws new patches, turned and mirrored at random, and new bits. The rate rises at
    first, and falls to 0.

    Parameters
    ----------
    network : jotlight.Network
        Where to start, such as ``jotlight.Network.deep(sensor, "small")``, or
        ``jotlight.Network.told("medium")`` for a network that serves many K and any exposure.
    images : array (N, H, W), sequence of arrays (H, W), or callable
        As in :func:`jotlight.train`.
    sensor : Sensor, optional
        Default: the network's. Of a network for many K it is the one of the tests.
    steps : int, optional
        Default: 20,000.
    seconds : float, optional
        Stop after so many seconds, before the rate has fallen to 0.
    batch, patch : int, optional
        Patches of a step, and their side in pixels. Default: 16 of 48 x 48, or of the smallest
        image.
    rate : float
        The largest step of a parameter, about.
    rng : int, optional
        The seed of patches and bits. Default: a new one.
    test : array or sequence of arrays, optional
        Images, whole, on which the PSNR is measured now and then.
    checkpoint, resume, callback :
        As in :func:`jotlight.train`.
    device : str or torch.device, optional
        Default: a GPU, if there is one, and else the CPU.
    threads : int, optional
        Threads of the CPU. Default: as many as PyTorch uses.

    Returns
    -------
    network : jotlight.Network
    history : History
        As of :func:`jotlight.train`: the last record belongs to the result. The network's own
        `history` has about 500 of the records.

    Raises
    ------
    TypeError, ValueError
        When network, sensor, images and settings do not fit, or the checkpoint is of another run.
    FloatingPointError
        When the cost is not a number.

    Notes
    -----
    Under PyTorch's launcher, ``torchrun --nproc-per-node 2 script.py``, the processes share the
    patches of each step and add their gradients; all return the same network, and the first alone
    writes and calls back.

    Examples
    --------
    >>> start = jotlight.Network.deep(jotlight.Sensor(oversampling=4), "small", rng=0)
    >>> learned, history = train(start, jotlight.datasets.uniform_scenes, steps=3, patch=32, rng=0)
    >>> len(history)
    4
    """
    sensor = network.sensor if sensor is None else sensor
    network._check_sensor(sensor)
    here = place(device)
    steps = _at_least("steps", STEPS if steps is None else steps, 1)
    batch = _at_least("batch", BATCH if batch is None else batch, 1)
    if not rate > 0:
        raise ValueError(f"rate: expected a number above 0, got {rate}")
    if seconds is not None and not seconds > 0:
        raise ValueError(f"seconds: expected a number above 0, got {seconds}")
    scenes: Scenes | Source = images if callable(images) else checked_scenes(images)
    seen = made_scenes(scenes, np.random.default_rng(0), 1) if callable(scenes) else scenes
    side = side_of_patches(seen, patch)
    if patch is None:
        side = min(PATCH, side)
    tests = None if test is None else checked_scenes(test)
    with together(here) as processes:
        seed = torch.tensor(secrets.randbits(32) if rng is None else _at_least("rng", rng, 0))
        processes.spread(seed)
        patches = Patches(scenes, network, sensor_of_patches(sensor), int(seed), batch, side)
        run: dict[str, object] = {
            "network": fingerprint_of(network),
            "sensor": patches.sensor.numbers(),
            "images": fingerprint(scenes),
            "test": None if tests is None else fingerprint(tests),
            "optimiser": f"Adam(rate={rate})",
            "steps": steps,
            "batch": batch,
            "patch": patches.side,
            "seed": int(seed),
        }
        before = torch.get_num_threads()
        try:
            if threads is not None:
                torch.set_num_threads(_at_least("threads", threads, 1))
            module = Network(network).to(here)
            course = Course(module, patches, run, rate, tests, processes)
            if resume:
                if checkpoint is None:
                    raise ValueError("resume: expected a checkpoint to resume from, got none")
                course.restore(Checkpoint.load(checkpoint, run), checkpoint)
            elif checkpoint is not None:
                Checkpoint.spare_others(checkpoint)
            course.follow(steps, seconds, checkpoint, callback)
            last = course.measure(len(course.history), tested=True)
            if processes.first and callback is not None:
                callback(last)
        finally:
            torch.set_num_threads(before)
    history = History([*course.history.records, last])
    told = {**network.history, "run": run, "records": history.thinned().to_json()}
    learned = course.module.network()
    if network.bits is None:
        learned = jotlight.Network(learned.layers, sensor)
    learned.history = told
    return learned, history


class Course:
    """A run: the parameters, what the optimiser remembers, and the records so far."""

    def __init__(
        self,
        module: Network,
        patches: Patches,
        run: dict[str, object],
        rate: float,
        tests: Scenes | None,
        processes: Processes,
    ) -> None:
        self.patches, self.run, self.rate, self.tests = patches, run, rate, tests
        self.module, self.processes = module, processes
        self.parameters = [p for p in self.module.parameters() if p.requires_grad]
        self.optimiser = torch.optim.Adam(self.parameters, lr=rate, betas=(0.9, 0.99))
        self.history = History()
        self.kept = self.checkpoint()

    def follow(
        self,
        steps: int,
        seconds: float | None,
        checkpoint: str | os.PathLike[str] | None,
        callback: Callable[[Record], object] | None,
    ) -> None:
        """Take the steps that are left."""
        begun = saved = time.monotonic()
        try:
            while len(self.history) < steps:
                now = time.monotonic()
                if self._late(seconds is not None and now - begun > seconds):
                    break
                record = self.step(len(self.history), steps)
                if not self.processes.first:
                    continue
                if checkpoint is not None:
                    self.kept = self.checkpoint()
                    if now - saved > _SAVE_EVERY:
                        self.kept.save(checkpoint)
                        saved = now
                if callback is not None:
                    callback(record)
        finally:
            # Also when Ctrl-C or an error ended the loop: `kept` is always between two steps.
            if checkpoint is not None and self.processes.first and len(self.kept.history):
                self.kept.save(checkpoint)

    def _late(self, late: bool) -> bool:
        """Whether the first process is out of time."""
        flag = torch.tensor(float(late))
        self.processes.spread(flag)
        return bool(flag)

    def step(self, step: int, steps: int) -> Record:
        """Take one step; gives what it found before it walked on."""
        record = self.measure(step, tested=step % max(1, steps // _TESTS) == 0)
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate * _course(step / steps)
        self.optimiser.step()
        self.history.records.append(record)
        return record

    def measure(self, step: int, *, tested: bool) -> Record:
        """Find cost and gradient on the patches of a step."""
        psnr = self.test() if tested and self.tests is not None else None
        views = self.patches.views(step, self.processes.share, torch.get_num_threads())
        views = views.to(self.parameters[0].device)
        self.optimiser.zero_grad()
        loss = views.errors(self.module).sum() / self.patches.batch
        loss.backward()
        total = self._gathered(loss.detach())
        norm = float(nn.utils.clip_grad_norm_(self.parameters, _CLIP))
        if not (math.isfinite(total) and math.isfinite(norm)):
            raise FloatingPointError(
                f"step {step}: not a number any more (cost {total:.4g}, gradient norm "
                f"{norm:.4g}); lower the rate, now {self.rate:g}"
            )
        return Record(step, 0.5 * self.patches.side**2 * total, norm, psnr)

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

    def test(self) -> float:
        """Mean PSNR of the test images in dB, for a peak of 1, always with the same bits."""
        assert self.tests is not None
        network, sensor = self.module.network(), self.patches.sensor
        found = []
        for number, image in enumerate(self.tests):
            seed = np.random.SeedSequence(self.patches.seed, spawn_key=(2**32 - 1, number))
            estimate = network.reconstruct(sensor.expose(image, seed), sensor)
            found.append(metrics.psnr(estimate, image, peak=1.0))
        return float(np.mean(found))

    def checkpoint(self) -> Checkpoint:
        """Give the state between two steps."""
        state = {
            name: _flat([self.optimiser.state[p][name] for p in self.parameters])
            for name in ("exp_avg", "exp_avg_sq")
            if self.optimiser.state
        }
        return Checkpoint(
            self.run, _flat(self.parameters), state, History(list(self.history.records))
        )

    def restore(self, kept: Checkpoint, path: str | os.PathLike[str]) -> None:
        """Go on from a state."""
        arrays = {"parameters": kept.vector, **kept.state}
        size = sum(p.numel() for p in self.parameters)
        if sorted(arrays) != ["exp_avg", "exp_avg_sq", "parameters"] or any(
            array.shape != (size,) for array in arrays.values()
        ):
            raise ValueError(f"{path}: damaged checkpoint: it does not fit the network")
        start = 0
        for parameter in self.parameters:
            part = slice(start, start + parameter.numel())
            start = part.stop
            values = {
                name: torch.from_numpy(array[part]).to(parameter).view_as(parameter)
                for name, array in arrays.items()
            }
            with torch.no_grad():
                parameter.copy_(values.pop("parameters"))
            step = torch.tensor(float(len(kept.history)))
            self.optimiser.state[parameter] = {"step": step, **values}
        self.history = History(list(kept.history.records))
        self.kept = kept


def _course(share: float) -> float:
    """The rate over a run, as a share of its largest: a rise, and half a cosine down to 0."""
    if share < _WARM:
        return 0.04 + 0.96 * share / _WARM
    return 0.5 * (1 + math.cos(math.pi * (share - _WARM) / (1 - _WARM)))


def _flat(tensors: Sequence[Tensor]) -> npt.NDArray[np.float64]:
    return np.asarray(torch.cat([x.detach().flatten() for x in tensors]).cpu(), np.float64)


def _at_least(name: str, value: int, least: int) -> int:
    value = operator.index(value)
    if value < least:
        raise ValueError(f"{name}: expected at least {least}, got {value}")
    return value
