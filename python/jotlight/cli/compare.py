"""`jotlight compare`: every method on one photograph, as a figure and a table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import typer
from rich.markup import escape
from rich.table import Table

from jotlight.cli import sensor_options
from jotlight.cli.console import out, progress
from jotlight.evaluation.compare import MethodResult, compare_methods, select_methods
from jotlight.evaluation.methods import DEFAULT_METHOD, METHODS, Method
from jotlight.files import atomic_write, refuse_overwrite
from jotlight.images.io import read_image
from jotlight.networks.network import Network
from jotlight.sensing.sensor import Sensor


@sensor_options.takes_sensor(oversampling=4, frames=1)
def compare(
    photo: Annotated[Path, typer.Argument(help="PNG, JPEG, TIFF or .npy.")],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The figure, .png, .jpg, .pdf or .svg. Default: PHOTO-compare.png.",
        ),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            "--methods",
            "-m",
            help=f"Some of {', '.join(METHODS)}, with commas. Default: all that are installed "
            "and serve the sensor; mle-iterative for smooth kernels only, being mle for the box.",
        ),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="A network of your own beside them, .safetensors.")
    ] = None,
    given: dict[str, Any],
    inputs: list[Path],
    seed: sensor_options.Seed = 0,
    gray: sensor_options.Gray = False,
    white: sensor_options.White = None,
    threads: sensor_options.Threads = None,
) -> None:
    """Turn a photograph into bits, reconstruct it by every method, and show all side by side."""
    sensor = Sensor(**given)
    names = None if methods is None else [name.strip() for name in methods.split(",")]
    image = read_image(photo, white=white, gray=gray)
    output = output or Path(f"{photo.stem}-compare.png")
    refuse_overwrite(output, [photo, model, *inputs])
    known, selected = dict(METHODS), select_methods(sensor, names)
    if model is not None:
        network = Network.load(model)
        network.check_sensor(sensor)
        known[str(model)] = Method(str(model), network.reconstruct)
        selected.append(str(model))
    run_comparison(image, sensor, output, selected, seed, threads, known)
    if names is None and (reason := METHODS[DEFAULT_METHOD].unsupported_reason(sensor)) is not None:
        out.print(f"[yellow]Without the learned network:[/] {escape(reason)}", soft_wrap=True)


def run_comparison(
    image: npt.NDArray[np.floating],
    sensor: Sensor,
    output: Path,
    names: list[str],
    seed: int,
    threads: int | None = None,
    methods: Mapping[str, Method] = METHODS,
) -> None:
    """Expose, reconstruct, draw and print; the figure appears whole or not at all."""
    from jotlight import plots

    plots.check_figure(output)
    if image.ndim == 3 and image.shape[2] not in (1, 3):
        raise ValueError(
            f"image: expected a grey or RGB picture to compare, got {image.shape[2]} channels"
        )
    with atomic_write(output) as temporary, progress(len(names) + 2) as begin:
        bits = sensor.expose(image, seed, threads=threads, progress=begin("drawing bits"))
        results = compare_methods(
            image, bits, sensor, names, threads=threads, begin=begin, methods=methods
        )
        begin("drawing the figure")
        height, width = image.shape[:2]
        panels = [
            plots.Panel("photograph", f"{height} × {width} pixels", image),
            plots.bits_panel(bits, sensor.oversampling),
        ]
        panels += [
            plots.Panel(
                methods[result.method].title,
                f"{result.psnr:.2f} dB   SSIM {_ssim(result)}   {_time(result.seconds)}",
                result.estimate,
            )
            for result in results
        ]
        heading = f"{sensor.bits_per_pixel} bits per pixel   {sensor!r}"
        figure = plots.comparison(panels, heading, white=sensor.max_intensity)
        figure.savefig(temporary, dpi=110)
    out.print(_table(results, methods))
    missing = [method.required_package for method in METHODS.values() if not method.available]
    if missing:
        extras = ", ".join(f"jotlight\\[{name}]" for name in missing)
        out.print(
            f"[dim]Not installed: {', '.join(map(str, missing))} (pip install '{extras}'; its "
            "licence is for non-commercial use)[/]"
        )
    out.print(f"Look at [bold]{output}[/]", soft_wrap=True)


def _table(results: list[MethodResult], methods: Mapping[str, Method]) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("method")
    for column in ("PSNR", "SSIM", "time"):
        table.add_column(column, justify="right")
    best = max(result.psnr for result in results)
    for result in results:
        table.add_row(
            methods[result.method].title,
            f"{result.psnr:.2f} dB",
            _ssim(result),
            _time(result.seconds),
            style="bold green" if result.psnr == best else "",
        )
    return table


def _ssim(result: MethodResult) -> str:
    return "none" if result.ssim is None else f"{result.ssim:.3f}"


def _time(seconds: float) -> str:
    return f"{1000 * seconds:.1f} ms" if seconds < 1 else f"{seconds:.2f} s"
