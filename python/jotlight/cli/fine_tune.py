"""What `jotlight train --self-supervised` does: a network learns from a capture's own bits."""

import functools
import shlex
from pathlib import Path
from typing import Any

from jotlight.cli import capture_options, networks, training_run
from jotlight.cli.console import err, out, silent
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained, unsupported_reason
from jotlight.sensing.sensor import Sensor
from jotlight.training import History

_QUALITY = "medium"
"""Of the network to start from, unless one is given."""

_COMES_WITH_START = "layers and bits are those of the network of --start"
_ADAM = "it takes the steps of Adam; --learning-rate says how large they are"
_TESTED = "a tenth of the capture's bits is what it is tested on"
_NO_IMAGES = "it learns from the capture alone"
_REASONS = {
    "images": _NO_IMAGES,
    "white": _NO_IMAGES,
    "sensor": "give the capture once",
    "sensor_key": "--key names the array of the capture",
    "network": _COMES_WITH_START,
    "any_bits": _COMES_WITH_START,
    "sigma": _COMES_WITH_START,
    "untied": _COMES_WITH_START,
    "test": _TESTED,
    "test_key": _TESTED,
    "seconds": "--steps says how long it takes",
    "optimizer": _ADAM,
    "learning_rate": _ADAM,
    "damping": _ADAM,
}


def refuse_others(**given: object) -> None:
    """Raise ValueError for an option that does not go with --self-supervised."""
    for name, value in given.items():
        if value is not None and value is not False:
            raise ValueError(
                f"{name.replace('_', '-')}: does not go with --self-supervised, where "
                f"{_REASONS[name]}; leave it out"
            )


def learn(
    reading: capture_options.CaptureOptions,
    *,
    output: Path,
    start: Path | None,
    calibration: Path | None,
    steps: int | None,
    rate: float | None,
    seed: int,
    device: str | None,
    resume: bool,
    restart: bool,
    plot: Path | None,
    given: dict[str, Any],
    words: dict[str, list[str]],
    **settings: Any,
) -> None:
    """Make a network better for a capture, and write it.

    Parameters
    ----------
    reading : capture_options.CaptureOptions
        The capture.
    given, words
        The options of its sensor, by parameter: as values and as words of a command.
    **settings
        Others of `jotlight.torch.fine_tune`.

    Raises
    ------
    MissingExtraError
        When PyTorch is not installed.
    """
    from jotlight.torch import distributed, fine_tuning
    from jotlight.torch.bit_splitting import check_kernel

    networks.check_device(device)
    checkpoint = training_run.checkpoint_of(output)
    first = distributed.rank() == 0
    if first:
        training_run.check_checkpoint(checkpoint, resume, restart)
    steps = fine_tuning.STEPS if steps is None else steps
    with silent(not first):
        seen, sensor = capture_options.seen_and_told(
            reading.open(), reading.path, given, calibration
        )
        check_kernel(sensor)
        network = _start(start, sensor)
        if network.trials_range is None and "max_intensity" not in given:
            # As `reconstruct` takes it: a network's outputs lie in its own range.
            sensor = sensor.replace(max_intensity=network.sensor.max_intensity)
        run = functools.partial(
            fine_tuning.fine_tune,
            network,
            seen,
            sensor,
            steps=steps,
            rate=fine_tuning.RATE if rate is None else rate,
            rng=seed,
            device=device,
            checkpoint=checkpoint,
            resume=resume,
            **settings,
        )
        if not first:
            run()
            return
    about = {"fine-tuned on": str(reading.path)}
    history, seconds = training_run.learn(
        run, output, plot, steps=steps, remedy="--learning-rate", about=about
    )
    command = ["jotlight", "reconstruct", str(reading.path), *reading.words("--key")]
    if calibration is not None:
        command += ["--calibration", str(calibration)]
    for pair in words.values():
        command += pair
    command += ["--model", str(output), "-o", "picture.png"]
    _tell(output, history, seconds, plot, shlex.join(command))


def _start(path: Path | None, sensor: Sensor) -> Network:
    """The network to start from, once it is said which one that is."""
    if path is not None:
        out.print(f"starts from {path}", soft_wrap=True, markup=False)
        return Network.load(path)
    if (reason := unsupported_reason(sensor, _QUALITY)) is not None:
        raise ValueError(
            f"start: expected a network to start from, since {reason}; give one with --start, or "
            "some of the frames with --frame-range"
        )
    out.print(f"starts from the network of quality {_QUALITY} that comes with jotlight")
    return pretrained(sensor, _QUALITY)


def _tell(output: Path, history: History, seconds: float, plot: Path | None, command: str) -> None:
    steps = len(history) - 1
    before, after = history.held_out[0], history.held_out[-1]
    out.print(
        f"{output}: learned in {steps} step{'' if steps == 1 else 's'} and {seconds:.1f} s, "
        f"{before:.5f} to {after:.5f} nats per bit held out",
        soft_wrap=True,
        markup=False,
    )
    if after == before:
        err.print(
            "[yellow]nothing learned:[/] no other parameters made the bits held out more likely, "
            "so that these are those of the start; try more --steps, or another --learning-rate",
            soft_wrap=True,
        )
    if plot is not None:
        out.print(f"Look at [bold]{plot}[/]", soft_wrap=True)
    out.print(f"Reconstruct with it: {command}", soft_wrap=True, markup=False)
