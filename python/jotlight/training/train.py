"""The function that trains a network: `jotlight.train`."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from jotlight.checks import check_threads, positive_number, whole_number
from jotlight.networks.graph import is_sequential
from jotlight.networks.loading import require_network
from jotlight.networks.network import Network
from jotlight.parameter_names import other_names, other_training_names, takes_rng
from jotlight.progress import Progress
from jotlight.sensing.sensor import Sensor
from jotlight.training.admissible import AdmissibleSet, SafeSet
from jotlight.training.checkpoint import Checkpoint
from jotlight.training.history import History, RecordCallback
from jotlight.training.images import TrainingImages, check_images
from jotlight.training.optimizer_protocol import Optimizer
from jotlight.training.optimizers import find_optimizer
from jotlight.training.parameters import parameter_vector
from jotlight.training.patches import PatchSampler, trained_sensor
from jotlight.training.reporting import shown_steps
from jotlight.training.run import Run


# Keyword-only options with numpydoc documentation, so more than nine parameters are fine.
@takes_rng
@other_training_names
@other_names(lr="optimizer= for the step size, as in optimizer=Adam(learning_rate=0.01)")
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
    callback: RecordCallback | None = None,
    progress: Progress = None,
    threads: int | None = None,
) -> tuple[Network, History]:
    """Return a network trained for the smallest mean square error, and the history of the run.

    Each step draws new patches and new bits, computes the cost and its gradient by error
    backpropagation, and moves the parameters within the set 𝒜.

    Parameters
    ----------
    network : Network
        Starting point, such as ``Network.initial(sensor)``.
    images : array (N, H, W), sequence of arrays (H, W), or callable
        Gray images of intensities. A callable gets a `numpy.random.Generator` and a number N, and
        returns N new images, shape (N, H, W); then each step uses N new, whole images. A checkpoint
        identifies a callable by its name only.
    sensor : Sensor, optional
        Sensor that the trained network is for. For the patches, medians replace its maps of dark
        counts and efficiency, and no jot is dead. Default: the one for which
        :func:`jotlight.pretrained` was called, else the network's.
    optimizer : {"gauss-newton", "adam", "projected-gradient"} or Optimizer
        An optimizer of `jotlight.training`, by name or with settings.
    steps : int, optional
        Number of steps. Default: the optimizer's `steps`.
    seconds : float, optional
        Time limit. The run ends before the step that would exceed it, but not before the first.
        The number of steps then depends on the machine; the same number of steps leads to the same
        network. Default: no limit.
    batch : int, optional
        Number of patches per step. Default: the number that fills 2^20 pixels for Gauss-Newton, and
        2^17 pixels for other optimizers, like the paper's 128 images of 32 × 32.
    patch : int, optional
        Height and width of a patch. Default: 64, or the side of the smallest image.
    rng : int, optional
        Seed of patches and bits. The same seed leads to the same network on one machine, bit for
        bit, for any number of threads. Default: a fresh one, or that of the run to resume.
    test : array or sequence of arrays, optional
        Test images. Their mean PSNR, for a peak of 1, is measured 100 to 200 times in a run, or in
        each of fewer than 100 steps, on whole images and always with the same bits.
    admissible : AdmissibleSet, optional
        𝒜. Default: `jotlight.training.SafeSet()`.
    checkpoint : path, optional
        File to which the state of the run is written: after the first step, every 20 seconds, at
        the end, and when Ctrl-C or an error stops the run. An older checkpoint is overwritten.
    resume : bool
        Whether to continue from the checkpoint. The result equals that of an uninterrupted run.
    callback : callable, optional
        Called with the :class:`Record` of each step, and of the result. By raising StopIteration
        it ends the run, which then returns the network so far.
    progress : bool or callable, optional
        Whether to show a progress bar, or a function that is called with the completed fraction.
        Default: a bar in notebooks.
    threads : int, optional
        The number of threads. Default: the number of cores.

    Returns
    -------
    network : Network
        The trained network. The last of the `stages` in its `history` holds settings and records
        of the run.
    history : History
        Cost, gradient norm, and test PSNR of each step. The last record belongs to the result, so
        there is one more record than steps. ``history.steps[-1]`` steps were taken.

    Raises
    ------
    TypeError, ValueError
        When network, sensor, images, and settings do not fit together, or the checkpoint belongs to
        another run.
    FloatingPointError
        When the cost is not finite or has grown over many steps; the message says what to change.

    Warns
    -----
    JotlightWarning
        When the result is much worse than the start, or when images look like gray levels.

    Notes
    -----
    The cost leaves out pixels whose estimate depends on pixels outside the patch. At the border of
    the image it includes them.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=3)
    >>> start = jl.Network.initial(sensor)
    >>> trained, history = jl.train(start, jl.datasets.uniform_scenes, steps=3, batch=16, rng=0)
    >>> int(history.steps[-1]), bool(history.loss[-1] < history.loss[0])
    (3, True)
    """
    require_network(
        "network", network, Network, "jotlight.train(jotlight.Network.initial(sensor), images)"
    )
    sensor = trained_sensor(network, sensor)
    network.check_sensor(sensor)
    if not is_sequential(network.layers):
        raise ValueError(
            "network: expected layers that each filter the output of the previous one and apply "
            "splines; train others with PyTorch, jotlight.torch.train"
        )
    chosen = find_optimizer(optimizer)
    steps = whole_number("steps", chosen.steps if steps is None else steps, 0)
    seed = Checkpoint.choose_seed(rng, checkpoint, resume)
    admissible = SafeSet() if admissible is None else admissible
    if isinstance(admissible, type) or not hasattr(admissible, "project"):
        raise TypeError(
            "admissible: expected an object with a method project, such as "
            f"jotlight.training.SafeSet(), got {admissible!r}"
        )
    check_threads(threads)
    seconds = None if seconds is None else positive_number("seconds", seconds)
    sampler = PatchSampler.for_network(network, sensor, images, patch, batch, chosen.pixels, seed)
    tests = None if test is None else sampler.whole_images(check_images(test, "test"))
    run = Run(network, sampler, tests, chosen, admissible, steps, threads)
    start = admissible.project(network, parameter_vector(network))
    state = run.begin(start, checkpoint, resume)
    with shown_steps(progress, steps, callback) as report:
        state = run.take_steps(start, state, checkpoint, resume, seconds, report)
        return run.finish(start, state, sensor, report)
