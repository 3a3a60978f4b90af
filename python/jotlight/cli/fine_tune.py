"""``jotlight fine-tune``: a network trained further on the bits of one capture."""

import dataclasses
import functools
import shlex
from pathlib import Path
from typing import Any

import jotlight.plots as plots
from jotlight.calibration import Calibration
from jotlight.cli.capture_options import CaptureOptions
from jotlight.cli.captured import Captured, add_sensor, refuse_capture_overwrite
from jotlight.cli.common_options import CapturePath
from jotlight.cli.console import caution, report, silenced
from jotlight.cli.jot_checks import mask_hot_jots
from jotlight.cli.learners import check_device
from jotlight.cli.sensor_options import CalibratedSensorOptions
from jotlight.cli.training_options import TrainingOptions
from jotlight.cli.training_run import (
    checkpoint_path,
    prepare_run,
    report_training,
    run_training,
)
from jotlight.files import refuse_overwrite
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained, unsupported_reason
from jotlight.sensing.sensor import Sensor
from jotlight.training import History

_QUALITY = "medium"
"""Size of the shipped network to start from."""


def fine_tune(
    data: CapturePath,
    /,
    *,
    training: TrainingOptions,
    capture: CaptureOptions = CaptureOptions(),
    sensor: CalibratedSensorOptions = CalibratedSensorOptions(),
) -> None:
    """Train a network further on the bits of one capture, without images or ground truth.

    Ctrl-C stops the run. With --resume it continues as if it had never been stopped. The command
    needs PyTorch, the extra torch.
    """
    _check_outputs(data, training, sensor)
    from jotlight.torch import distributed, fine_tuning

    check_device(training.device)
    is_first = distributed.rank() == 0
    if is_first:
        prepare_run(training)
    steps = fine_tuning.STEPS if training.steps is None else training.steps
    rate = fine_tuning.LEARNING_RATE if training.learning_rate is None else training.learning_rate
    with silenced(not is_first):
        captured, network = _capture_and_network(data, training, capture, sensor)
        run = functools.partial(
            fine_tuning.fine_tune,
            network,
            captured.summed(),
            captured.sensor,
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
        steps=steps,
        remedy="--learning-rate",
        provenance={"fine-tuned on": str(data)},
    )
    _report(training, history, seconds)
    argv = ["jotlight", "reconstruct", str(data), *capture.to_argv(), *sensor.to_argv()]
    argv += ["--model", str(training.output), "-o", "image.png"]
    report(f"Reconstruct with it: {shlex.join(argv)}")


def _check_outputs(data: Path, training: TrainingOptions, sensor: CalibratedSensorOptions) -> None:
    """Raise ValueError for outputs that cannot be written."""
    checkpoint = checkpoint_path(training.output)
    if training.plot is not None:
        plots.check_figure(training.plot)
    for file in filter(None, (training.output, training.plot, checkpoint)):
        refuse_overwrite(file, [training.start, sensor.calibration, *sensor.map_files()])
        refuse_capture_overwrite(file, data)


def _capture_and_network(
    path: Path,
    training: TrainingOptions,
    capture: CaptureOptions,
    sensor: CalibratedSensorOptions,
) -> tuple[Captured, Network]:
    """Return the data with their sensor, and the network to start from."""
    from jotlight.torch.bit_splitting import check_kernel

    kwargs: dict[str, Any] = sensor.to_kwargs()
    opened = capture.open(path, sensor.stated_trials())
    calibration = None if sensor.calibration is None else Calibration.load(sensor.calibration)
    captured = add_sensor(opened, path, kwargs, calibration)
    if sensor.find_hot_jots:
        captured = mask_hot_jots(captured)
    report(*captured.notes())
    check_kernel(captured.sensor)
    network = _start(training.start, captured.sensor)
    if network.trials_range is None and "max_intensity" not in kwargs:
        # `jotlight reconstruct` also uses the range that the network was trained for.
        own = captured.sensor.replace(max_intensity=network.sensor.max_intensity)
        captured = dataclasses.replace(captured, sensor=own)
    return captured, network


def _start(path: Path | None, sensor: Sensor) -> Network:
    """Return the network to start from, and report which one it is."""
    if path is not None:
        report(f"starts from {path}")
        return Network.load(path)
    if (reason := unsupported_reason(sensor, _QUALITY)) is not None:
        raise ValueError(
            f"start: expected a network to start from, since {reason}; name one with --start, or "
            "select some of the frames with --frame-range"
        )
    report(f"starts from the {_QUALITY} network that ships with jotlight")
    return pretrained(sensor, _QUALITY)


def _report(training: TrainingOptions, history: History, seconds: float) -> None:
    steps = len(history) - 1
    before, after = history.held_out[0], history.held_out[-1]
    report_training(
        f"trained in {steps} step{'' if steps == 1 else 's'} and {seconds:.1f} s, "
        f"{before:.5f} to {after:.5f} nats per held-out bit",
        training,
    )
    if after == before:
        caution(
            "no improvement",
            "no other parameters made the held-out bits more likely, so the network equals the "
            "start; try more --steps or another --learning-rate",
        )
