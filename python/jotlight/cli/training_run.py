"""Runs that learn: where they are kept when they are stopped, how they go on, what they write."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from jotlight import plots
from jotlight.cli.console import err, live_training
from jotlight.files import atomic_write
from jotlight.networks.network import Network
from jotlight.training import History


def checkpoint_of(output: Path) -> Path:
    """Where the run that learns a network is kept.

    Raises
    ------
    ValueError
        When the network's file is not named as one.
    """
    if output.suffix.lower() != ".safetensors" or output.stem.endswith(".checkpoint"):
        raise ValueError(
            f"{output}: expected a name that ends in .safetensors, and not in "
            ".checkpoint.safetensors, which is for stopped runs"
        )
    return output.with_suffix(".checkpoint.safetensors")


def check_checkpoint(checkpoint: Path, resume: bool, restart: bool) -> None:
    """Raise ValueError or OSError when a stopped run and the options do not go together."""
    if resume and restart:
        raise ValueError("--resume and --restart: expected one of them, got both")
    if checkpoint.exists() and not (resume or restart):
        raise ValueError(
            f"{checkpoint}: a run to this output was stopped; add --resume to go on with it, or "
            "--restart to forget it"
        )
    if resume and not checkpoint.exists():
        raise FileNotFoundError(f"there is no stopped run to resume: no file {checkpoint}")


def learn(
    run: Callable[..., tuple[Network, History]],
    output: Path,
    plot: Path | None,
    *,
    steps: int,
    remedy: str,
    about: dict[str, str],
) -> tuple[History, float]:
    """Let a run learn and show its trainer, and write the network and its figure.

    Parameters
    ----------
    run : callable
        Takes `callback`.
    output, plot : Path
        Where network and figure go.
    steps : int
        How many the run is to take.
    remedy : str
        The option to lower when it diverges.
    about : dict
        What the network's history tells besides.

    Returns
    -------
    history : History
    seconds : float
        How long it took.
    """
    begun = time.perf_counter()
    checkpoint = checkpoint_of(output)
    # Made now, so that a place that cannot be written to is found before any work is done.
    with contextlib.ExitStack() as files:
        temporary = files.enter_context(atomic_write(output))
        figure = files.enter_context(atomic_write(plot)) if plot is not None else None
        with _kept(checkpoint, remedy), live_training(steps) as show:
            learned, history = run(callback=show)
        learned.history.update(about)
        learned.save(temporary)
        if figure is not None:
            plots.training(learned, history).savefig(figure, dpi=110)
    checkpoint.unlink(missing_ok=True)
    return history, time.perf_counter() - begun


@contextlib.contextmanager
def _kept(checkpoint: Path, remedy: str) -> Iterator[None]:
    """Say how to go on where a run ended early."""
    try:
        yield
    except (KeyboardInterrupt, OSError):
        if checkpoint.exists():
            err.print(
                f"\nThe run so far is kept in [bold]{checkpoint}[/]: the same command with "
                "--resume goes on",
                soft_wrap=True,
            )
        raise
    except FloatingPointError as error:
        raise FloatingPointError(f"{error}. Begin anew with --restart and {remedy}") from error
