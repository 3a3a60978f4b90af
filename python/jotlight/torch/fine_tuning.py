"""Learning from a capture itself, without ground truth: some of its bits tell of the others."""

import math
import operator
import secrets
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

import jotlight
from jotlight.bits import Bits
from jotlight.channels import channels_of
from jotlight.observation import Observation, observe
from jotlight.sensor import Sensor
from jotlight.torch.network import Network
from jotlight.torch.processes import place
from jotlight.torch.splitting import Splits
from jotlight.torch.training import _at_least, _course
from jotlight.training.history import History, Record
from jotlight.training.loop import fingerprint_of

STEPS = 500
BATCH, PATCH = 16, 48
RATE = 5e-4
_CLIP = 0.1
"""The largest norm of a gradient that is followed as it is."""
_LOOKS = 20
"""How often the bits that are held out are looked at, about."""


def fine_tune(
    network: jotlight.Network,
    data: Bits | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    steps: int = STEPS,
    batch: int = BATCH,
    patch: int | None = None,
    rate: float = RATE,
    rng: int | None = None,
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
        Where to start: a tied one, best one that is told K (``jotlight.Network.told``), learned
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
    callback : callable, optional
        Called with the :class:`Record` of each step.
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
        When network, data, sensor and settings do not fit, and when no pixel has two bits.
    FloatingPointError
        When the likelihood is not a number.

    Warns
    -----
    JotlightWarning
        When pixels without a valid jot were filled from their neighbours.

    Examples
    --------
    >>> sensor = jotlight.Sensor(frames=8)
    >>> bits = sensor.expose(np.full((24, 24), 0.4), rng=0)
    >>> start = jotlight.Network.told("small", rng=0)
    >>> own, history = fine_tune(start, bits, steps=10, batch=4, rng=0)
    >>> bool(history.held_out[-1] < history.held_out[0])
    True
    """
    if sensor is None:
        sensor = (data.sensor if isinstance(data, Bits) else None) or network.sensor
    seen = _seen(network, data, sensor, threads)
    steps, batch = _at_least("steps", steps, 1), _at_least("batch", batch, 1)
    if not (math.isfinite(rate) and rate > 0):
        raise ValueError(f"rate: expected a finite number above 0, got {rate}")
    most = min(seen[0].counts.shape)
    side = min(PATCH, most) if patch is None else operator.index(patch)
    if not 1 <= side <= most:
        raise ValueError(f"patch: expected 1 to the {most} pixels of the image, got {side}")
    seed = secrets.randbits(32) if rng is None else _at_least("rng", rng, 0)
    run = {
        "network": fingerprint_of(network),
        "sensor": sensor.numbers(),
        "optimiser": f"Adam(rate={rate})",
        "steps": steps,
        "batch": batch,
        "patch": side,
        "seed": seed,
    }
    before = torch.get_num_threads()
    try:
        if threads is not None:
            torch.set_num_threads(_at_least("threads", threads, 1))
        splits = Splits(network, sensor, seen, _generator(seed, 0))
        tuning = _Tuning(network, splits, run, place(device))
        tuning.follow(rate, callback)
    finally:
        torch.set_num_threads(before)
    looks = [[r.step, r.held_out] for r in tuning.history.records if r.held_out is not None]
    own = tuning.best
    told = {**network.history, "fine tuning": {"run": run, "held out": looks}}
    return jotlight.Network(own.layers, own.sensor, told, bits=own.bits), tuning.history


def _seen(
    network: jotlight.Network, data: Bits | npt.ArrayLike, sensor: Sensor, threads: int | None
) -> list[Observation]:
    """The channels of a capture, whose bits can be split."""
    network._check_sensor(sensor)
    if not network.tied:
        raise ValueError(
            "network: expected a tied one, which takes counts: only where all jots of a pixel "
            "count the same can its bits be split at random"
        )
    if sensor.kernel != "box":
        raise ValueError(
            f"sensor: expected the box kernel, got {sensor.kernel}: the jots of a pixel see "
            "different light, so that its bits cannot be split at random"
        )
    seen = [observe(channel, sensor, threads) for channel in channels_of(data)]
    if any(plane.jots_differ for plane in seen):
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


class _Tuning:
    """A run: the parameters, and the best so far."""

    def __init__(
        self,
        network: jotlight.Network,
        splits: Splits,
        run: Mapping[str, Any],
        device: torch.device,
    ) -> None:
        self.splits, self.run, self.device = splits, run, device
        self.best, self.least = network, math.inf
        self.module = Network(network).to(device)
        self.history = History()

    def follow(self, rate: float, callback: Callable[[Record], object] | None) -> None:
        """Take all steps, and look at where they led."""
        steps = self.run["steps"]
        every = max(1, steps // _LOOKS)
        parameters = [p for p in self.module.parameters() if p.requires_grad]
        optimiser = torch.optim.Adam(parameters, betas=(0.9, 0.99))
        for step in range(steps):
            found = self._look() if step % every == 0 else None
            self._note(self._measure(step, found), callback)
            for group in optimiser.param_groups:
                group["lr"] = rate * _course(step / steps)
            optimiser.step()
            self._keep_in_range()
        self._look()
        self.module = Network(self.best).to(self.device)
        self._note(self._measure(steps, self.least), callback)

    def _measure(self, step: int, held_out: float | None) -> Record:
        """Find how likely other bits are, and the gradient."""
        rng = _generator(self.run["seed"], 1, step)
        split = self.splits.draw(rng, self.run["batch"], self.run["patch"])
        self.module.zero_grad()
        loss = self.splits.surprise(self.module(split.counts.to(self.device), split.told), split)
        loss.backward()
        norm = float(nn.utils.clip_grad_norm_(self.module.parameters(), _CLIP))
        cost = float(loss.detach())
        if not (math.isfinite(cost) and math.isfinite(norm)):
            raise FloatingPointError(
                f"step {step}: not a number any more (cost {cost:.4g}, gradient norm {norm:.4g}); "
                f"lower the rate, now {self.run['optimiser']}"
            )
        return Record(step, cost, norm, None, held_out)

    def _look(self) -> float:
        """Find how likely the bits held out are, and remember the best."""
        network = self.module.network()
        found = self.splits.surprise_held_out(network, torch.get_num_threads())
        if found < self.least:
            self.best, self.least = network, found
        return found

    def _keep_in_range(self) -> None:
        """Keep the outputs of a last spline that learns where those of the sensor lie."""
        origin = self.module.origin
        last = len(origin.layers) - 1
        start = origin.layers[last].coefficients
        if start is None or origin.layers[last].learns != "all":
            return
        # A spline stays in the hull of its coefficients.
        low, high = min(0.0, float(start.min())), origin.sensor.max_intensity
        with torch.no_grad():
            self.module.coefficients[str(last)].clamp_(low, max(high, float(start.max())))

    def _note(self, record: Record, callback: Callable[[Record], object] | None) -> None:
        self.history.records.append(record)
        if callback is not None:
            callback(record)


def _generator(seed: int, *place: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=place))
