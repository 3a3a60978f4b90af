"""`jotlight train`: a network for a sensor, learned from images."""

import dataclasses
import functools
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from jotlight import plots
from jotlight.cli import capture_options, networks, sensor_options, training_run
from jotlight.cli import fine_tune as own_bits
from jotlight.cli.console import out, progress, silent
from jotlight.datasets import PHOTOGRAPHS, photograph, uniform_scenes
from jotlight.estimators.brightness import training_sensor
from jotlight.files import refuse_overwrite
from jotlight.images.sets import read_image_set
from jotlight.networks.architectures import SIZES, TWO_LAYER
from jotlight.networks.network import Network
from jotlight.sensing.bits import Bits
from jotlight.sensing.sensor import Sensor
from jotlight.training import OPTIMIZERS, History, Optimizer, Record
from jotlight.training import train as learn
from jotlight.training.patches import patch_sensor

_SYNTHETIC = "synthetic"
_TEST_SCENES = 512
_OPTIMIZER = "gauss-newton"
_PHOTOGRAPHS = "photographs of scikit-image"

_SECONDS = 45.0
"""Of learning for a capture, so that all of it takes no more than a minute."""


@sensor_options.takes_sensor()
def train(
    images: Annotated[
        str | None,
        typer.Argument(
            help="A folder of photographs, an array (N, H, W) in .npy or .npz, or the word "
            f"{_SYNTHETIC} for the paper's random scenes. Default, with --sensor: photographs that "
            "come with scikit-image."
        ),
    ] = None,
    *,
    capture: Annotated[
        Path | None,
        typer.Option(
            "--sensor",
            help="A capture, or the .json beside it: learn for its very sensor, and for scenes as "
            "bright as it shows. With bits --frames is that of a film's windows.",
        ),
    ] = None,
    self_supervised: Annotated[
        Path | None,
        typer.Option(
            help="A capture: learn from its own bits, without images or a true scene, where "
            "--start ends. With PyTorch, the extra torch."
        ),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Of the capture's sensor, from `jotlight calibrate`. With --sensor the network "
            "learns for its median jot; `jotlight reconstruct --calibration` takes each for what "
            "it is.",
            rich_help_panel="Sensor",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="The learned network, .safetensors.")
    ],
    kind: Annotated[
        str | None,
        typer.Option(
            "--network",
            help=f"One of {', '.join(SIZES)}: how many layers and channels. All but the "
            f"first take PyTorch to learn, the extra torch, and longer. Default: {TWO_LAYER}.",
        ),
    ] = None,
    any_bits: Annotated[
        str | None,
        typer.Option(
            help="LEAST:MOST, such as 1:256: a deep network for any sensor of so many bits per "
            "pixel and any exposure. The sensor given is that of the tests."
        ),
    ] = None,
    test: Annotated[
        Path | None,
        typer.Option(help="A folder or array of other images, to see the progress on."),
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(
            help="Default: "
            + ", ".join(f"{kind.steps} for {name}" for name, kind in OPTIMIZERS.items())
            + ", 20000 for deep networks, 500 with --self-supervised."
        ),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(
            help="Stop before the step that would pass them. Default, with --sensor and without "
            f"--steps: {_SECONDS:g}; deep networks take their time."
        ),
    ] = None,
    optimizer: Annotated[
        str | None,
        typer.Option(help=f"One of {', '.join(OPTIMIZERS)}. Default: {_OPTIMIZER}."),
    ] = None,
    learning_rate: Annotated[
        float | None,
        typer.Option(help="Of adam (default 0.01) or projected-gradient (default 5e-6)."),
    ] = None,
    damping: Annotated[
        float | None, typer.Option(help="The first damping of gauss-newton. Default: 0.1.")
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            help="Of deep networks: the largest step of a parameter, about. Default: 0.003; 0.0005 "
            "with --self-supervised."
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(
            help=f"Of deep networks: {' or '.join(networks.DEVICES)}. Default: cuda, if there is a GPU."
        ),
    ] = None,
    batch: Annotated[
        int | None,
        typer.Option(
            help="Patches a step. Default: 2^20 pixels' worth for gauss-newton, else 2^17; 16 for "
            "deep networks."
        ),
    ] = None,
    patch: Annotated[
        int | None,
        typer.Option(
            help="Side of a patch. Default: 64, for deep networks 48, or the smallest image's."
        ),
    ] = None,
    sigma: Annotated[
        float | None,
        typer.Option(help="Standard deviation of the initial h2, in pixels. Default: 0.7."),
    ] = None,
    untied: Annotated[
        bool,
        typer.Option("--untied", help="Learn a weight for each jot of a pixel, not one for all."),
    ] = False,
    start: Annotated[
        Path | None,
        typer.Option(
            help="A network to start from, instead of the initial one; with --self-supervised "
            "instead of the one that comes with jotlight."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a run that was stopped.")
    ] = False,
    restart: Annotated[
        bool, typer.Option("--restart", help="Forget a run that was stopped, and begin anew.")
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(help="A figure of the run and the network: .png, .pdf or .svg.")
    ] = None,
    sensor_key: capture_options.Key = None,
    counts: capture_options.Counts = None,
    width: capture_options.Width = None,
    format_: capture_options.Format = None,
    frame_range: capture_options.FrameRange = None,
    rotate: capture_options.Rotate = 0,
    flip: capture_options.Flip = None,
    unpacked: capture_options.Unpacked = None,
    key: Annotated[
        str | None,
        typer.Option(
            help="Name of the array of images in a .npz, or of that of --self-supervised, as of "
            "`jotlight reconstruct`."
        ),
    ] = None,
    test_key: Annotated[
        str | None, typer.Option(help="Name of the array in the .npz of --test.")
    ] = None,
    given: dict[str, Any],
    inputs: list[Path],
    words: dict[str, list[str]],
    seed: sensor_options.Seed = 0,
    white: sensor_options.White = None,
    threads: sensor_options.Threads = None,
) -> None:
    """Learn the best network for a sensor from images, or make one better for a very capture.

    Ctrl-C stops it; with --resume it goes on as if it had not been stopped.

    The cost that it shows is half the square error of a patch.

    Deep networks can be learned by several processes: torchrun --nproc-per-node 2 -m jotlight train
    """
    checkpoint = training_run.checkpoint_of(output)
    if self_supervised is not None:
        own_bits.refuse_others(
            images=images,
            sensor=capture,
            network=kind,
            any_bits=any_bits,
            test=test,
            seconds=seconds,
            optimizer=optimizer,
            learning_rate=learning_rate,
            damping=damping,
            sigma=sigma,
            untied=untied,
            sensor_key=sensor_key,
            test_key=test_key,
            white=white,
        )
    elif images is None and capture is None:
        raise ValueError(
            "images: expected a folder of photographs, an array, or the word synthetic; only with "
            "--sensor or --self-supervised they may be left out"
        )
    if plot is not None:
        plots.check_figure(plot)
    if start is not None and (untied or sigma is not None or any_bits is not None):
        raise ValueError("start: a given network comes with its own sigma, weights and bits")
    seen = capture or self_supervised
    array = sensor_key if self_supervised is None else key
    reading = capture_options.CaptureOptions(
        seen or Path(), format_, width, frame_range, rotate, flip, array, counts, unpacked
    )
    if seen is None:
        _refuse_without_capture(reading.words(), calibration)
    elif any_bits is not None:
        raise ValueError("any-bits: such a network is for any sensor; leave out --sensor")
    for file in filter(None, (output, plot, checkpoint)):
        refuse_overwrite(file, [start, calibration, *inputs, *_files(images), *_files(test)])
        if seen is not None:
            capture_options.refuse_capture_overwrite(file, seen)
    if self_supervised is not None:
        own_bits.learn(
            reading,
            output=output,
            start=start,
            calibration=calibration,
            steps=steps,
            rate=rate,
            batch=batch,
            patch=patch,
            seed=seed,
            device=device,
            threads=threads,
            resume=resume,
            restart=restart,
            plot=plot,
            given=given,
            words=words,
        )
        return
    earlier = None if start is None else Network.load(start)
    is_deep = networks.is_deep(kind, earlier)
    networks.refuse_others(
        is_deep,
        optimizer=optimizer,
        learning_rate=learning_rate,
        damping=damping,
        sigma=sigma,
        untied=untied,
        device=device,
        rate=rate,
        any_bits=any_bits,
    )
    kind = kind or TWO_LAYER
    if is_deep:
        learner = networks.learner(device, rate)
    else:
        learner = _two_layer(optimizer or _OPTIMIZER, learning_rate=learning_rate, damping=damping)
    if learner.first:
        training_run.check_checkpoint(checkpoint, resume, restart)
    with silent(not learner.first):
        scale = 1.0
        if earlier is not None:
            if capture is not None:
                raise ValueError(
                    "start: a given network comes with its own sensor; leave out --sensor"
                )
            network = earlier
            sensor = network.sensor.replace(**given)
        else:
            if capture is not None:
                sensor, scale = _sensor_of(reading, calibration, given, threads)
                if steps is None and seconds is None and not is_deep:
                    seconds = _SECONDS
            else:
                sensor = Sensor(**{"oversampling": 4, **given})
            if any_bits is not None:
                network = Network.conditional(
                    kind, trials_range=networks.bits_of(any_bits), rng=seed
                )
            elif is_deep:
                network = Network.residual(sensor, kind, rng=seed)
            else:
                wide = 0.7 if sigma is None else sigma
                network = Network.initial(sensor, sigma=wide, tied=not untied)
        steps = learner.steps if steps is None else steps
        scenes, tests = _images(images, test, key, test_key, white, seed)
        if scale != 1.0:
            scenes, tests = _brighter(scenes, scale), _brighter(tests, scale)
        run = functools.partial(
            learner.learn,
            network,
            scenes,
            sensor,
            **learner.settings,
            steps=steps,
            seconds=seconds,
            batch=batch,
            patch=patch,
            rng=seed,
            test=tests,
            checkpoint=checkpoint,
            resume=resume,
            threads=threads,
        )
        if not learner.first:
            run()
            return
    history, taken = training_run.learn(
        run,
        output,
        plot,
        steps=steps,
        remedy=learner.remedy,
        about={"trained on": images or _PHOTOGRAPHS},
    )
    _tell(output, history, taken, steps, plot)


def _refuse_without_capture(words: list[str], calibration: Path | None) -> None:
    given = [*words, *([] if calibration is None else ["--calibration"])]
    if given:
        raise ValueError(
            f"{given[0][2:]}: is for a capture, and there is none; give it with --sensor or with "
            "--self-supervised"
        )


def _sensor_of(
    reading: capture_options.CaptureOptions,
    calibration: Path | None,
    given: dict[str, Any],
    threads: int | None,
) -> tuple[Sensor, float]:
    """The median jot of a capture's sensor, and how bright its scene is."""
    path = reading.path
    if path.suffix.lower() == ".json" and path.is_file():
        packed = path.stem.lower().endswith(".gz")
        beside = [path.with_suffix(end) for end in ([""] if packed else [".npy", ".npy.gz"])]
        data = next((data for data in beside if data.exists()), None)
        if data is None:
            raise FileNotFoundError(
                f"{path}: expected the bits beside it, {beside[0].name}, which tell how bright the "
                "scene is"
            )
        reading = dataclasses.replace(reading, path=data)
    capture = reading.open()
    numbers = dict(given)
    if isinstance(capture, Bits):
        # The capture tells its own; those that are given are of a film's windows.
        numbers.pop("frames", None)
    seen, own = capture_options.seen_and_told(capture, reading.path, numbers, calibration)
    sensor, scale = training_sensor(seen, own, threads=threads)
    chosen = {name: given[name] for name in ("frames", "max_intensity") if name in given}
    sensor = patch_sensor(sensor.replace(**chosen))
    out.print(
        f"{reading.path}: its brightest parts have intensity {scale:.3g}; learning for {sensor!r}",
        soft_wrap=True,
        markup=False,
    )
    return sensor, scale


def _brighter(scenes: Any, scale: float) -> Any:
    """Scenes times the brightness, which those that are made anew in each step are too."""
    if callable(scenes):

        def brighter(rng: np.random.Generator, number: int) -> Any:
            return np.float32(scale) * scenes(rng, number)

        return brighter
    return None if scenes is None else [np.float32(scale) * scene for scene in scenes]


def _files(images: str | Path | None) -> list[Path]:
    """What must not be overwritten: the file, or those in the folder."""
    if images is None or not Path(images).exists():
        return []
    return list(Path(images).iterdir()) if Path(images).is_dir() else [Path(images)]


def _two_layer(
    name: str, *, learning_rate: float | None, damping: float | None
) -> networks.Learner:
    if name not in OPTIMIZERS:
        raise ValueError(f"optimizer: expected one of {', '.join(OPTIMIZERS)}, got {name!r}")
    if name == "gauss-newton" and learning_rate is not None:
        raise ValueError("step-size: is for adam and projected-gradient, not for gauss-newton")
    if name != "gauss-newton" and damping is not None:
        raise ValueError(f"damping: is for gauss-newton, not for {name}")
    settings = {"learning_rate": learning_rate, "damping": damping}
    kind: Any = OPTIMIZERS[name]
    chosen: Optimizer = kind(**{key: value for key, value in settings.items() if value is not None})
    remedy = "--damping" if name == "gauss-newton" else "--learning-rate"
    return networks.Learner(learn, chosen.steps, {"optimizer": chosen}, remedy)


def _images(
    images: str | None,
    test: Path | None,
    key: str | None,
    test_key: str | None,
    white: float | None,
    seed: int,
) -> tuple[Any, Any]:
    if test_key is not None and test is None:
        raise ValueError("test-key: names an array of --test, and there is none")
    if images is None:
        if key is not None:
            raise ValueError(
                "key: names an array of the images, and there are none; --sensor-key names one of "
                "the capture"
            )
        return [photograph(name, gray=True) for name in PHOTOGRAPHS], (
            None if test is None else read_image_set(test, key=test_key, white=white)[1]
        )
    if images == _SYNTHETIC and not Path(images).exists():
        if key is not None:
            raise ValueError("key: names an array in a .npz, and the synthetic scenes are none")
        if test is None:
            return uniform_scenes, uniform_scenes(np.random.default_rng([seed, 1]), _TEST_SCENES)
        return uniform_scenes, read_image_set(test, key=test_key, white=white)[1]
    if not Path(images).exists():
        raise FileNotFoundError(
            f"there is no folder or file {images}; the word {_SYNTHETIC} stands for random scenes"
        )
    with progress(2) as begin:
        _, scenes = read_image_set(
            images, key=key, white=white, progress=begin("reading the images")
        )
        if test is None:
            return scenes, None
        _, tests = read_image_set(
            test,
            key=test_key,
            white=white,
            progress=begin("reading the test images"),
        )
    return scenes, tests


def _tell(output: Path, history: History, seconds: float, steps: int, plot: Path | None) -> None:
    first, last = history.records[0], history.records[-1]
    taken = len(history) - 1
    number = str(steps) if taken == steps else f"{taken} of {steps}"
    more = "" if taken == steps else "; --seconds gives it time for more"
    out.print(
        f"{output}: learned in {number} step{'' if steps == 1 else 's'} and {seconds:.1f} s, cost "
        f"{first.loss:.4g} to {last.loss:.4g}" + _gain(first, last) + more,
        soft_wrap=True,
        markup=False,
    )
    if plot is not None:
        out.print(f"Look at [bold]{plot}[/]", soft_wrap=True)


def _gain(first: Record, last: Record) -> str:
    if first.test_psnr is None or last.test_psnr is None:
        return "; with --test it would say how good it is on other images"
    return f", test PSNR {first.test_psnr:.2f} to {last.test_psnr:.2f} dB"
