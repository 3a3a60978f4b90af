"""Learning from a capture itself, without ground truth: some of its bits tell of the others."""

import dataclasses
import math
import operator
import os
import secrets
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

import jotlight
from jotlight.checks import positive_number, whole_number
from jotlight.sensing.bits import Bits
from jotlight.sensing.pixel_counts import PixelCounts, carried_sensor, count_pixels, split_channels
from jotlight.sensing.sensor import Sensor
from jotlight.torch.bit_splitting import Splits, check_kernel
from jotlight.torch.distributed import Processes, place, together, with_threads
from jotlight.torch.network import Network
from jotlight.torch.trainer import Trainer
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import History, Record
from jotlight.training.images import fingerprint_images
from jotlight.training.optimizer import State
from jotlight.training.parameters import fingerprint_network

STEPS = 500
BATCH, PATCH = 16, 48
RATE = 5e-4


def fine_tune(
    network: jotlight.Network,
    data: Bits | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    steps: int = STEPS,
    batch: int | None = None,
    patch: int | None = None,
    rate: float = RATE,
    rng: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    callback: Callable[[Record], object] | None = None,
    device: str | torch.device | None = None,
    threads: int | None = None,
) -> tuple[jotlight.Network, History]:
    """Make a network better for a capture by learning from that capture alone.

    The bits of a pixel are independent of each other, given the light. So each step splits them at
    random: the network sees six to nine tenths of them, and learns to make the others likely.
    A tenth of all bits is held out from every step, and tells which parameters are the best.

    Parameters
    ----------
    network : jotlight.Network
        Where to start: a tied one, best one that is told K (``jotlight.Network.conditional``), learned
        from photographs. One for a single K sees the counts of fewer bits, scaled to its K.
    data : Bits or array_like of int
        The capture: bits, or an image of counts L of shape (H, W) or (H, W, C); colours are learned
        from together.
    sensor : Sensor, optional
        What made it, with the box kernel and two bits per pixel at least; its dead jots, dark
        counts and efficiency are used as :meth:`jotlight.Network.reconstruct` does. Default: the
        one that the bits carry, or else the network's.
    steps : int
        Of Adam; the rate rises at first, and falls to 0.
    batch, patch : int, optional
        Patches of a step, turned and mirrored at random, and their side in pixels. Default: 16 of
        48 x 48, or as large as the image.
    rate : float
        The largest step of a parameter, about.
    rng : int, optional
        The seed: the same one gives the same network for the same number of threads. Default: a new
        one.
    checkpoint, resume, callback :
        As in :func:`jotlight.train`.
    device : str or torch.device, optional
        Default: a GPU, if there is one, and else the CPU.
    threads : int, optional
        Threads of the CPU. Default: as many as PyTorch uses.

    Returns
    -------
    network : jotlight.Network
        Of the parameters that were looked at those that make the bits held out most likely: at
        least as likely as at the start, which are among them.
    history : History
        Of each step the negative log likelihood of the bits that were to be told, in nats per bit,
        as its `loss`; some 20 times that of the bits held out, `held_out`. The last record belongs
        to the result.

    Raises
    ------
    TypeError, ValueError
        When network, data, sensor and settings do not fit, no pixel has two bits, or the checkpoint
        is of another run.
    FloatingPointError
        When the likelihood is not a number.

    Warns
    -----
    JotlightWarning
        When pixels without a valid jot were filled from their neighbours.

    Notes
    -----
    Under PyTorch's launcher several processes share the patches of each step, as in
    :func:`jotlight.torch.train`.

    Examples
    --------
    >>> sensor = jotlight.Sensor(frames=8)
    >>> bits = sensor.expose(np.full((24, 24), 0.4), rng=0)
    >>> start = jotlight.Network.conditional("small", rng=0)
    >>> own, history = fine_tune(start, bits, steps=10, batch=4, rng=0)
    >>> bool(history.held_out[-1] < history.held_out[0])
    True
    """
    if sensor is None:
        sensor = carried_sensor(data) or network.sensor
    seen = _seen(network, data, sensor, threads)
    here = place(device)
    steps = whole_number("steps", steps, 1)
    batch = whole_number("batch", BATCH if batch is None else batch, 1)
    positive_number("rate", rate)
    most = min(seen[0].counts.shape)
    side = min(PATCH, most) if patch is None else operator.index(patch)
    if not 1 <= side <= most:
        raise ValueError(f"patch: expected 1 to the {most} pixels of the image, got {side}")
    with together(here) as processes, with_threads(threads):
        drawn = torch.tensor(secrets.randbits(32) if rng is None else whole_number("rng", rng, 0))
        processes.spread(drawn)
        seed = int(drawn)
        run: dict[str, object] = {
            "network": fingerprint_network(network),
            "sensor": sensor.scalars(),
            "capture": _fingerprint(seen),
            "optimizer": f"Adam(learning_rate={rate})",
            "steps": steps,
            "batch": batch,
            "patch": side,
            "seed": seed,
        }
        splits = Splits(network, sensor, seen, _generator(seed, 0))
        module = Network(network).to(here)
        trainer = _Tuning(module, splits, run, rate, seed, batch, side, processes)
        trainer.begin(checkpoint, resume)
        trainer.run(steps, checkpoint, callback)
        last = trainer.restore_best()
        if processes.first and callback is not None:
            callback(last)
    history = History([*trainer.history.records, last])
    own = module.network()
    told = {"run": run, "records": history.subsample().to_json()}
    own.history = {**network.history, "fine tuning": told}
    return own, history


def _seen(
    network: jotlight.Network, data: Bits | npt.ArrayLike, sensor: Sensor, threads: int | None
) -> list[PixelCounts]:
    """The channels of a capture, whose bits can be split."""
    network.check_sensor(sensor)
    if not network.tied:
        raise ValueError(
            "network: expected a tied one, which takes counts: only where all jots of a pixel "
            "count the same can its bits be split at random"
        )
    check_kernel(sensor)
    seen = [count_pixels(channel, sensor, threads) for channel in split_channels(data)]
    if any(plane.varies_within_pixels for plane in seen):
        raise ValueError(
            "sensor: expected jots of the same efficiency and dark counts inside of each pixel, "
            "since its bits are split at random; give their means over the pixels"
        )
    most = max(int(np.max(plane.trials)) for plane in seen)
    if most < 2:
        raise ValueError(
            f"data: expected pixels of two bits or more, some to see and some to tell, got {most}; "
            "take more frames, or the network as it is"
        )
    return seen


def _fingerprint(seen: Sequence[PixelCounts]) -> str:
    """A word that tells what was seen, and by which jots, from others."""
    told = [(x.counts, x.trials, x.efficiency, x.dark_counts) for x in seen]
    return fingerprint_images([np.asarray(array) for arrays in told for array in arrays])


class _Tuning(Trainer):
    """A run on the bits of a capture, and the best parameters so far."""

    remembers = (*Trainer.remembers, "best")

    def __init__(
        self,
        module: Network,
        splits: Splits,
        run: dict[str, object],
        rate: float,
        seed: int,
        batch: int,
        side: int,
        processes: Processes,
    ) -> None:
        super().__init__(module, run, rate, processes)
        self.splits, self.seed, self.batch, self.side = splits, seed, batch, side
        self.best, self.least = self.vector(), math.inf

    def loss(self, step: int) -> Tensor:
        """Give the negative log likelihood of the bits to be told, in nats per bit."""
        split = self.splits.draw(_generator(self.seed, 1, step), self.batch, self.side)
        own = split.of(self.processes.share)
        device = self.parameters[0].device
        surprise = self.splits.negative_log_likelihood(
            self.module(own.counts.to(device), own.told), own
        )
        return surprise * (own.number / max(split.number, 1))

    def record(self, step: int, cost: float, norm: float, *, tested: bool) -> Record:
        """Give the record of a step."""
        return Record(step, cost, norm, None, self._look() if tested else None)

    def update(self) -> None:
        """Change the parameters, and stay in range."""
        super().update()
        self._keep_in_range()

    def restore_best(self) -> Record:
        """Go back to the best parameters; gives what a step would find there."""
        self._look()
        self.set_parameters(self.best)
        last = self.measure(len(self.history), tested=False)
        return dataclasses.replace(last, held_out=self.least)

    def state(self) -> State:
        """Give what is remembered between two steps, the best parameters among it."""
        return {**super().state(), "best": self.best}

    def restore(self, kept: Checkpoint, path: str | os.PathLike[str]) -> None:
        """Go on from what a checkpoint keeps."""
        super().restore(kept, path)
        self.best = kept.state["best"]
        self.least = float(np.nanmin(self.history.held_out, initial=math.inf))

    def _look(self) -> float:
        """Find how likely the bits held out are, and remember the best."""
        found = self.splits.held_out_negative_log_likelihood(
            self.module.network(), torch.get_num_threads()
        )
        # Processes on unlike machines could come to other last digits, and to another best.
        shared = torch.tensor(found, dtype=torch.float64)
        self.processes.spread(shared)
        found = float(shared)
        if found < self.least:
            self.best, self.least = self.vector(), found
        return found

    def _keep_in_range(self) -> None:
        """Keep the outputs of a last spline that learns where those of the sensor lie."""
        origin = self.module.origin
        last = len(origin.layers) - 1
        start = origin.layers[last].coefficients
        if start is None or origin.layers[last].trainable != "all":
            return
        # A spline stays in the hull of its coefficients.
        low, high = min(0.0, float(start.min())), origin.sensor.max_intensity
        with torch.no_grad():
            self.module.coefficients[str(last)].clamp_(low, max(high, float(start.max())))


def _generator(seed: int, *place: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=place))
