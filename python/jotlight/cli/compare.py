"""``jotlight compare``: every method on one photograph, as a figure and a table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter
from rich.table import Table

from jotlight.cli.options.common_options import NAMES, OWN, Gray, Model, Photo, Seed, Threads, White
from jotlight.cli.options.method_options import split_names
from jotlight.cli.options.sensor_options import ModelSensorOptions
from jotlight.cli.reports.simulated_origin import simulated_origin
from jotlight.cli.terminal.console import out, progress, report
from jotlight.estimators.demosaicing import COLORS
from jotlight.evaluation.choice import title_of
from jotlight.evaluation.compare import COLUMNS, Comparison, default_methods
from jotlight.evaluation.compare import compare as compare_by_title
from jotlight.evaluation.methods import METHODS
from jotlight.evaluation.own_method import import_method
from jotlight.evaluation.request import AnyMethod
from jotlight.evaluation.requested_method import network_name
from jotlight.evaluation.run_methods import select_methods
from jotlight.files import atomic_write, check_outputs
from jotlight.images.io import read_image
from jotlight.networks.architectures import QUALITIES
from jotlight.networks.loading import load_image_network
from jotlight.sensing.sensor import Sensor


def compare(
    photo: Photo,
    /,
    *,
    output: Annotated[
        Path | None,
        Parameter(
            alias="-o", help="The figure, .png, .jpg, .pdf, or .svg. Default: PHOTO-compare.png."
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        Parameter(
            alias="-m",
            help=f"Some of {NAMES}; or {OWN}. Separate them by commas, or repeat the option. "
            "Default: all that are installed and serve the sensor. For the box kernel "
            "mle-iterative is left out, since it equals mle.",
        ),
    ] = None,
    quality: Annotated[
        list[str] | None,
        Parameter(
            help=f"Some of the trained networks by their sizes, {', '.join(QUALITIES)}, in "
            "addition to the methods that are named. Default: all that serve the sensor."
        ),
    ] = None,
    model: Model = None,
    sensor: ModelSensorOptions = ModelSensorOptions(),
    seed: Seed = 0,
    gray: Gray = False,
    white: White = None,
    threads: Threads = None,
) -> None:
    """Simulate the bits of a photograph, and compare its estimates by every method.

    The sensor is the model's, changed by the options. Without a model, or with a model for any
    sensor, the sensor has 4 x 4 jots per pixel and one frame. PSNR and SSIM are for a peak of 1.
    """
    network = None if model is None else load_image_network(model)
    exposed = sensor.sensor_for(network)
    names = [*split_names(method), *map(network_name, split_names(quality))]
    selected: dict[str, AnyMethod | None] = _select(exposed, names)
    image = read_image(photo, white=white, gray=gray)
    selected = selected or {**default_methods(exposed, is_color=image.ndim == 3)}
    output = output or Path(f"{photo.stem}-compare.png")
    check_outputs([output], [photo, model, *sensor.map_files()])
    if model is not None and network is not None:
        network.check_sensor(exposed)
        selected[model.name] = network
    options = {"seed": seed, "gray": gray, "white": white}
    names_of = [name if isinstance(name, str) else title for title, name in selected.items()]
    made = exposed, names_of, model, options
    is_color = image.shape[2:] == (COLORS,)
    note = simulated_origin(photo.name, [photo], *made, is_color=is_color)
    run_comparison(image, exposed, output, selected, note, seed=seed, threads=threads)
    if not names:
        _report_missing()


def _select(sensor: Sensor, names: list[str]) -> dict[str, AnyMethod | None]:
    """Return the methods of some names by their titles."""
    selected: dict[str, AnyMethod | None] = {}
    for name in names:
        if ":" in name:
            selected[name] = import_method(name)
        else:
            select_methods(sensor, [name])
            selected[title_of(name, sensor)] = name
    return selected


def run_comparison(
    image: npt.NDArray[np.floating],
    sensor: Sensor,
    output: Path,
    methods: Mapping[str, AnyMethod | None],
    note: Mapping[str, Any],
    *,
    seed: int = 0,
    threads: int | None = None,
) -> None:
    """Compare methods by their titles, and write the figure, with its origin, and the table."""
    import jotlight.plots as plots

    plots.check_figure(output)
    with atomic_write(output) as temporary:
        axis = None if image.ndim == 2 else -1
        found = compare_by_title(
            methods, image, sensor, channel_axis=axis, rng=seed, threads=threads, progress=True
        )
        with progress(None) as begin:
            begin("drawing the figure")
            plots.save_figure(found.plot(), temporary, note=note)
    out.print(_table(found))
    report(f"Figure: {output}")


def _report_missing() -> None:
    """Print which packages of methods are not installed."""
    missing = [method.required_package for method in METHODS.values() if not method.available]
    if missing:
        extras = ", ".join(f"jotlight[{name}]" for name in missing)
        report(
            f"Not installed: {', '.join(map(str, missing))} (pip install '{extras}'; its license "
            "is for non-commercial use)"
        )


def _table(found: Comparison) -> Table:
    """Return the quality and time of each method, with the best one in green."""
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in COLUMNS:
        table.add_column(column, justify="left" if column == "method" else "right")
    best = max(result.psnr for result in found.results)
    for row, result in zip(found.rows(), found.results, strict=True):
        table.add_row(*row, style="bold green" if result.psnr == best else "")
    return table
