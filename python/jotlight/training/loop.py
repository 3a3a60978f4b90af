"""Learning: from a network and images to a better network."""

import dataclasses
import hashlib
import operator
import os
import secrets
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.network import Network
from jotlight.sensor import Sensor
from jotlight.training.admissible import AdmissibleSet, SafeSet
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.cost import Cost, mean_psnr
from jotlight.training.examples import (
    Examples,
    Source,
    checked_scenes,
    sensor_of_patches,
    side_of_patches,
)
from jotlight.training.history import History, Record
from jotlight.training.optimisers import OPTIMISERS, Optimiser
from jotlight.training.parameters import network_of, vector_of

Images = npt.NDArray[np.floating] | Sequence[npt.ArrayLike] | Source

_PIXELS = 128 * 32 * 32
"""Of a step, unless told otherwise: the paper's."""

_TESTS = 100
"""Tests of a run, at most."""

_SAVE_EVERY = 20.0
"""Seconds between two checkpoints."""

_WORSE = 3.0
"""A run whose cost stays this many times above its first has gone astray."""


def train(
    network: Network,
    images: Images,
    sensor: Sensor | None = None,
    *,
    optimiser: str | Optimiser = "gauss-newton",
    steps: int | None = None,
    batch: int | None = None,
    patch: int | None = None,
    rng: int | None = None,
    test: npt.NDArray[np.floating] | Sequence[npt.ArrayLike] | None = None,
    admissible: AdmissibleSet | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    callback: Callable[[Record], object] | None = None,
    threads: int | None = None,
) -> tuple[Network, History]:
    """Learn the parameters with the least mean square error for a sensor and images.

    Each step draws new patches and new bits, finds cost and gradient by error backpropagation, and
    walks on inside of the set 𝒜.

    Parameters
    ----------
    network : Network
        Where to start, such as ``Network.initial(sensor)``.
    images : array (N, H, W), sequence of arrays (H, W), or callable
        Grey images of intensities. A callable takes a `numpy.random.Generator` and a number, and
        gives so many new images in an array (N, H, W); each step then sees new ones, whole.
    sensor : Sensor, optional
        Default: the network's. Maps of its dark counts enter by their median, and dead jots not at
        all: where they lie is not a matter of the patch.
    optimiser : {"gauss-newton", "adam", "projected-gradient"} or Optimiser
        One of `jotlight.training`, by name or with settings of your own.
    steps : int, optional
        Default: the optimiser's `steps`.
    batch : int, optional
        Patches of a step. Default: 131,072 pixels' worth, the paper's 128 images of 32 x 32.
    patch : int, optional
        Height and width of a patch. Default: 64, or the side of the smallest image.
    rng : int, optional
        The seed of patches and bits: the same seed gives the same network, bit for bit, for any
        number of threads on one kind of processor. Default: a new one.
    test : array or sequence of arrays, optional
        Images, whole, on which the PSNR is measured now and then, always with the same bits.
    admissible : AdmissibleSet, optional
        𝒜. Default: `jotlight.training.SafeSet()`.
    checkpoint : path, optional
        Where the state is kept: every 20 seconds, at the end, and when the run is stopped by
        Ctrl-C or by an error.
    resume : bool
        Go on from the checkpoint. The result is that of a run that was not stopped.
    callback : callable, optional
        Called with the :class:`Record` of each step.
    threads : int, optional
        Threads to use. Default: all.

    Returns
    -------
    network : Network
        The learned network; its `history` tells how it was learned.
    history : History
        Cost, gradient norm and test PSNR by step. The last record belongs to the result: it has one
        more record than steps.

    Raises
    ------
    TypeError, ValueError
        When network, sensor, images and settings do not fit, or the checkpoint is of another run.
    FloatingPointError
        When the cost is not a number or has grown for many steps; the message says what to lower.

    Notes
    -----
    Pixels of a patch that the network would estimate with the help of what lies outside of it do
    not count, unless the image ends there too.

    Examples
    --------
    >>> from jotlight import Sensor, datasets
    >>> sensor = Sensor(oversampling=3)
    >>> start = Network.initial(sensor)
    >>> learned, history = train(start, datasets.uniform_scenes, steps=3, batch=16, rng=0)
    >>> bool(history.loss[-1] < history.loss[0])
    True
    """
    sensor = network.sensor if sensor is None else sensor
    network._check_sensor(sensor)
    if isinstance(optimiser, str):
        if optimiser not in OPTIMISERS:
            raise ValueError(
                f"optimiser: expected one of {', '.join(OPTIMISERS)}, got {optimiser!r}"
            )
        chosen: Optimiser = OPTIMISERS[optimiser]()
    else:
        chosen = optimiser
    steps = _at_least("steps", chosen.steps if steps is None else steps, 0)
    seed = secrets.randbits(32) if rng is None else _at_least("rng", rng, 0)
    admissible = SafeSet() if admissible is None else admissible
    examples = _examples(network, sensor, images, patch, batch, seed)
    tests = None
    if test is not None:
        tests = dataclasses.replace(examples, images=checked_scenes(test), side=None).every()

    run = {
        "network": _fingerprint(network),
        "sensor": examples.sensor.numbers(),
        "images": examples.fingerprint(),
        "test": None
        if tests is None
        else dataclasses.replace(examples, images=tests["images"]).fingerprint(),
        "optimiser": repr(chosen),
        "admissible": repr(admissible),
        "steps": steps,
        "batch": examples.patches,
        "patch": examples.side,
        "seed": seed,
    }
    if resume:
        if checkpoint is None:
            raise ValueError("resume: expected a checkpoint to resume from, got none")
        at = Checkpoint.load(checkpoint, run)
        if at.vector.shape != vector_of(network).shape or len(at.history) > steps:
            raise ValueError(f"{checkpoint}: damaged checkpoint: it does not fit the network")
    else:
        start = admissible.project(network, vector_of(network))
        at = Checkpoint(run, start, {}, History())
    try:
        if checkpoint is not None:
            at.save(checkpoint)
        saved = time.monotonic()
        while len(at.history) < steps:
            cost = Cost(network, examples, len(at.history), steps, admissible, threads)
            at = _advanced(at, cost, chosen, tests, threads)
            if callback is not None:
                callback(at.history.records[-1])
            if checkpoint is not None and time.monotonic() - saved > _SAVE_EVERY:
                at.save(checkpoint)
                saved = time.monotonic()
    finally:
        # Also when Ctrl-C or an error ended the loop: `at` is always the state between two steps.
        if checkpoint is not None:
            at.save(checkpoint)
    last = Cost(network, examples, steps, steps, admissible, threads)
    loss, gradient = last.gradient(at.vector)
    psnr = None if tests is None else mean_psnr(network, at.vector, tests, threads)
    record = Record(steps, loss, float(np.linalg.norm(gradient)), psnr)
    if callback is not None:
        callback(record)
    history = History([*at.history.records, record])
    learned = network_of(network, at.vector)
    learned.history.update({"run": run, "records": history.to_json()})
    return learned, history


def _advanced(
    at: Checkpoint,
    cost: Cost,
    optimiser: Optimiser,
    tests: dict[str, Any] | None,
    threads: int | None,
) -> Checkpoint:
    """The state one step further on."""
    psnr = None
    if tests is not None and cost.step % max(1, cost.steps // _TESTS) == 0:
        psnr = mean_psnr(cost.network, at.vector, tests, threads)
    step = optimiser.take_step(cost, at.vector, at.state)
    norm = float(np.linalg.norm(step.gradient))
    if not (np.isfinite(step.loss) and np.isfinite(norm) and np.isfinite(step.vector).all()):
        raise FloatingPointError(
            f"step {cost.step}: the cost or its gradient is not a number (cost {step.loss}, "
            f"gradient norm {norm}); lower {optimiser.lower} of {optimiser}"
        )
    records = [*at.history.records, Record(cost.step, step.loss, norm, psnr)]
    recent = [record.loss for record in records[-10:]]
    if len(records) > 10 and min(recent) > _WORSE * records[0].loss:
        raise FloatingPointError(
            f"step {cost.step}: the cost has grown from {records[0].loss:.4g} to "
            f"{recent[-1]:.4g}; lower {optimiser.lower} of {optimiser}"
        )
    return Checkpoint(at.run, step.vector, step.state, History(records))


def _examples(
    network: Network,
    sensor: Sensor,
    images: Images,
    patch: int | None,
    batch: int | None,
    seed: int,
) -> Examples:
    seen = sensor_of_patches(sensor)
    reach = () if seen.kernel == "box" else (2,)
    border = network.halo + sum(reach)
    batch = None if batch is None else _at_least("batch", batch, 1)
    if callable(images):
        if patch is not None:
            raise ValueError("patch: is for images; what a callable makes is seen whole")
        return Examples(images, seen, seed, batch or 128, None, border)
    scenes = checked_scenes(images)
    side = side_of_patches(scenes, patch)
    return Examples(scenes, seen, seed, batch or max(1, _PIXELS // side**2), side, border)


def _fingerprint(network: Network) -> str:
    digest = hashlib.sha256(vector_of(network).tobytes())
    for layer in network.layers:
        digest.update(repr((layer.filters.shape, layer.start, layer.spacing)).encode())
    return digest.hexdigest()


def _at_least(name: str, value: int, least: int) -> int:
    value = operator.index(value)
    if value < least:
        raise ValueError(f"{name}: expected {least} or more, got {value}")
    return value
