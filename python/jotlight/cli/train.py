"""``jotlight train``: a network for a sensor, trained on images."""

import functools
import math
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from jotlight.cli.options.capture_options import TargetCaptureOptions
from jotlight.cli.options.common_options import CAPTURE_PANEL, TRAINING_PANEL, convert_file
from jotlight.cli.options.sensor_options import TrainedSensorOptions
from jotlight.cli.terminal.console import caution, report, silenced
from jotlight.cli.training.learners import (
    Learner,
    deep_learner,
    describe_kind,
    initial_network,
    is_deep,
    parse_bits_per_pixel,
    refuse_options_of_others,
    two_layer_learner,
)
from jotlight.cli.training.training_data import (
    SYNTHETIC,
    files_of,
    read_training_images,
    read_training_sensor,
    scale_scenes,
)
from jotlight.cli.training.training_options import (
    TRAINING_SECONDS,
    ImageOptions,
    NetworkOptions,
    TrainingOptions,
)
from jotlight.cli.training.training_run import (
    check_outputs_of_run,
    checkpoint_path,
    prepare_run,
    report_training,
    run_training,
)
from jotlight.errors import plural
from jotlight.networks.network import Network
from jotlight.networks.pretrained import DEFAULT_SIZE
from jotlight.sensing.sensor import Sensor
from jotlight.training import History, Record

_SMALL_LAYERS = 6
"""Number of layers of the network "small". Networks with more get no hint."""

_BEST = "large"
"""Size of the trained network to propose."""

_PHOTOGRAPHS = "photographs of scikit-image"


def train(
    images: Annotated[
        str | None,
        Parameter(
            converter=convert_file,
            help="A folder of photographs, an array (N, H, W) in .npy or .npz, or the word "
            f"{SYNTHETIC} for the paper's random scenes. Default with --sensor: photographs that "
            "ship with scikit-image.",
        ),
    ] = None,
    /,
    *,
    training: TrainingOptions,
    seconds: Annotated[
        float | None,
        Parameter(
            group=TRAINING_PANEL,
            help="Time limit: stop before the step that would exceed it. Default with --sensor and "
            f"without --steps: {TRAINING_SECONDS:g}. Deep networks have no default limit.",
        ),
    ] = None,
    network: NetworkOptions = NetworkOptions(),
    data: ImageOptions = ImageOptions(),
    target: Annotated[
        Path | None,
        Parameter(
            name="--sensor",
            group=CAPTURE_PANEL,
            help="A capture, or the .json beside it. The network is trained for its sensor, and "
            "for scenes of its brightness. For images of some of its frames, such as those of a "
            "film, --frames states their number. Default: none.",
        ),
    ] = None,
    capture: TargetCaptureOptions = TargetCaptureOptions(),
    sensor: TrainedSensorOptions = TrainedSensorOptions(),
) -> None:
    """Train a network for a sensor on images.

    Ctrl-C stops the run. With --resume it continues as if it had never been stopped.

    The cost is half the squared error of a patch. With --bits-per-pixel MIN:MAX, it is relative to
    an error that is easy to reach. For deep networks, one patch in 16 has a random brightness. The
    test PSNR is for a peak of 1. --calibration needs --sensor. The network is then trained for the
    median jot.

    Several processes can train a deep network: torchrun --nproc-per-node 2 -m jotlight train
    """
    _check_options(images, training, network, target, capture, sensor)
    kwargs = {**sensor.to_kwargs(), **_jots(network, sensor)}
    captures = [] if target is None else [target]
    photographs = [*files_of(images), *files_of(data.test)]
    check_outputs_of_run(captures, training, sensor, photographs)
    start = None if training.start is None else Network.load(training.start)
    learner = _learner(training, network, start)
    if learner.is_first:
        prepare_run(training)
    if target is not None and training.steps is None and seconds is None:
        seconds = None if is_deep(network.quality, None) else TRAINING_SECONDS
    with silenced(not learner.is_first):
        scale = 1.0
        if target is not None:
            exposed, scale = read_training_sensor(target, capture, sensor, training.threads)
        else:
            exposed = _exposed_sensor(start, network, kwargs)
        if start is None:
            start = _initial_network(exposed, network, training.seed)
        kind = describe_kind(start, network.quality)
        steps = learner.steps if training.steps is None else training.steps
        highest = exposed.max_intensity / scale
        scenes, tests = read_training_images(images, data, training.seed, highest)
        if scale != 1.0:
            scenes, tests = scale_scenes(scenes, scale), scale_scenes(tests, scale)
        run = functools.partial(
            learner.train,
            start,
            scenes,
            exposed,
            **learner.settings,
            steps=steps,
            seconds=seconds,
            batch=training.batch,
            patch=training.patch,
            rng=training.seed,
            test=tests,
            checkpoint=checkpoint_path(training.output),
            resume=training.resume,
            threads=training.threads,
        )
        if not learner.is_first:
            run()
            return
    history, taken = run_training(
        run,
        training,
        title=f"training {kind}",
        steps=steps,
        remedy=learner.remedy,
        data=images or _PHOTOGRAPHS,
    )
    report_training(f"{kind}, {_describe(history, taken, steps)}", training)
    report(f"Reconstruct with it: jotlight reconstruct CAPTURE --model {training.output} -o a.png")
    if start.trials_range is not None and kwargs and data.test is None:
        caution("note", "this network serves every sensor: options of a sensor are for --test only")
    _hint(start)


def _check_options(
    images: str | None,
    training: TrainingOptions,
    network: NetworkOptions,
    target: Path | None,
    capture: TargetCaptureOptions,
    sensor: TrainedSensorOptions,
) -> None:
    """Raise ValueError for options that do not belong together."""
    if images is None and target is None:
        raise ValueError(
            f"images: expected a folder of photographs, an array, or the word {SYNTHETIC}; they "
            "may be left out with --sensor only"
        )
    if training.start is not None:
        for option, part, is_set in (
            ("untied", "weights", network.untied),
            ("sigma", "filters", network.sigma is not None),
            ("bits-per-pixel", "range of bits per pixel", network.trials_range is not None),
        ):
            if is_set:
                raise ValueError(f"start: this network has its own {part}; leave out --{option}")
        if target is not None:
            raise ValueError("start: this network has its own sensor; leave out --sensor")
    if target is None:
        options = capture.to_argv("--sensor-key")
        if sensor.calibration is not None:
            options.append("--calibration")
        if options:
            raise ValueError(f"{options[0][2:]}: is for a capture; name one with --sensor")
    elif network.bits_per_pixel is not None:
        raise ValueError("bits-per-pixel: --sensor states it; leave out one of them")


def _learner(training: TrainingOptions, network: NetworkOptions, start: Network | None) -> Learner:
    """Return the learner of a network, after a check of the options of other networks."""
    deep = is_deep(network.quality, start)
    refuse_options_of_others(
        deep,
        precision=network.precision,
        damping=network.damping,
        sigma=network.sigma,
        untied=network.untied,
        device=training.device,
        range=network.trials_range,
    )
    if deep:
        return deep_learner(
            network.optimizer, training.learning_rate, network.precision, training.device
        )
    return two_layer_learner(network.optimizer, training.learning_rate, network.damping)


def _exposed_sensor(
    start: Network | None, network: NetworkOptions, kwargs: dict[str, Any]
) -> Sensor:
    """Return the sensor of the training or, for a K-conditioned network, of the tests alone.

    By default, it is that of the network at the start, or it has 4 x 4 jots per pixel. Its K is in
    the range of a K-conditioned network.
    """
    trials_range = network.trials_range if start is None else start.trials_range
    if start is not None and trials_range is None:
        return start.sensor.replace(**kwargs)
    least = 1 if trials_range is None else trials_range[0]
    return Sensor(**{"oversampling": 4, "frames": math.ceil(least / 16), **kwargs})


def _initial_network(sensor: Sensor, options: NetworkOptions, seed: int) -> Network:
    return initial_network(
        sensor,
        options.quality,
        trials_range=options.trials_range,
        sigma=options.sigma,
        tied=not options.untied,
        seed=seed,
    )


def _jots(network: NetworkOptions, sensor: TrainedSensorOptions) -> dict[str, int]:
    """Return the parameters of a sensor with the requested number of bits per pixel."""
    bits = parse_bits_per_pixel(network.bits_per_pixel)
    if not isinstance(bits, int):
        return {}
    for name in ("oversampling", "frames"):
        if getattr(sensor, name) is not None:
            raise ValueError(
                f"bits-per-pixel: replaces --oversampling and --frames; leave out --{name}"
            )
    return {"oversampling": 1, "frames": bits}


def _hint(network: Network) -> None:
    """Print which network is better, if this one is not the best kind."""
    if len(network.layers) > _SMALL_LAYERS:
        return
    report(f"--quality {DEFAULT_SIZE} trains a better network, with PyTorch.")
    report(
        f"The trained network {_BEST} serves this sensor, too: jotlight reconstruct CAPTURE "
        f"--quality {_BEST} -o a.png"
    )


def _describe(history: History, seconds: float, steps: int) -> str:
    """Return the outcome of a run in one line."""
    first, last = history.records[0], history.records[-1]
    taken = len(history) - 1
    number = str(steps) if taken == steps else f"{taken} of {steps}"
    ending = "" if taken == steps else "; a larger --seconds allows more"
    return (
        f"trained in {number} {plural(steps, 'step')} and {seconds:.1f} s, cost "
        f"{first.loss:.4g} to {last.loss:.4g}{_describe_test(first, last)}{ending}"
    )


def _describe_test(first: Record, last: Record) -> str:
    if first.test_psnr is None or last.test_psnr is None:
        return "; --test measures the quality on other images"
    return f", test PSNR {first.test_psnr:.2f} to {last.test_psnr:.2f} dB"
