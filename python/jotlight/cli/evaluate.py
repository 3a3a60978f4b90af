"""``jotlight evaluate``: the quality of a network or method on many images."""

import contextlib
import json
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.table import Table

from jotlight._engine import __version__
from jotlight.cli.captures.applied_calibration import check_record, record_path
from jotlight.cli.options.common_options import (
    OWN,
    ImageKey,
    Model,
    Precision,
    Quality,
    Seed,
    Threads,
    White,
)
from jotlight.cli.options.method_options import one_method
from jotlight.cli.options.sensor_options import EvaluatedSensorOptions
from jotlight.cli.reports.simulated_origin import simulated_origin
from jotlight.cli.terminal.console import out, progress, report
from jotlight.errors import counted, hide_warnings
from jotlight.evaluation.choice import OWN_NETWORK, title_of
from jotlight.evaluation.evaluate import COLUMNS, Evaluation
from jotlight.evaluation.evaluate import evaluate as evaluate_method
from jotlight.evaluation.methods import DEFAULT_METHOD, METHODS, find_method
from jotlight.evaluation.own_method import OwnMethod, import_method
from jotlight.evaluation.records.records import FORMAT
from jotlight.files import atomic_write_together, check_outputs, write_file
from jotlight.formats.files.checksums import file_checksum
from jotlight.images.sets import read_image_set
from jotlight.networks.network import Network
from jotlight.sensing.parameters.intensity_scale import MEANING
from jotlight.sensing.sensor import Sensor


# One parameter for each option, and one for those of a sensor.
def evaluate(
    images: Annotated[
        Path, Parameter(help="A folder of photographs, or an array (N, H, W) in .npy or .npz.")
    ],
    /,
    *,
    method: Annotated[
        str | None,
        Parameter(
            alias="-m",
            # Other commands compare the methods of a repeated option. This one runs one method.
            allow_repeating=False,
            help=f"One of {', '.join(METHODS)}; or {OWN}. Default: {DEFAULT_METHOD}.",
        ),
    ] = None,
    quality: Quality = None,
    model: Model = None,
    precision: Precision = None,
    output: Annotated[
        Path | None,
        Parameter(
            alias="-o",
            help="A .csv with a row for each image. Its record, OUTPUT.json, lies beside it. "
            "Default: none.",
        ),
    ] = None,
    first: Annotated[
        int | None,
        Parameter(help="Number of images to use, in the order of their names. Default: all."),
    ] = None,
    key: ImageKey = None,
    sensor: EvaluatedSensorOptions = EvaluatedSensorOptions(),
    seed: Seed = 0,
    white: White = None,
    threads: Threads = None,
) -> None:
    """Simulate the bits of every image, reconstruct it, and report the mean quality.

    The sensor is the model's, changed by the options. Without a model, or with a model for any
    sensor, the sensor has 4 x 4 jots per pixel and one frame. Color photographs are converted to
    gray. PSNR and SSIM are for a peak of 1.
    """
    name = one_method(method, quality, model)
    if output is not None:
        if output.suffix.lower() != ".csv":
            raise ValueError(f"{output}: expected a name that ends in .csv")
        files = list(images.iterdir()) if images.is_dir() else [images]
        check_record(record_path(output))
        check_outputs([output, record_path(output)], [model, *sensor.map_files(), *files])
    title, run, exposed = _method(name, model, sensor)
    with contextlib.ExitStack() as stack:
        # The files are created now, to reveal a folder that cannot be written before any work.
        temporaries = []
        if output is not None:
            writing = atomic_write_together([output], [record_path(output)])
            temporaries = stack.enter_context(writing)
        begin = stack.enter_context(progress(2))
        names, scenes = read_image_set(
            images,
            key=key,
            white=white,
            first=first,
            max_intensity=exposed.max_intensity,
            progress=begin("reading the images"),
        )
        with hide_warnings(MEANING):  # the files were checked
            result = evaluate_method(
                run,
                scenes,
                exposed,
                names=names,
                precision=precision,
                rng=seed,
                threads=threads,
                progress=begin("reconstructing"),
            )
        if temporaries:
            used = OWN_NETWORK if model is not None else name or DEFAULT_METHOD
            options = {"seed": seed, "first": first, "key": key, "white": white}
            origin = simulated_origin(
                f"{images.resolve().name}, {counted(len(names), 'image')}",
                [images / name for name in names] if images.is_dir() else [images],
                *(exposed, used, model, {**options, "precision": precision}),
            )
            _write_scores(result, origin, *temporaries)
    report(f"{title}, {counted(len(names), 'image')}, {exposed!r}")
    out.print(_table(result))
    if output is not None:
        report(f"Scores of each image: {output}")


def _write_scores(result: Evaluation, origin: dict[str, Any], table: Path, record: Path) -> None:
    """Write the temporary files of a table of scores and of its record."""
    result.write_csv(table)
    content = {"format": FORMAT, "version": 1, "jotlight": __version__, "origin": origin}
    content["sha256"] = file_checksum(table)
    write_file(record, json.dumps(content, indent=2) + "\n")


def _method(
    method: str | None, model: Path | None, options: EvaluatedSensorOptions
) -> tuple[str, str | Network | OwnMethod, Sensor]:
    """Return the title of a method, the method, and the sensor that exposes."""
    network = None if model is None else Network.load(model)
    sensor = options.sensor_for(network)
    if network is not None:
        return str(model), network, sensor
    method = method or DEFAULT_METHOD
    if ":" in method:
        return method, import_method(method), sensor
    named = find_method(method)
    if (reason := named.unsupported_reason(sensor)) is not None:
        raise ValueError(reason)
    return title_of(method, sensor), method, sensor


def _table(result: Evaluation) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in COLUMNS:
        table.add_column(column, justify="right" if column else "left")
    for row in result.rows():
        table.add_row(*row)
    return table
