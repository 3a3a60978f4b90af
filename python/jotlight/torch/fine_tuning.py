"""Fine-tuning of a network on the bits of one capture, without ground truth."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jotlight.array_types import Array
from jotlight.checks import positive_number, whole_number
from jotlight.networks.loading import require_network
from jotlight.networks.network import Network
from jotlight.networks.stages import with_run
from jotlight.parameter_names import other_names, takes_rng
from jotlight.progress import Progress
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.data.pixel_counts import (
    PixelCounts,
    count_pixels,
    gray_images,
    prepare_data,
)
from jotlight.sensing.data.scaled_counts import check_whole
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor, require_trainable
from jotlight.torch.bit_splitting import BitSplitter, check_kernel
from jotlight.torch.distributed import ProcessGroup, choose_device, process_group, thread_limit
from jotlight.torch.network import Network as TorchNetwork
from jotlight.torch.trainer import Trainer, recorded_gradients
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import History, Record, RecordCallback
from jotlight.training.images import fingerprint_images
from jotlight.training.optimizer_protocol import State
from jotlight.training.parameters import fingerprint_network
from jotlight.training.reporting import shown_steps

STEPS = 500
"""Default number of steps."""

BATCH = 16
"""Default number of patches per step."""

PATCH = 48
"""Default height and width of a patch, in pixels, unless the image is smaller."""

LEARNING_RATE = 5e-4
"""Default learning rate."""


@takes_rng
@other_names(
    epochs="steps= for the length of the run",
    batch_size="batch= for the number of patches of a step",
    lr="learning_rate= for the step size",
)
def fine_tune(
    network: Network,
    data: Bits | npt.ArrayLike,
    sensor: Sensor | None = None,
    *,
    channel_axis: int | None = None,
    steps: int = STEPS,
    batch: int | None = None,
    patch: int | None = None,
    learning_rate: float = LEARNING_RATE,
    rng: int | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    callback: RecordCallback | None = None,
    progress: Progress = None,
    device: str | torch.device | None = None,
    threads: int | None = None,
) -> tuple[Network, History]:
    """Return a network that is better for a capture, trained on the bits of that capture alone.

    The bits of a pixel are independent given the light. Each step splits them at random: 60 to 90 %
    are the input of the network, and the cost is the negative log-likelihood of the others. One
    tenth of all bits is held out from every step, and selects the best parameters. Where each pixel
    has a single bit, each step hides some pixels from the network, and their bits are the target.

    Parameters
    ----------
    network : Network
        Starting point: a tied network, preferably a K-conditioned one
        (``Network.conditional``) that was trained on photographs. A network for one K gets the
        counts of fewer bits, scaled to its K.
    data : Bits or array_like of int
        The capture: bits, or counts L of shape (..., H, W). The images of a stack and the channels
        of a color capture train together.
    sensor : Sensor, optional
        Sensor of the capture, with the box kernel. Its dead jots, dark counts, and efficiency enter
        as in :meth:`jotlight.Network.reconstruct`, which states the default, too.
    channel_axis : int, optional
        Axis of counts that holds color channels. Default: none.
    steps : int
        Number of steps of Adam. The learning rate rises over the first tenth of them and then falls
        to 0.
    batch : int, optional
        Number of patches per step, randomly rotated and mirrored. Default: 16.
    patch : int, optional
        Height and width of a patch. Default: 48, or the smaller side of the image.
    learning_rate : float
        Largest learning rate: about the largest change of a parameter per step.
    rng : int, optional
        Seed. The same seed and number of threads lead to the same network. Default: a fresh one,
        or that of the run to resume.
    checkpoint, resume, callback, progress, device, threads
        As for :func:`jotlight.torch.train`.

    Returns
    -------
    network : Network
        The network with the highest likelihood of the held-out bits, among about 20 sets of
        parameters from the run. The start is one of them.
    history : History
        `loss` is the negative log-likelihood of the target bits of each step, and `held_out` that
        of the held-out bits, measured about 20 times, in nats per bit. The last record belongs to
        the result.

    Raises
    ------
    TypeError, ValueError
        When network, data, sensor, and settings do not fit, when no pixel has a valid bit, or when
        the checkpoint belongs to another run.
    FloatingPointError
        When the likelihood is not finite; the message says what to change.

    Warns
    -----
    JotlightWarning
        When pixels without a valid bit were inpainted from their neighbors.

    Notes
    -----
    Under PyTorch's launcher several processes share the patches of each step, as in
    :func:`jotlight.torch.train`.

    Examples
    --------
    >>> sensor = jl.Sensor(frames=8)
    >>> bits = sensor.expose(np.full((24, 24), 0.4), rng=0)
    >>> start = jl.Network.conditional("small", rng=0)
    >>> tuned, history = fine_tune(start, bits, steps=10, batch=4, rng=0)
    >>> bool(history.held_out[-1] < history.held_out[0])
    True
    """
    require_network(
        "network", network, Network, "jotlight.torch.fine_tune(jotlight.pretrained(sensor), bits)"
    )
    channels, sensor = _count_images(network, data, sensor, channel_axis, threads)
    chosen_device = choose_device(device)
    steps = whole_number("steps", steps, 1)
    batch = whole_number("batch", BATCH if batch is None else batch, 1)
    learning_rate = positive_number("learning_rate", learning_rate)
    side = _patch_side(channels, patch)
    with (
        recorded_gradients(),
        process_group(chosen_device) as group,
        thread_limit(threads),
        shown_steps(group.is_main and progress, steps, callback) as report,
    ):
        network = group.shared(network)
        seed = group.shared(Checkpoint.choose_seed(rng, checkpoint, resume))
        settings: dict[str, object] = {
            "network": fingerprint_network(network),
            "sensor": sensor.scalars(),
            "capture": _fingerprint(channels),
            "optimizer": f"Adam(learning_rate={learning_rate})",
            "steps": steps,
            "batch": batch,
            "patch": side,
            "seed": seed,
        }
        splitter = BitSplitter(network, sensor, channels, generator_of_purpose(seed, 0))
        module = TorchNetwork(network).to(chosen_device)
        tuner = FineTuner(module, splitter, settings, learning_rate, seed, batch, side, group)
        tuner.begin(checkpoint, resume)
        tuner.run(steps, checkpoint, report)
        last = tuner.restore_best()
        if group.is_main:
            report(last)
    history = History([*tuner.history.records, last])
    tuned = module.to_network()
    records = history.subsample().to_json()
    tuned.history = with_run(network.history, "fine-tune", settings, records)
    return tuned, history


class FineTuner(Trainer):
    """A run on the bits of a capture, with the best parameters so far.

    Parameters
    ----------
    module, settings, learning_rate, group
        See :class:`Trainer`.
    splitter : BitSplitter
        Source of inputs and targets.
    seed : int
        Seed of the splits.
    batch : int
        Number of patches per step, over all processes.
    side : int
        Height and width of a patch, in pixels.
    """

    state_names = (*Trainer.state_names, "best")

    def __init__(
        self,
        module: TorchNetwork,
        splitter: BitSplitter,
        settings: dict[str, object],
        learning_rate: float,
        seed: int,
        batch: int,
        side: int,
        group: ProcessGroup,
    ) -> None:
        super().__init__(module, settings, learning_rate, group)
        self.splitter, self.seed, self.batch, self.side = splitter, seed, batch, side
        self.best: Array = self.parameter_vector()
        """Parameters with the lowest held-out value."""
        self.best_held_out = math.inf
        """Their negative log-likelihood of the held-out bits, in nats per bit."""

    def loss(self, step: int) -> Tensor:
        """Return this process's part of the negative log-likelihood of the target bits."""
        split = self.splitter.draw(generator_of_purpose(self.seed, 1, step), self.batch, self.side)
        own = split.select(self.group.shard)
        estimates = self.splitter.estimate(
            self.module.run_layers, own.to(self.parameters[0].device)
        )
        loss = self.splitter.negative_log_likelihood(estimates, own)
        return loss * (own.target_bits / max(split.target_bits, 1))

    def record(self, step: int, loss: float, gradient_norm: float, *, is_test: bool) -> Record:
        """Return the record of a step, in nats per bit."""
        return Record(step, loss, gradient_norm, None, self._test() if is_test else None)

    def update(self) -> None:
        """Change the parameters, and keep the outputs in the sensor's range."""
        super().update()
        self._clamp_outputs()

    def restore_best(self) -> Record:
        """Return to the best parameters, and return the record of a step from there."""
        self._test()
        self.set_parameters(self.best)
        last = self.measure(len(self.history), is_test=False)
        return dataclasses.replace(last, held_out=self.best_held_out)

    def state(self) -> State:
        """Return what the next step needs besides parameters and records."""
        return {**super().state(), "best": self.best}

    def restore(self, checkpoint: Checkpoint, path: str | os.PathLike[str]) -> None:
        """Continue from a checkpoint; see :meth:`Trainer.restore`."""
        super().restore(checkpoint, path)
        self.best = checkpoint.state["best"]
        self.best_held_out = float(np.nanmin(self.history.held_out, initial=math.inf))

    def _test(self) -> float:
        """Return the value for the held-out bits, and remember the best parameters."""
        network = self.module.to_network()
        value = self.splitter.held_out_negative_log_likelihood(network, torch.get_num_threads())
        # On different machines the last digits may differ, and so would the best parameters.
        shared = torch.tensor(value, dtype=torch.float64)
        self.group.broadcast(shared)
        value = float(shared)
        if value < self.best_held_out:
            self.best, self.best_held_out = self.parameter_vector(), value
        return value

    def _clamp_outputs(self) -> None:
        """Clamp the coefficients of a trainable last spline to the sensor's range."""
        origin = self.module.origin
        last = len(origin.layers) - 1
        start = origin.layers[last].coefficients
        if start is None or origin.layers[last].trainable != "all":
            return
        # The values of a spline lie between its smallest and its largest coefficient.
        low, high = min(0.0, float(start.min())), origin.sensor.max_intensity
        with torch.no_grad():
            self.module.coefficients[str(last)].clamp_(low, max(high, float(start.max())))


def generator_of_purpose(seed: int, *key: int) -> np.random.Generator:
    """Return the generator of one purpose of a run; the key (0,) stands for the held-out bits.

    Examples
    --------
    >>> one, same = (generator_of_purpose(3, 1, 7) for _ in range(2))
    >>> bool(one.integers(10) == same.integers(10))
    True
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _count_images(
    network: Network,
    data: Bits | npt.ArrayLike,
    sensor: Sensor | None,
    channel_axis: int | None,
    threads: int | None,
) -> tuple[list[PixelCounts], Sensor]:
    """Return the counts of each gray image, whose bits can be split, and their sensor."""
    if isinstance(data, Merged):
        raise TypeError("data: expected Bits or counts, because merged counts cannot be split")
    sensor = sensor or network.sensor_of(data)
    if sensor is not None:
        require_trainable(sensor)
        if isinstance(data, np.ndarray):
            check_whole(data, sensor.trials, takes_trials=False)
    prepared, sensor = prepare_data(data, sensor, None, channel_axis)
    network.check_sensor(sensor)
    if not network.tied:
        raise ValueError(
            "network: expected a tied network, which takes counts: the bits of a pixel can only be "
            "split at random if all its jots have the same weight"
        )
    check_kernel(sensor)
    images = gray_images(prepared)
    channels = [count_pixels(image, sensor, threads) for image in images.data]
    if any(channel.varies_within_pixels for channel in channels):
        raise ValueError(
            "sensor: expected jots with the same efficiency and dark counts inside each pixel, "
            "since its bits are split at random; use the means over the pixels"
        )
    return channels, sensor


def _patch_side(channels: Sequence[PixelCounts], patch: int | None) -> int:
    """Return the height and width of patches, after a check against the image."""
    max_side = min(channels[0].counts.shape)
    side = min(PATCH, max_side) if patch is None else whole_number("patch", patch, 0)
    if not 1 <= side <= max_side:
        raise ValueError(f"patch: expected 1 to the {max_side} pixels of the image, got {side}")
    return side


def _fingerprint(channels: Sequence[PixelCounts]) -> str:
    """Return a digest that identifies the counts of a capture and the parameters of its jots."""
    fields = [(x.counts, x.trials, x.efficiency, x.dark_counts) for x in channels]
    return fingerprint_images([np.asarray(array) for arrays in fields for array in arrays])
