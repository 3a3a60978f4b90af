"""`jotlight reconstruct`: bits or counts into a picture."""

import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape

from jotlight.cli import brightness, capture_options, sensor_options
from jotlight.cli import output_options as output_
from jotlight.cli.applied_calibration import AppliedCalibration, recorded
from jotlight.cli.console import err, live_iterations, out, progress
from jotlight.cli.video import check_film, film, refuse_existing_folder
from jotlight.estimators.brightness import BRIGHTNESS_QUANTILE
from jotlight.estimators.problem import ConvergenceHistories
from jotlight.estimators.tv import NORMS
from jotlight.estimators.vst import INVERSES
from jotlight.evaluation.methods import DEFAULT_METHOD, METHODS
from jotlight.files import refuse_overwrite
from jotlight.images.io import image_writer
from jotlight.images.video import windows
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained, unsupported_reason
from jotlight.sensing.bits import Bits, check_fits
from jotlight.sensing.reference import saturation_intensity

_OTHERWISE = "noniterative-tv"
"""What serves every sensor, and is the best where the kernel is a box."""

_SMOOTH = "admm-tv"
"""What knows how a smooth kernel spreads the light."""

_SHIPPED = {
    "network-two-layer": "two-layer",
    "network-small": "small",
    "network-medium": "medium",
    "network-large": "large",
}
"""The qualities of the networks that come with jotlight."""

_RAISED = "the largest intensity is half a count from saturation, so that nothing else is clipped"


@sensor_options.takes_sensor()
def reconstruct(
    data: Annotated[
        Path,
        typer.Argument(
            help="A capture of bits or counts, a file or a folder: what `jotlight info` tells of."
        ),
    ],
    *,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help=".png or .jpg to look at, .tif, .exr or .npy for floats that are never clipped.",
        ),
    ],
    method: Annotated[
        str | None,
        typer.Option(
            "--method",
            "-m",
            help=f"One of {', '.join(METHODS)}. Default: {DEFAULT_METHOD}, where it serves the "
            f"sensor, and else {_OTHERWISE}, or {_SMOOTH} where the kernel is smooth.",
        ),
    ] = None,
    inverse: Annotated[
        str | None,
        typer.Option(help=f"Of the non-iterative methods: {' or '.join(INVERSES)}."),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="A network of your own: a .safetensors file.")
    ] = None,
    weight: Annotated[
        float | None,
        typer.Option(
            help="Of total variation, for admm-tv, in nats per unit of intensity. Default: chosen "
            "from the data.",
            rich_help_panel="Iterative methods",
        ),
    ] = None,
    norm: Annotated[
        str | None,
        typer.Option(
            help=f"Of total variation, for admm-tv: {' or '.join(NORMS)}. Default: {NORMS[0]}.",
            rich_help_panel="Iterative methods",
        ),
    ] = None,
    tol: Annotated[
        float | None,
        typer.Option(
            help="Residual at which the method is done. Default: 1e-3 for admm-tv, 1e-6 for "
            "mle-iterative.",
            rich_help_panel="Iterative methods",
        ),
    ] = None,
    max_iter: Annotated[
        int | None,
        typer.Option(help="Iterations at most. Default: 500.", rich_help_panel="Iterative methods"),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Dark counts, dead jots and response, from `jotlight calibrate`; what was applied "
            "is kept in OUTPUT.json.",
            rich_help_panel="Sensor",
        ),
    ] = None,
    key: capture_options.Key = None,
    counts: capture_options.Counts = None,
    unpacked: capture_options.Unpacked = None,
    width: capture_options.Width = None,
    format_: capture_options.Format = None,
    frame_range: capture_options.FrameRange = None,
    rotate: capture_options.Rotate = 0,
    flip: capture_options.Flip = None,
    given: dict[str, Any],
    inputs: list[Path],
    words: dict[str, list[str]],
    units: output_.Units = "intensity",
    preview: output_.Preview = None,
    curve: output_.Curve = None,
    uncertainty: output_.UncertaintyFile = None,
    level: output_.Level = 0.95,
    window: output_.Window = None,
    step: output_.Step = None,
    fps: output_.Fps = 25.0,
    depth: Annotated[int, typer.Option(help="Bits of a .png: 8 or 16.")] = 8,
    threads: sensor_options.Threads = None,
) -> None:
    """Estimate the picture behind bits or counts.

    The sensor is the one that the bits carry, changed by the calibration and then by the options
    given here.
    """
    wanted = output_.OutputOptions(output, preview, uncertainty, units, curve, level, depth)
    for path in wanted.paths():
        refuse_overwrite(path, [model, calibration, *inputs])
        capture_options.refuse_capture_overwrite(path, data)
    if window is not None:
        check_film(wanted, fps)
        if "frames" in given:
            raise ValueError(
                "frames: --window says how many frames a picture has; --frame-range takes some of "
                "the capture's"
            )
        refuse_existing_folder(output)
    elif step is not None:
        raise ValueError("step: is for a film, which --window asks for")
    else:
        image_writer(output, depth=depth)
    if uncertainty is not None and method not in (None, "mle"):
        raise ValueError(
            f"uncertainty: is known for the method mle, not for {method}, whose pixels depend on "
            "their neighbours; leave --uncertainty out, or take --method mle"
        )
    if method is None and uncertainty is not None:
        method = "mle"
    if method is None and model is not None:
        method = "network-two-layer"
    if method is None and inverse is not None:
        method = _OTHERWISE
    if method is None and any(value is not None for value in (weight, norm, tol, max_iter)):
        method = _SMOOTH
    settings = _method_settings(
        method or DEFAULT_METHOD,
        inverse=inverse,
        model=model,
        weight=weight,
        norm=norm,
        tol=tol,
        max_iter=max_iter,
    )
    reading = capture_options.CaptureOptions(
        data, format_, width, frame_range, rotate, flip, key, counts, unpacked
    )
    capture = reading.open()
    known = None if calibration is None else AppliedCalibration.read(calibration, output)
    if known is not None:
        capture_options.refuse_capture_overwrite(known.record, data)
        refuse_overwrite(known.record, [model, calibration, *inputs])
    found = known.calibration if known else None
    seen, sensor, told = capture_options.seen_by_sensor(capture, data, given, found)
    network = settings.pop("model", None)
    if network is not None and network.trials_range is None and "max_intensity" not in given:
        # A network's outputs lie in its own range, whatever range others would be clipped to.
        sensor = sensor.replace(max_intensity=network.sensor.max_intensity)
    if window is not None:
        if not isinstance(seen, Bits):
            raise ValueError(f"window: is for bits, and {data} holds counts")
        check_fits(seen, sensor)
        windows(seen, window, step)
        sensor = sensor.replace(frames=window)
    learn = brightness.to_learn(
        reading, calibration, words, window=window, bits=isinstance(seen, Bits)
    )
    advice = []
    shipped = network is None and (method is None or method in _SHIPPED)
    if (
        shipped
        and (reason := unsupported_reason(sensor, _SHIPPED[method or DEFAULT_METHOD])) is not None
    ):
        advice.append(f"{reason}; {learn}")
        if method is not None:
            raise ValueError(advice[0])
        shipped = False
        method = _SMOOTH if sensor.kernel != "box" and isinstance(seen, Bits) else _OTHERWISE
    method = method or DEFAULT_METHOD
    if shipped:
        network = pretrained(sensor, _SHIPPED[method])
    white, free = sensor.max_intensity, saturation_intensity(sensor)
    assumed = told != "sensor" and "max_intensity" not in given and sensor.kernel == "box"
    higher = assumed and free > white
    # A network was trained for its own largest intensity, unless it is told K.
    one_range = network is not None and network.trials_range is None
    raised = higher and not one_range
    if raised:
        sensor = sensor.replace(max_intensity=free)
    run = METHODS[method].run if network is None else network.reconstruct

    def tell(largest: float, brightest: float) -> None:
        """Say what was assumed, and what is not as good as it could be."""
        applied = [] if known is None else known.told(sensor, capture.provenance)
        for line in (
            *capture_options.describe_provenance(capture.provenance),
            *applied,
            f"{told}: {sensor!r}",
        ):
            out.print(line, soft_wrap=True, markup=False)
        if raised:
            out.print(f"{_RAISED}; --max-intensity sets another", soft_wrap=True)
        if higher and not raised and brightness.comes_up(largest, white):
            advice.append(
                brightness.held_down(white, DEFAULT_METHOD, free, learn if shipped else None)
            )
        elif shipped and one_range and (dim := brightness.too_dim(brightest, learn)) is not None:
            advice.append(dim)
        for line in advice:
            err.print(f"[yellow]by {method}:[/] {escape(line)}", soft_wrap=True)

    if window is not None and isinstance(seen, Bits):
        once = functools.partial(run, threads=threads, **settings)
        title = METHODS[method].title
        with recorded(known) as record:
            levels = film(
                seen, sensor, once, wanted, window=window, step=step, fps=fps, title=title
            )
            record(sensor, method, data.name, capture.provenance)
        tell(*levels)
        return
    done = ""
    with wanted.files() as files, recorded(known) as record:
        start = time.perf_counter()
        if METHODS[method].iterative:
            with live_iterations(METHODS[method].title) as callback:
                picture, histories = run(
                    seen,
                    sensor,
                    threads=threads,
                    callback=callback,
                    return_history=True,
                    **settings,
                )
            done = _told(histories)
        else:
            with progress(None) as begin:
                begin(METHODS[method].title)
                picture = run(seen, sensor, threads=threads, **settings)
        seconds = time.perf_counter() - start
        title = METHODS[method].title
        note = wanted.note(sensor, title, capture.provenance)
        wanted.write(files, picture, seen, sensor, white=white, note=note, threads=threads)
        record(sensor, method, data.name, capture.provenance)
    size = " x ".join(map(str, picture.shape))
    scale = wanted.scale(sensor)
    what = "intensities" if units == "intensity" else output_.UNITS[units]
    out.print(
        f"{output}: {size}, {what} {scale * picture.min():.3g} to {scale * picture.max():.3g}, by "
        f"{title}{done} in {seconds:.3g} s",
        soft_wrap=True,
        markup=False,
    )
    for beside, told_ in ((preview, "to look at"), (uncertainty, f"intervals of {level:g}")):
        if beside is not None:
            out.print(f"{beside}: {told_}", soft_wrap=True, markup=False)
    tell(float(picture.max()), float(np.quantile(picture, BRIGHTNESS_QUANTILE)))


def _method_settings(
    method: str, *, model: Path | None, inverse: str | None, **iterative: Any
) -> dict[str, Any]:
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    given = {"inverse": inverse, "model": model, **iterative}
    settings = {name: value for name, value in given.items() if value is not None}
    for name in settings:
        whose, serves = _WHOSE[name]
        if not serves(method):
            raise ValueError(f"{name.replace('_', '-')}: is for {whose}, not for {method}")
    if model is not None:
        settings["model"] = Network.load(model)
    return settings


_WHOSE: dict[str, tuple[str, Callable[[str], bool]]] = {
    "inverse": ("the non-iterative methods", lambda method: method.startswith("noniterative")),
    "model": ("the method network-two-layer", lambda method: method == "network-two-layer"),
    "weight": ("the method admm-tv", lambda method: method == "admm-tv"),
    "norm": ("the method admm-tv", lambda method: method == "admm-tv"),
    "tol": ("the iterative methods", lambda method: METHODS[method].iterative),
    "max_iter": ("the iterative methods", lambda method: METHODS[method].iterative),
}
"""To which methods each setting belongs."""


def _told(histories: ConvergenceHistories) -> str:
    """How the iterations ended, the longest of those of all channels."""
    each = histories if isinstance(histories, list) else [histories]
    longest = max(history.iterations for history in each)
    words = f"{longest} iteration{'' if longest == 1 else 's'}"
    if not all(history.converged for history in each):
        words += ", NOT converged"
    if (weight := float(np.mean([np.mean(history.weight) for history in each]))) > 0:
        words += f", weight {weight:.3g}"
    return f" ({words})"
