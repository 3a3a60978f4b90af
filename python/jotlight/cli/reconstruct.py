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
from jotlight.cli import options
from jotlight.cli.console import err, live_iterations, out, progress
from jotlight.files import spare_inputs, written_whole
from jotlight.formats.npy import is_cube, load_bits, maps_beside, read_npy, read_npz
from jotlight.methods import DEFAULT, METHODS
from jotlight.network import Network
from jotlight.observation import as_counts
from jotlight.pictures import picture_writer
from jotlight.problems import Histories
from jotlight.sensor import Sensor
from jotlight.tv import NORMS
from jotlight.vst import INVERSES

_OTHERWISE = "noniterative-tv"
"""What serves every sensor, and is the best where the kernel is a box."""

_SMOOTH = "admm-tv"
"""What knows how a smooth kernel spreads the light."""


@options.takes_sensor()
def reconstruct(
    data: Annotated[
        Path,
        typer.Argument(
            help="Packed bits (.npy), or an image of counts (.npy, or .npz with --key)."
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
    key: options.Key = None,
    counts: Annotated[
        bool,
        typer.Option("--counts", help="The file holds counts, even if it looks like packed bits."),
    ] = False,
    width: Annotated[
        int | None, typer.Option(help="True width in jots, where no .json tells.")
    ] = None,
    given: dict[str, Any],
    inputs: list[Path],
    depth: Annotated[int, typer.Option(help="Bits of a .png: 8 or 16.")] = 8,
    threads: options.Threads = None,
) -> None:
    """Estimate the picture behind bits or counts.

    The sensor is the one that the bits carry, changed by the options given here.
    """
    spare_inputs(output, [data, model, *maps_beside(data), *inputs])
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
    seen, sensor, told = _read(data, key, counts, width, given)
    reason = None if "model" in settings else METHODS[method or DEFAULT].lacks(sensor)
    if reason is not None and method is not None:
        raise ValueError(reason)
    if method is None:
        smooth = sensor.kernel != "box" and isinstance(seen, Bits)
        method = DEFAULT if reason is None else _SMOOTH if smooth else _OTHERWISE
    write = picture_writer(output, depth=depth, white=sensor.max_intensity)
    done = ""
    with written_whole(output) as temporary:
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
    if reason is not None:
        err.print(f"[yellow]by {method}:[/] {escape(reason)}", soft_wrap=True)
    size = " x ".join(map(str, picture.shape))
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


def _read(
    path: Path, key: str | None, counts: bool, width: int | None, given: dict[str, Any]
) -> tuple[Bits | npt.NDArray[np.int32], Sensor, str]:
    """The data, their sensor, and in a word where it is from."""
    archive = path.suffix.lower() == ".npz"
    if key is not None and not archive:
        raise ValueError(f"key: names an array in a .npz, and {path} is none")
    array = read_npz(path, key) if archive else read_npy(path)
    # A photon cube is what uint8 of so many dimensions nearly always is; --counts says otherwise.
    if not counts and path.suffix.lower() == ".npy" and is_cube(array):
        bits = load_bits(path, width=width)
        if bits.sensor is None:
            sensor = Sensor(**{"frames": len(bits), **given})
            return bits, sensor, "nothing beside the bits tells their sensor; assumed"
        return bits, bits.sensor.replace(**given), "sensor"
    if "frames" not in given and "oversampling" not in given:
        raise ValueError(
            f"{path}: holds counts, and nothing tells out of how many bits; give --frames, or "
            "--oversampling where a pixel covers many jots"
        )
    return as_counts(array), Sensor(**given), "assumed"
