"""A training run: its checkpoint, its progress, and the files it writes."""

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from rich.markup import escape

import jotlight.plots as plots
from jotlight.cli.captures.captured import check_outputs_of
from jotlight.cli.options.sensor_options import CalibratedSensorOptions
from jotlight.cli.terminal.console import err, print_steps, report
from jotlight.cli.training.training_options import TrainingOptions
from jotlight.errors import hide_warnings
from jotlight.files import atomic_write, delete_file, remove_leftovers
from jotlight.networks.network import Network
from jotlight.networks.stages import last_run
from jotlight.output_links import follow_link
from jotlight.sensing.parameters.intensity_scale import MEANING
from jotlight.training import History


def checkpoint_path(output: Path) -> Path:
    """Return the file that keeps a stopped run.

    If the output is a symbolic link, it lies beside the file to which the link leads.

    Raises
    ------
    OSError
        When links form a loop.
    ValueError
        When the output, or the file to which it leads, is not named as a network.
    """
    own = follow_link(output)
    for path in (output, own):
        if path.suffix.lower() != ".safetensors" or path.stem.endswith(".checkpoint"):
            raise ValueError(
                f"{path}: expected a name that ends in .safetensors, but not in "
                ".checkpoint.safetensors, which is for stopped runs"
            )
    return own.with_suffix(".checkpoint.safetensors")


def check_outputs_of_run(
    captures: Iterable[Path],
    options: TrainingOptions,
    sensor: CalibratedSensorOptions,
    images: Iterable[Path] = (),
) -> None:
    """Check that a run can write its files, and that they are none of the files it reads.

    Parameters
    ----------
    captures : iterable of Path
        Captures to read.
    options : TrainingOptions
        Files to write.
    sensor : CalibratedSensorOptions
        The calibration and the maps of the sensor to read.
    images : iterable of Path
        Other files to read.

    Raises
    ------
    OSError, ValueError
        When a file cannot be written, has another ending than it needs, or is read.
    """
    outputs = [options.output, options.plot, checkpoint_path(options.output)]
    if options.plot is not None:
        plots.check_figure(options.plot)
    inputs = [options.start, sensor.calibration, *sensor.map_files(), *images]
    check_outputs_of(captures, outputs, inputs)


def prepare_run(options: TrainingOptions) -> None:
    """Remove what killed runs left, and check that a stopped run and the options fit together.

    Raises
    ------
    OSError, ValueError
        When they do not.
    """
    checkpoint = checkpoint_path(options.output)
    for path in filter(None, (options.output, checkpoint, options.plot)):
        remove_leftovers(path)
    if options.resume and options.restart:
        raise ValueError("--resume and --restart: expected one of them, got both")
    if checkpoint.exists() and not (options.resume or options.restart):
        raise ValueError(
            f"{checkpoint}: a run to this output was stopped; add --resume to continue it, or "
            "--restart to discard it"
        )
    if options.resume and not checkpoint.exists():
        raise FileNotFoundError(f"there is no stopped run to resume: no file {checkpoint}")


def run_training(
    train: Callable[..., tuple[Network, History]],
    options: TrainingOptions,
    *,
    title: str,
    steps: int,
    remedy: str,
    data: str,
) -> tuple[History, float]:
    """Train a network, write it and its figure, and return its history and its duration.

    Parameters
    ----------
    train : callable
        Takes `callback` and `progress`.
    options : TrainingOptions
        Files to write.
    title : str
        Text that says which network is trained.
    steps : int
        Number of steps of the run.
    remedy : str
        Option to lower when the run diverges.
    data : str
        Text that names the images or the capture, for the history of the network.

    Returns
    -------
    history : History
    seconds : float
        Duration of the run.
    """
    start = time.perf_counter()
    checkpoint = checkpoint_path(options.output)
    # The files are created now, to reveal a folder that cannot be written before any work.
    with contextlib.ExitStack() as files:
        temporary = files.enter_context(atomic_write(options.output))
        figure = None if options.plot is None else files.enter_context(atomic_write(options.plot))
        # The files of the images were checked when they were read.
        with _explain_stop(checkpoint, remedy), hide_warnings(MEANING):
            network, history = train(callback=print_steps(title, steps), progress=True)
            last_run(network.history)["data"] = data
            network.save(temporary)
            if figure is not None:
                plots.save_figure(plots.training(network, history), figure)
    delete_file(checkpoint)
    return history, time.perf_counter() - start


def report_training(text: str, options: TrainingOptions) -> None:
    """Print the result of a run, and the name of its figure."""
    report(f"{options.output}: {text}")
    if options.plot is not None:
        report(f"Figure: {options.plot}")


@contextlib.contextmanager
def _explain_stop(checkpoint: Path, remedy: str) -> Iterator[None]:
    """Print how to continue a run that ends early."""
    try:
        yield
    except (KeyboardInterrupt, OSError):
        if checkpoint.exists():
            name = escape(str(checkpoint))
            err.print(
                f"\nThe run so far is kept in [bold]{name}[/]. The same command with "
                "--resume continues it.",
                soft_wrap=True,
            )
        raise
    except FloatingPointError as error:
        raise FloatingPointError(f"{error}. Start again with --restart and {remedy}") from error
