"""``jotlight fine-tune``: a network trained further on the bits of one capture."""

import dataclasses
import functools
import shlex
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from jotlight.calibration import Calibration
from jotlight.cli.captures.captured import Captured, add_sensor
from jotlight.cli.captures.jot_checks import mask_hot_jots
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.common_options import NETWORK_PANEL, CapturePath
from jotlight.cli.options.sensor_options import TunedSensorOptions
from jotlight.cli.terminal.console import caution, report, silenced
from jotlight.cli.training.learners import check_device, describe_kind
from jotlight.cli.training.training_options import FineTuningOptions
from jotlight.cli.training.training_run import (
    check_outputs_of_run,
    checkpoint_path,
    prepare_run,
    report_training,
    run_training,
)
from jotlight.errors import counted
from jotlight.networks.architectures import SIZES
from jotlight.networks.network import Network
from jotlight.networks.pretrained import DEFAULT_SIZE, pretrained
from jotlight.sensing.bits.channels import last_channel_axis
from jotlight.sensing.sensor import Sensor
from jotlight.training import History


def fine_tune(
    data: CapturePath,
    /,
    *,
    training: FineTuningOptions,
    quality: Annotated[
        str | None,
        Parameter(
            group=NETWORK_PANEL,
            help=f"Size of the trained network to start from: {', '.join(SIZES)}. Default: "
            f"{DEFAULT_SIZE}.",
        ),
    ] = None,
    capture: CaptureOptions = CaptureOptions(),
    sensor: TunedSensorOptions = TunedSensorOptions(),
) -> None:
    """Train a network further on the bits of one capture, without images or ground truth.

    Ctrl-C stops the run. With --resume it continues as if it had never been stopped. The command
    needs PyTorch, the extra torch.
    """
    check_outputs_of_run([data], training, sensor)
    from jotlight.torch import distributed, fine_tuning

    check_device(training.device)
    is_first = distributed.rank() == 0
    if is_first:
        prepare_run(training)
    steps = fine_tuning.STEPS if training.steps is None else training.steps
    rate = fine_tuning.LEARNING_RATE if training.learning_rate is None else training.learning_rate
    with silenced(not is_first):
        captured = _capture(data, capture, sensor, training.threads)
        network, kind, origin = _start(training.start, quality, captured.sensor)
        if network.trials_range is None and sensor.max_intensity is None:
            # `jotlight reconstruct` also uses the range that the network was trained for.
            own = captured.sensor.replace(max_intensity=network.sensor.max_intensity)
            captured = dataclasses.replace(captured, sensor=own)
        counts = captured.summed()
        run = functools.partial(
            fine_tuning.fine_tune,
            network,
            counts,
            captured.sensor,
            channel_axis=last_channel_axis(counts),
            steps=steps,
            learning_rate=rate,
            batch=training.batch,
            patch=training.patch,
            rng=training.seed,
            device=training.device,
            threads=training.threads,
            checkpoint=checkpoint_path(training.output),
            resume=training.resume,
        )
        if not is_first:
            run()
            return
    history, seconds = run_training(
        run,
        training,
        title=f"fine-tuning {kind}, starting from {origin}",
        steps=steps,
        remedy="--learning-rate",
        data=str(data),
    )
    _report(training, history, seconds, kind)
    _report_next(data, training, capture, sensor)
    if kind.startswith(("a two-layer", "a small")):
        report(f"--quality {DEFAULT_SIZE}, the default, starts from a better network.")


def _report_next(
    data: Path,
    training: FineTuningOptions,
    capture: CaptureOptions,
    sensor: TunedSensorOptions,
) -> None:
    """Print the command that uses the network."""
    argv = ["jotlight", "reconstruct", str(data), *capture.to_argv(), *sensor.to_argv()]
    argv += ["--model", str(training.output), "-o", "image.png"]
    report(f"Reconstruct with it: {shlex.join(argv)}")


def _capture(
    path: Path, capture: CaptureOptions, sensor: TunedSensorOptions, threads: int | None
) -> Captured:
    """Return the data with their sensor."""
    from jotlight.torch.bit_splitting import check_kernel

    kwargs: dict[str, Any] = sensor.to_kwargs()
    opened = capture.open(path, sensor.stated_trials(), sensor.bit_depth)
    calibration = None if sensor.calibration is None else Calibration.load(sensor.calibration)
    captured = add_sensor(opened, path, kwargs, calibration)
    if sensor.find_hot_jots:
        captured = mask_hot_jots(captured, threads)
    report(*captured.notes())
    check_kernel(captured.sensor)
    return captured


def _start(path: Path | None, quality: str | None, sensor: Sensor) -> tuple[Network, str, str]:
    """Return the network to start from, its kind, and its origin."""
    if path is not None:
        if quality is not None:
            raise ValueError("start: this network has its own layers; leave out --quality")
        network, origin = Network.load(path), str(path)
    else:
        quality = quality or DEFAULT_SIZE
        network, origin = pretrained(sensor, quality), "the pretrained one"
    return network, describe_kind(network, quality), origin


def _report(training: FineTuningOptions, history: History, seconds: float, kind: str) -> None:
    steps = len(history) - 1
    before, after = history.held_out[0], history.held_out[-1]
    report_training(
        f"{kind}, fine-tuned on this capture, trained in {counted(steps, 'step')} "
        f"and {seconds:.1f} s, "
        f"{before:.5f} to {after:.5f} nats per held-out bit",
        training,
    )
    if after == before:
        caution(
            "no improvement",
            "no other parameters made the held-out bits more likely, so the network equals the "
            "start; try more --steps or another --learning-rate",
        )
