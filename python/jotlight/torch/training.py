"""Learning the parameters of deep members with PyTorch."""

import os
import secrets
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

import jotlight
from jotlight import metrics
from jotlight.checks import positive_number, whole_number
from jotlight.sensing.sensor import Sensor
from jotlight.torch.distributed import Processes, place, together, with_threads
from jotlight.torch.network import Network
from jotlight.torch.patches import Patches
from jotlight.torch.trainer import Trainer
from jotlight.training.history import History, Record
from jotlight.training.images import (
    ImageGenerator,
    Images,
    TrainingImages,
    check_images,
    fingerprint_images,
    generate_images,
)
from jotlight.training.parameters import fingerprint_network
from jotlight.training.patches import patch_sensor, patch_size

STEPS = 20_000
BATCH, PATCH = 16, 48
RATE = 3e-3


def train(
    network: jotlight.Network,
    images: TrainingImages,
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
        Where to start, such as ``jotlight.Network.residual(sensor, "small")``, or
        ``jotlight.Network.conditional("medium")`` for a network that serves many K and any exposure.
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
    >>> start = jotlight.Network.residual(jotlight.Sensor(oversampling=4), "small", rng=0)
    >>> learned, history = train(start, jotlight.datasets.uniform_scenes, steps=3, patch=32, rng=0)
    >>> len(history)
    4
    """
    sensor = network.sensor if sensor is None else sensor
    network.check_sensor(sensor)
    here = place(device)
    steps = whole_number("steps", STEPS if steps is None else steps, 1)
    batch = whole_number("batch", BATCH if batch is None else batch, 1)
    positive_number("rate", rate)
    if seconds is not None and not seconds > 0:
        raise ValueError(f"seconds: expected a number above 0, got {seconds}")
    scenes: Images | ImageGenerator = images if callable(images) else check_images(images)
    seen = generate_images(scenes, np.random.default_rng(0), 1) if callable(scenes) else scenes
    side = patch_size(seen, patch)
    if patch is None:
        side = min(PATCH, side)
    tests = None if test is None else check_images(test)
    with together(here) as processes:
        if batch < processes.number:
            raise ValueError(
                f"batch: expected at least a patch for each of the {processes.number} processes, "
                f"got {batch}"
            )
        seed = torch.tensor(secrets.randbits(32) if rng is None else whole_number("rng", rng, 0))
        processes.spread(seed)
        patches = Patches(scenes, network, patch_sensor(sensor), int(seed), batch, side)
        run: dict[str, object] = {
            "network": fingerprint_network(network),
            "sensor": patches.sensor.scalars(),
            "images": fingerprint_images(scenes),
            "test": None if tests is None else fingerprint_images(tests),
            "optimizer": f"Adam(learning_rate={rate})",
            "steps": steps,
            "batch": batch,
            "patch": patches.side,
            "seed": int(seed),
        }
        with with_threads(threads):
            module = Network(network).to(here)
            trainer = Learning(module, patches, run, rate, tests, processes)
            trainer.begin(checkpoint, resume)
            trainer.run(steps, checkpoint, callback, seconds)
            last = trainer.measure(len(trainer.history), tested=True)
            if processes.first and callback is not None:
                callback(last)
    history = History([*trainer.history.records, last])
    told = {**network.history, "run": run, "records": history.subsample().to_json()}
    learned = trainer.module.network()
    if network.trials_range is None:
        learned = jotlight.Network(learned.layers, sensor)
    learned.history = told
    return learned, history


class Learning(Trainer):
    """A run on patches of images."""

    def __init__(
        self,
        module: Network,
        patches: Patches,
        run: dict[str, object],
        rate: float,
        tests: Images | None,
        processes: Processes,
    ) -> None:
        super().__init__(module, run, rate, processes)
        self.patches, self.tests = patches, tests

    def loss(self, step: int) -> Tensor:
        """Give the mean square error of a patch, of this process's patches."""
        views = self.patches.views(step, self.processes.share, torch.get_num_threads())
        views = views.to(self.parameters[0].device)
        return views.errors(self.module).sum() / self.patches.batch

    def record(self, step: int, cost: float, norm: float, *, tested: bool) -> Record:
        """Give the record of a step: ε of a whole patch."""
        psnr = self._test() if tested and self.tests is not None else None
        return Record(step, 0.5 * self.patches.side**2 * cost, norm, psnr)

    def _test(self) -> float:
        """Mean PSNR of the test images in dB, for a peak of 1, always with the same bits."""
        assert self.tests is not None
        network, sensor = self.module.network(), self.patches.sensor
        found = []
        for number, image in enumerate(self.tests):
            seed = np.random.SeedSequence(self.patches.seed, spawn_key=(2**32 - 1, number))
            estimate = network.reconstruct(sensor.expose(image, seed), sensor)
            found.append(metrics.psnr(estimate, image, peak=1.0))
        return float(np.mean(found))
