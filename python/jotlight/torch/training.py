"""Training of deep networks on images: `jotlight.torch.train`."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import torch

from jotlight.checks import positive_number, whole_number
from jotlight.networks.loading import require_network
from jotlight.networks.network import Network
from jotlight.networks.planes_network import ColorNetwork, FilmNetwork, PlanesNetwork
from jotlight.networks.precision import F32
from jotlight.networks.stages import with_run
from jotlight.parameter_names import check_choice, other_names, other_training_names, takes_rng
from jotlight.progress import Progress
from jotlight.sensing.parameters.intensity_scale import warn_about_scale
from jotlight.sensing.sensor import Sensor
from jotlight.torch.ahead import AheadLoader
from jotlight.torch.color_patches import ColorPatchLoader
from jotlight.torch.distributed import choose_device, process_group, thread_limit
from jotlight.torch.film_patches import FilmPatchLoader
from jotlight.torch.image_trainer import ImageTrainer
from jotlight.torch.network import Network as TorchNetwork
from jotlight.torch.optimizers import OPTIMIZERS
from jotlight.torch.patches import PatchLoader
from jotlight.torch.planes_network import PlanesNetwork as TorchPlanesNetwork
from jotlight.torch.precision import filter_dtype_of
from jotlight.torch.trainer import recorded_gradients
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import History, RecordCallback
from jotlight.training.images import Images, TrainingImages, check_images, fingerprint_images
from jotlight.training.parameters import fingerprint_network
from jotlight.training.patch_sources import ImagePatches, PatchSource, as_patch_source
from jotlight.training.patches import patch_sensor, trained_sensor
from jotlight.training.reporting import shown_steps

STEPS = 20_000
"""Default number of steps."""

BATCH = 16
"""Default number of patches per step."""

PATCH = 48
"""Default height and width of a patch, in pixels, unless the smallest image is smaller."""

LEARNING_RATE = 3e-3
"""Default learning rate."""


# A run has many settings, each of them documented; all but the first three are keyword-only.
@takes_rng
@other_training_names
@other_names(lr="learning_rate= for the step size")
def train(
    network: Network,
    images: TrainingImages | PatchSource,
    sensor: Sensor | None = None,
    *,
    steps: int | None = None,
    seconds: float | None = None,
    batch: int | None = None,
    patch: int | None = None,
    learning_rate: float = LEARNING_RATE,
    optimizer: str = "muon",
    precision: str = F32,
    rng: int | None = None,
    test: npt.NDArray[np.floating] | Sequence[npt.ArrayLike] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
    callback: RecordCallback | None = None,
    progress: Progress = None,
    device: str | torch.device | None = None,
    threads: int | None = None,
) -> tuple[Network, History]:
    """Return a network with the smallest mean square error for a sensor and images.

    Each step draws new patches, randomly rotated and mirrored, and new bits. The learning rate
    rises over the first tenth of the steps and then falls to 0. The result is an exponential moving
    average of the parameters over about 1,000 steps, so a run that stops early is also good.

    Parameters
    ----------
    network : Network, ColorNetwork, or FilmNetwork
        Starting point, such as ``Network.residual(sensor, "small")``, or
        ``Network.conditional("medium")`` for a network that serves a range of K at any exposure.
    images : array (N, H, W), sequence of arrays (H, W), callable, or PatchSource
        Gray images of intensities, as in :func:`jotlight.train`. A
        :class:`jotlight.training.PatchSource` draws patches itself, such as
        :class:`~jotlight.training.PhotographPatches` with random scales and planes, or a
        :class:`~jotlight.training.PatchMixture` of several sources.
    sensor : Sensor, optional
        Sensor that the trained network is for. A K-conditioned network is only tested with it.
        Default: the one for which :func:`jotlight.pretrained` was called, else the network's.
    steps : int, optional
        Number of steps. Default: 20,000.
    seconds : float, optional
        Time limit. The run stops before the step that would exceed it, but takes one step. The
        learning rate has then not fallen to 0. Default: no limit.
    batch : int, optional
        Number of patches per step. Default: 16.
    patch : int, optional
        Height and width of a patch. Default: 48, or the side of the smallest image, or of the
        first image of a callable.
    learning_rate : float
        Largest learning rate: about the largest change of a parameter per step.
    optimizer : str
        ``"muon"``: :class:`~jotlight.torch.Muon`, which needs fewer steps than Adam for networks
        of the size medium and above, or ``"adam"``.
    precision : str
        ``"f32"``, or ``"bf16"`` for products of filter banks in bfloat16, which some
        processors compute faster; :func:`~jotlight.torch.fastest_precision` measures it. The
        network of two layers refuses ``"bf16"``.
    rng : int, optional
        Seed of patches and bits. The same seed and number of threads lead to the same network on
        one CPU; another number of threads can lead to another one. Default: a fresh one, or that of
        the run to resume.
    test : array or sequence of arrays, optional
        Images, whole, whose PSNR for a peak of 1 is measured about 20 times, always with the same
        bits.
    checkpoint : path, optional
        File for the state of the run, as in :func:`jotlight.train`.
    resume : bool
        Whether to continue from the checkpoint.
    callback : callable, optional
        Function that gets the :class:`Record` of each step. By raising StopIteration it ends the
        run, which then returns the network so far.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called with the completed fraction.
        Default: a bar in notebooks.
    device : str or torch.device, optional
        Device of the training. Default: a GPU if there is one, and the CPU otherwise.
    threads : int, optional
        Number of CPU threads. Default: PyTorch's.

    Returns
    -------
    network : Network
        The trained network, in the precision of the one at the start. The last of the `stages` in
        its `history` holds the settings and about 500 of the records.
    history : History
        Cost ε, gradient norm, and test PSNR of each step. The last record belongs to the result,
        so there is one more record than steps. Its `step` is the number of steps that were taken.

    Raises
    ------
    TypeError, ValueError
        When network, sensor, images, and settings do not fit, or the checkpoint belongs to another
        run.
    FloatingPointError
        When the cost is not finite, or has risen and no longer has a gradient; the message says
        what to change.

    Warns
    -----
    JotlightWarning
        When the result is much worse than the start, or when images look like gray levels.

    Notes
    -----
    The cost of a network for one K is ½‖ĉ - c‖², averaged over the patches. For K-conditioned,
    color, and film networks, the squared errors of a patch are divided by an error that is easy to
    reach with its K and its light, and the intensities of bright pixels are compressed. Costs of
    different kinds of networks therefore do not compare.

    For a network for one K, one patch in 16 is not exposed as the sensor states: its brightness is
    multiplied by a random factor from 1/50 to 50. So the network learns black and saturation, which
    photographs seldom have. K-conditioned, color, and film networks get random exposures. One patch
    in 16, or one in 3 for color networks, has a mean of 0.002 to 8 photons per jot and frame.

    A thread draws the patches of the next step while a step is computed.

    Under PyTorch's launcher, ``torchrun --nproc-per-node 2 script.py``, the processes share the
    patches of each step and add their gradients. So do those of PyTorch's default group, if the
    script initialized one; it stays. All return the same network, and only the main
    process writes files and calls `callback`.

    Examples
    --------
    >>> start = jl.Network.residual(jl.Sensor(oversampling=4), "small", rng=0)
    >>> scenes = jl.datasets.uniform_scenes
    >>> trained, history = jl.torch.train(start, scenes, steps=3, patch=32, rng=0)
    >>> len(history)
    4
    """
    require_network(
        "network",
        network,
        Network | ColorNetwork | FilmNetwork,
        'jotlight.torch.train(jotlight.Network.conditional("small"), images)',
    )
    sensor = trained_sensor(network, sensor)
    network.check_sensor(sensor)
    chosen_device = choose_device(device)
    steps = whole_number("steps", STEPS if steps is None else steps, 1)
    batch = whole_number("batch", BATCH if batch is None else batch, 1)
    learning_rate = positive_number("learning_rate", learning_rate)
    filter_dtype = filter_dtype_of(network, precision)
    check_choice("optimizer", optimizer, OPTIMIZERS)
    seconds = None if seconds is None else positive_number("seconds", seconds)
    source = as_patch_source(images)
    if isinstance(source, ImagePatches):
        warn_about_scale("images", source.images, sensor.max_intensity)
    side = _patch_side(source, patch)
    tests = _test_images(test, network)
    with (
        recorded_gradients(),
        process_group(chosen_device) as group,
        shown_steps(group.is_main and progress, steps, callback) as report,
    ):
        _check_batch(batch, group.world_size)
        network = group.shared(network)
        seed = group.shared(Checkpoint.choose_seed(rng, checkpoint, resume))
        loader = _loader_of(network)(source, network, patch_sensor(sensor), seed, batch, side)
        settings = {
            **_settings(loader, tests, steps),
            "optimizer": f"{optimizer.capitalize()}(learning_rate={learning_rate})",
            "precision": precision,
        }
        with thread_limit(threads), AheadLoader(loader, group.shard, steps) as ahead:
            reads_planes = isinstance(network, PlanesNetwork)
            module = (TorchPlanesNetwork if reads_planes else TorchNetwork)(network)
            module.to(chosen_device)
            module.filter_dtype = filter_dtype
            trainer = ImageTrainer(module, ahead, settings, learning_rate, tests, group, optimizer)
            trainer.begin(checkpoint, resume)
            trainer.run(steps, checkpoint, report, seconds)
            last = trainer.finish()
            if group.is_main:
                report(last)
    history = History([*trainer.history.records, last])
    return _trained(module, network, sensor, settings, history), history


def _loader_of(network: object) -> type[PatchLoader]:
    """Return the class whose batches train a network."""
    if isinstance(network, FilmNetwork):
        return FilmPatchLoader
    return ColorPatchLoader if isinstance(network, ColorNetwork) else PatchLoader


def _test_images(
    test: npt.NDArray[np.floating] | Sequence[npt.ArrayLike] | None, network: object
) -> Images | None:
    """Return the images whose PSNR is measured, after a check."""
    if isinstance(network, PlanesNetwork) and test is not None:
        raise ValueError(
            f"test: expected none for a {type(network).__name__}; measure it after the training"
        )
    return None if test is None else check_images(test, "test")


def _check_batch(batch: int, processes: int) -> None:
    """Raise ValueError if a batch has fewer patches than there are processes."""
    if batch < processes:
        raise ValueError(
            f"batch: expected at least one patch for each of the {processes} processes, got {batch}"
        )


def _trained(
    module: TorchNetwork,
    network: Network,
    sensor: Sensor,
    settings: dict[str, object],
    history: History,
) -> Network:
    """Return the trained network of a module, which started as `network`, with its history."""
    trained = module.to_network()
    if network.trials_range is None:
        trained = Network(trained.layers, sensor).with_precision(network.precision)
    records = history.subsample().to_json()
    trained.history = with_run(network.history, "train", settings, records)
    return trained


def _patch_side(source: PatchSource, patch: int | None) -> int:
    """Return the height and width of patches, after a check against the source."""
    side = min(PATCH, source.max_side) if patch is None else whole_number("patch", patch, 1)
    if side > source.max_side:
        raise ValueError(
            f"patch: expected at most {source.max_side} pixels, got {side}. "
            f"{source.describe_limit()}"
        )
    return side


def _settings(loader: PatchLoader, tests: Images | None, steps: int) -> dict[str, object]:
    """Return what identifies a run in a checkpoint and in the network's history."""
    return {
        "network": fingerprint_network(loader.network),
        "sensor": loader.sensor.scalars(),
        "images": loader.source.fingerprint(),
        "test": None if tests is None else fingerprint_images(tests),
        "steps": steps,
        "batch": loader.batch_size,
        "patch": loader.side,
        "seed": loader.seed,
    }
