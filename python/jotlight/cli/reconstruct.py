"""`jotlight reconstruct`: bits or counts into a picture."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import typer
from rich.markup import escape

from jotlight.bits import Bits
from jotlight.calibration import Calibration
from jotlight.cli import opening, options
from jotlight.cli.calibrated import Calibrated, recorded
from jotlight.cli.console import err, live_iterations, out, progress
from jotlight.exposure import BRIGHT
from jotlight.files import spare_inputs, written_whole
from jotlight.formats import open_capture
from jotlight.formats.capture import Capture
from jotlight.methods import DEFAULT, METHODS
from jotlight.network import Network
from jotlight.pictures import picture_writer
from jotlight.problems import Histories
from jotlight.sensor import Sensor
from jotlight.tv import NORMS
from jotlight.vst import INVERSES

_OTHERWISE = "noniterative-tv"
"""What serves every sensor, and is the best where the kernel is a box."""

_DIM = 0.7
"""A scene whose brightest parts have less intensity is not what the shipped networks are for."""

_CLIPPED, _MOST_CLIPPED = 0.98, 0.05
"""Nor is one of which a larger share comes out above this intensity."""

_SMOOTH = "admm-tv"
"""What knows how a smooth kernel spreads the light."""


@options.takes_sensor()
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
            "--output", "-o", help=".png or .jpg to look at, .tif or .npy for floats as they are."
        ),
    ],
    method: Annotated[
        str | None,
        typer.Option(
            "--method",
            "-m",
            help=f"One of {', '.join(METHODS)}. Default: {DEFAULT}, where there is one for the "
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
    key: opening.Key = None,
    counts: opening.Counts = None,
    width: opening.Width = None,
    format_: opening.Format = None,
    frame_range: opening.FrameRange = None,
    rotate: opening.Rotate = 0,
    flip: opening.Flip = None,
    given: dict[str, Any],
    inputs: list[Path],
    depth: Annotated[int, typer.Option(help="Bits of a .png: 8 or 16.")] = 8,
    threads: options.Threads = None,
) -> None:
    """Estimate the picture behind bits or counts.

    The sensor is the one that the bits carry, changed by the calibration and then by the options
    given here.
    """
    spare_inputs(output, [model, calibration, *inputs])
    opening.spare_capture(output, data)
    if method is None and inverse is not None:
        method = _OTHERWISE
    if method is None and any(value is not None for value in (weight, norm, tol, max_iter)):
        method = _SMOOTH
    settings = _method_settings(
        method or DEFAULT,
        inverse=inverse,
        model=model,
        weight=weight,
        norm=norm,
        tol=tol,
        max_iter=max_iter,
    )
    capture = open_capture(
        data,
        format=format_,
        width=width,
        frames=opening.frames_of(frame_range),
        rotate=rotate,
        flip=flip,
        key=key,
        counts=counts,
    )
    known = None if calibration is None else Calibrated.read(calibration, output)
    if known is not None:
        opening.spare_capture(known.record, data)
        spare_inputs(known.record, [model, calibration, *inputs])
    seen, sensor, told = _seen(capture, data, given, known.calibration if known else None)
    if "model" in settings and "max_intensity" not in given:
        # A network's outputs lie in its own range, whatever range others would be clipped to.
        sensor = sensor.replace(max_intensity=settings["model"].sensor.max_intensity)
    shipped = method in (None, "network") and "model" not in settings
    reason = None if "model" in settings else METHODS[method or DEFAULT].lacks(sensor)
    if reason is not None and method is not None:
        raise ValueError(reason)
    if method is None:
        smooth = sensor.kernel != "box" and isinstance(seen, Bits)
        method = DEFAULT if reason is None else _SMOOTH if smooth else _OTHERWISE
    write = picture_writer(output, depth=depth, white=sensor.max_intensity)
    done = ""
    with written_whole(output) as temporary, recorded(known) as record:
        start = time.perf_counter()
        if METHODS[method].iterative:
            with live_iterations(METHODS[method].title) as callback:
                picture, histories = METHODS[method].run(
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
                network = settings.pop("model", None)
                run = METHODS[method].run if network is None else network.reconstruct
                picture = run(seen, sensor, threads=threads, **settings)
        seconds = time.perf_counter() - start
        write(temporary, picture)
        record(sensor, method, data.name, capture.source)
    if reason is not None:
        err.print(f"[yellow]by {method}:[/] {escape(reason)}", soft_wrap=True)
    elif shipped and method == DEFAULT and (words := _misfit(picture, data)) is not None:
        err.print(f"[yellow]by {method}:[/] {escape(words)}", soft_wrap=True)
    size = " x ".join(map(str, picture.shape))
    for line in opening.told(capture.source):
        out.print(line, soft_wrap=True, markup=False)
    if known is not None:
        for line in known.told(sensor):
            out.print(line, soft_wrap=True, markup=False)
    out.print(
        f"{output}: {size}, intensities {picture.min():.3g} to {picture.max():.3g}, by "
        f"{METHODS[method].title}{done} in {seconds:.3g} s\n{told}: {sensor!r}",
        soft_wrap=True,
        markup=False,
    )


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
    "model": ("the method network", lambda method: method == "network"),
    "weight": ("the method admm-tv", lambda method: method == "admm-tv"),
    "norm": ("the method admm-tv", lambda method: method == "admm-tv"),
    "tol": ("the iterative methods", lambda method: METHODS[method].iterative),
    "max_iter": ("the iterative methods", lambda method: METHODS[method].iterative),
}
"""To which methods each setting belongs."""


def _misfit(picture: npt.NDArray[np.float32], data: Path) -> str | None:
    """Say that a scene is not as bright as those that the shipped networks are trained for."""
    brightest = float(np.quantile(picture, BRIGHT))
    clipped = float(np.mean(picture > _CLIPPED))
    if brightest < _DIM:
        shown = f"here they have {brightest:.2g}"
    elif clipped > _MOST_CLIPPED:
        shown = f"here {clipped:.0%} of the picture may have more"
    else:
        return None
    return (
        "the network that comes with jotlight is for scenes whose brightest parts have intensity "
        f"1, and {shown}; learn one for this capture in a minute: jotlight train --sensor {data} "
        "-o model.safetensors, and add --model model.safetensors"
    )


def _told(histories: Histories) -> str:
    """How the iterations ended, the longest of those of all channels."""
    each = histories if isinstance(histories, list) else [histories]
    longest = max(history.iterations for history in each)
    words = f"{longest} iteration{'' if longest == 1 else 's'}"
    if not all(history.converged for history in each):
        words += ", NOT converged"
    if (weight := float(np.mean([np.mean(history.weight) for history in each]))) > 0:
        words += f", weight {weight:.3g}"
    return f" ({words})"


def _seen(
    capture: Capture, path: Path, given: dict[str, Any], calibration: Calibration | None
) -> tuple[Bits | npt.NDArray[np.int32], Sensor, str]:
    """The data, their sensor, and in a word where it is from."""
    if isinstance(capture, Bits):
        if calibration is not None:
            calibration.check_shape(capture.shape[1:3])
        if capture.sensor is None:
            words = "nothing beside the bits tells their sensor; assumed"
            if calibration is not None:
                return capture, calibration.sensor(**{"frames": len(capture), **given}), words
            return capture, Sensor(**{"frames": len(capture), **given}), words
        if calibration is not None:
            return capture, calibration.applied_to(capture.sensor, **given), "sensor"
        return capture, capture.sensor.replace(**given), "sensor"
    if "frames" not in given and "oversampling" not in given:
        raise ValueError(
            f"{path}: holds counts, and nothing tells out of how many bits; give --frames, or "
            "--oversampling where a pixel covers many jots"
        )
    with progress(1) as begin:
        counts = capture.sum(begin("summing"))
    if calibration is None:
        return counts, Sensor(**given), "assumed"
    side = given.get("oversampling", 1)
    calibration.check_shape(tuple(side * size for size in counts.shape[:2]))
    return counts, calibration.sensor(**given), "assumed"
