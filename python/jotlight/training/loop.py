"""Learning: from a network and images to a better network."""

import dataclasses
import hashlib
import math
import os
import secrets
import time
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from jotlight.checks import whole_number
from jotlight.networks.graph import is_sequential
from jotlight.networks.network import Network
from jotlight.sensing.sensor import Sensor
from jotlight.training.admissible import AdmissibleSet, SafeSet
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.cost import Cost, mean_psnr
from jotlight.training.history import History, Record
from jotlight.training.optimizers import OPTIMIZERS, Optimizer, Step
from jotlight.training.parameters import Vector, parameter_vector, with_parameters
from jotlight.training.patches import (
    ImageGenerator,
    Images,
    PatchSampler,
    check_images,
    generate_images,
    patch_sensor,
    patch_size,
)

TrainingImages = npt.NDArray[np.floating] | Sequence[npt.ArrayLike] | ImageGenerator

_TESTS = 100
"""Tests of a run, at most."""

_SAVE_EVERY = 20.0
"""Seconds between two checkpoints."""

_WORSE = 2.0
"""A run whose parameters cost so many times what those at its start cost has gone astray."""


def train(
    network: Network,
    images: TrainingImages,
    sensor: Sensor | None = None,
    *,
    optimizer: str | Optimizer = "gauss-newton",
    steps: int | None = None,
    seconds: float | None = None,
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
        gives so many new images in an array (N, H, W); each step then sees new ones, whole. A
        checkpoint tells callables apart by their names only.
    sensor : Sensor, optional
        Default: the network's. The learned network is for this sensor. Maps of its dark counts
        enter by their median, and dead jots not at all: where they lie does not matter to a patch.
    optimizer : {"gauss-newton", "adam", "projected-gradient"} or Optimizer
        One of `jotlight.training`, by name or with settings of your own.
    steps : int, optional
        Default: the optimizer's `steps`.
    seconds : float, optional
        Stop before the step that would take the run past so many seconds, but not before the first.
        How many steps that gives depends on the machine; the same number of steps gives the same
        network. Default: no limit.
    batch : int, optional
        Patches of a step. Default: 2^20 pixels' worth for Gauss-Newton, and else 2^17, which are
        the paper's 128 images of 32 x 32.
    patch : int, optional
        Height and width of a patch. Default: 64, or the side of the smallest image.
    rng : int, optional
        The seed of patches and bits: the same seed gives the same network on one machine, bit for
        bit, whatever `threads` is. Default: a new one.
    test : array or sequence of arrays, optional
        Images, whole, on which the PSNR is measured now and then, always with the same bits.
    admissible : AdmissibleSet, optional
        𝒜. Default: `jotlight.training.SafeSet()`.
    checkpoint : path, optional
        Where the state is kept: after the first step, every 20 seconds, at the end, and when the
        run is stopped by Ctrl-C or by an error. An older checkpoint there is overwritten.
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
    network.check_sensor(sensor)
    if not is_sequential(network.layers):
        raise ValueError(
            "network: expected layers that each filter and bend what the one before gave; others "
            "learn with PyTorch, jotlight.torch.train"
        )
    chosen = _optimizer(optimizer)
    steps = whole_number("steps", chosen.steps if steps is None else steps, 0)
    seed = secrets.randbits(32) if rng is None else whole_number("rng", rng, 0)
    admissible = SafeSet() if admissible is None else admissible
    if threads is not None:
        whole_number("threads", threads, 1)
    if seconds is not None and not seconds > 0:
        raise ValueError(f"seconds: expected a number above 0, got {seconds}")
    examples = _examples(network, sensor, images, patch, batch, chosen.pixels, seed)
    tests = None
    if test is not None:
        tests = dataclasses.replace(examples, images=check_images(test), side=None).whole_images()

    run = {
        "network": fingerprint_network(network),
        "sensor": examples.sensor.scalars(),
        "images": examples.fingerprint(),
        "test": None
        if tests is None
        else dataclasses.replace(examples, images=tests["images"]).fingerprint(),
        "optimizer": repr(chosen),
        "admissible": repr(admissible),
        "steps": steps,
        "batch": examples.patches,
        "patch": examples.side,
        "seed": seed,
    }
    start = admissible.project(network, parameter_vector(network))
    at = Checkpoint(run, start, {}, History())
    if resume:
        if checkpoint is None:
            raise ValueError("resume: expected a checkpoint to resume from, got none")
        at = Checkpoint.load(checkpoint, run)
        if at.vector.shape != start.shape or len(at.history) > steps:
            raise ValueError(f"{checkpoint}: damaged checkpoint: it does not fit the network")
        if not np.allclose(admissible.project(network, at.vector), at.vector, rtol=0, atol=1e-6):
            raise ValueError(f"{checkpoint}: damaged checkpoint: its parameters are not in the set")
    elif checkpoint is not None:
        Checkpoint.refuse_overwrite(checkpoint)
    try:
        saved, saved_at = len(at.history), -math.inf
        begun, longest = time.monotonic(), 0.0
        while len(at.history) < steps:
            now = time.monotonic()
            # A step, and the look at where it led.
            if seconds is not None and longest and now - begun + 2 * longest > seconds:
                break
            cost = Cost(network, examples, len(at.history), steps, admissible, threads)
            loaded = resume and len(at.history) == saved
            step = _take_step(at, cost, chosen, resumed_from=checkpoint if loaded else None)
            psnr = None
            if tests is not None and cost.step % max(1, steps // _TESTS) == 0:
                psnr = mean_psnr(network, at.vector, tests, threads)
            norm = float(np.linalg.norm(step.gradient))
            record = Record(cost.step, step.loss, norm, psnr)
            _check_trainer(record, step, [*at.history.records, record], cost, start, chosen)
            at = Checkpoint(run, step.vector, step.state, History([*at.history.records, record]))
            if callback is not None:
                callback(at.history.records[-1])
            if checkpoint is not None and time.monotonic() - saved_at > _SAVE_EVERY:
                at.save(checkpoint)
                saved, saved_at = len(at.history), time.monotonic()
            longest = max(longest, time.monotonic() - now)
    finally:
        # Also when Ctrl-C or an error ended the loop: `at` is always the state between two steps.
        if checkpoint is not None and len(at.history) > saved:
            at.save(checkpoint)
    taken = len(at.history)
    last = Cost(network, examples, taken, steps, admissible, threads)
    loss, gradient = last.gradient(at.vector)
    psnr = None if tests is None else mean_psnr(network, at.vector, tests, threads)
    record = Record(taken, loss, float(np.linalg.norm(gradient)), psnr)
    if callback is not None:
        callback(record)
    history = History([*at.history.records, record])
    told = {**network.history, "run": run, "records": history.to_json()}
    return Network(with_parameters(network, at.vector).layers, sensor, told), history


def _optimizer(optimizer: str | Optimizer) -> Optimizer:
    if isinstance(optimizer, str):
        if optimizer not in OPTIMIZERS:
            raise ValueError(
                f"optimizer: expected one of {', '.join(OPTIMIZERS)}, got {optimizer!r}"
            )
        return OPTIMIZERS[optimizer]()
    if isinstance(optimizer, type) or not hasattr(optimizer, "take_step"):
        raise TypeError(
            f"optimizer: expected one of {', '.join(OPTIMIZERS)} or an object with take_step, such "
            f"as jotlight.training.Adam(), got {optimizer!r}"
        )
    return optimizer


def _take_step(
    at: Checkpoint,
    cost: Cost,
    optimizer: Optimizer,
    resumed_from: str | os.PathLike[str] | None,
) -> Step:
    try:
        return optimizer.take_step(cost, at.vector, at.state)
    except (KeyError, ValueError, TypeError) as error:
        if resumed_from is None:
            raise
        raise ValueError(
            f"{resumed_from}: damaged checkpoint: {optimizer} cannot go on from it ({error})"
        ) from error


def _check_trainer(
    record: Record,
    step: Step,
    records: list[Record],
    cost: Cost,
    start: Vector,
    optimizer: Optimizer,
) -> None:
    """Raise FloatingPointError where a run has gone astray."""
    with np.errstate(over="ignore"):
        usable = np.isfinite(step.vector.astype(np.float32)).all()
    if not (np.isfinite([record.loss, record.gradient_norm]).all() and usable):
        raise FloatingPointError(
            f"step {record.step}: not a number any more (cost {record.loss:.4g}, gradient norm "
            f"{record.gradient_norm:.4g}); {optimizer.advice}, now {optimizer}"
        )
    recent = [record.loss for record in records[-10:]]
    if len(recent) < 10 or np.mean(recent) < 1.5 * records[0].loss:
        return
    # Other patches may just be harder: the start has to be better on the same ones.
    at_start = cost.value(start)
    if record.loss > _WORSE * at_start:
        raise FloatingPointError(
            f"step {record.step}: the run diverges: its network costs {record.loss:.4g} where that "
            f"at the start costs {at_start:.4g}; {optimizer.advice}, now {optimizer}"
        )


def _examples(
    network: Network,
    sensor: Sensor,
    images: TrainingImages,
    patch: int | None,
    batch: int | None,
    pixels: int,
    seed: int,
) -> PatchSampler:
    seen = patch_sensor(sensor)
    # A smooth kernel brings light from two pixels away, which a patch does not know.
    border = network.halo + (0 if seen.kernel == "box" else 2)
    batch = None if batch is None else whole_number("batch", batch, 1)
    if callable(images):
        if patch is not None:
            raise ValueError("patch: is for images; what a callable makes is seen whole")
        if batch is None:
            one = generate_images(images, np.random.default_rng(0), 1)[0]
            batch = max(1, pixels // one.size)
        return PatchSampler(images, seen, seed, batch, None, border)
    scenes = check_images(images)
    side = patch_size(scenes, patch)
    if side <= 2 * border and any(max(image.shape) > side for image in scenes):
        raise ValueError(
            f"patch: expected more than {2 * border} pixels, got {side}: the network sees {border} "
            f"pixels past its rim, so that none would count. {_smallest(scenes)}"
        )
    return PatchSampler(scenes, seen, seed, batch or max(1, pixels // side**2), side, border)


def _smallest(scenes: Images) -> str:
    index = min(range(len(scenes)), key=lambda index: min(scenes[index].shape))
    height, width = scenes[index].shape
    return f"The smallest image, number {index}, is {height} x {width}; leave out what is too small"


def fingerprint_network(network: Network) -> str:
    """Give a word that tells this network from others."""
    digest = hashlib.sha256(parameter_vector(network).tobytes())
    for layer in network.layers:
        digest.update(repr((layer.filters.shape, layer.metadata())).encode())
    return digest.hexdigest()
