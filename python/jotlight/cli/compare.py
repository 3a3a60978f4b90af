"""``jotlight compare``: every method on one photograph, as a figure and a table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter
from rich.table import Table

from jotlight.cli.common_options import Gray, Model, Photo, Seed, Threads, White
from jotlight.cli.console import caution, out, progress, report
from jotlight.cli.sensor_options import ExposureOptions
from jotlight.evaluation.compare import MethodResult, compare_methods, select_methods
from jotlight.evaluation.methods import DEFAULT_METHOD, METHODS, Method
from jotlight.files import atomic_write, refuse_overwrite
from jotlight.images.io import read_image
from jotlight.networks.network import Network
from jotlight.sensing.bits import Bits
from jotlight.sensing.sensor import Sensor


def compare(
    photo: Photo,
    /,
    *,
    output: Annotated[
        Path | None,
        Parameter(
            alias="-o", help="The figure, .png, .jpg, .pdf or .svg. Default: PHOTO-compare.png."
        ),
    ] = None,
    methods: Annotated[
        str | None,
        Parameter(
            alias="-m",
            help=f"Some of {', '.join(METHODS)}, separated by commas. Default: all that are "
            "installed and serve the sensor. For the box kernel mle-iterative is left out, since "
            "it equals mle.",
        ),
    ] = None,
    model: Model = None,
    sensor: ExposureOptions = ExposureOptions(),
    seed: Seed = 0,
    gray: Gray = False,
    white: White = None,
    threads: Threads = None,
) -> None:
    """Simulate the bits of a photograph, and compare its estimates by every method."""
    exposed = Sensor(**sensor.to_kwargs())
    names = None if methods is None else [name.strip() for name in methods.split(",")]
    image = read_image(photo, white=white, gray=gray)
    output = output or Path(f"{photo.stem}-compare.png")
    refuse_overwrite(output, [photo, model, *sensor.map_files()])
    known, selected = dict(METHODS), select_methods(exposed, names)
    if model is not None:
        network = Network.load(model)
        network.check_sensor(exposed)
        known[str(model)] = Method(str(model), network.reconstruct)
        selected.append(str(model))
    run_comparison(image, exposed, output, selected, seed=seed, threads=threads, methods=known)
    reason = METHODS[DEFAULT_METHOD].unsupported_reason(exposed)
    if names is None and reason is not None:
        caution("Without the trained network", reason)


def run_comparison(
    image: npt.NDArray[np.floating],
    sensor: Sensor,
    output: Path,
    names: list[str],
    *,
    seed: int = 0,
    threads: int | None = None,
    methods: Mapping[str, Method] = METHODS,
) -> None:
    """Expose an image, reconstruct it by each method, and write the figure and the table."""
    import jotlight.plots as plots

    plots.check_figure(output)
    if image.ndim == 3 and image.shape[2] not in (1, 3):
        raise ValueError(
            f"image: expected a gray or RGB image to compare, got {image.shape[2]} channels"
        )
    with atomic_write(output) as temporary, progress(len(names) + 2) as begin:
        bits = sensor.expose(image, seed, threads=threads, progress=begin("drawing bits"))
        results = compare_methods(
            image, bits, sensor, names, threads=threads, begin=begin, methods=methods
        )
        begin("drawing the figure")
        _draw(temporary, image, bits, sensor, results, methods)
    out.print(_table(results, methods))
    missing = [method.required_package for method in METHODS.values() if not method.available]
    if missing:
        extras = ", ".join(f"jotlight[{name}]" for name in missing)
        report(
            f"Not installed: {', '.join(map(str, missing))} (pip install '{extras}'; its license "
            "is for non-commercial use)"
        )
    report(f"Figure: {output}")


def _draw(
    file: Path,
    image: npt.NDArray[np.floating],
    bits: Bits,
    sensor: Sensor,
    results: list[MethodResult],
    methods: Mapping[str, Method],
) -> None:
    import jotlight.plots as plots

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
    heading = f"{sensor.trials} trials per pixel   {sensor!r}"
    plots.save_figure(plots.comparison(panels, heading, white=sensor.max_intensity), file)


def _table(results: list[MethodResult], methods: Mapping[str, Method]) -> Table:
    """Return the quality and time of each method, with the best one in green."""
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
