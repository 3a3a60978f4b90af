"""`jotlight simulate`: a photograph into bits."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from jotlight.checks import as_image
from jotlight.cli import sensor_options
from jotlight.cli.console import out, progress
from jotlight.files import refuse_overwrite
from jotlight.formats.description import companion_files
from jotlight.formats.cube import create_bits
from jotlight.images.io import read_image
from jotlight.sensing.sensor import Sensor


@sensor_options.takes_sensor(oversampling=4, frames=1)
def simulate(
    photo: Annotated[Path, typer.Argument(help="PNG, JPEG, TIFF or .npy.")],
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Packed bits, .npy; a .json goes beside it.")
    ],
    given: dict[str, Any],
    inputs: list[Path],
    seed: sensor_options.Seed = 0,
    gray: sensor_options.Gray = False,
    white: sensor_options.White = None,
    threads: sensor_options.Threads = None,
) -> None:
    """Draw the bits that a quanta image sensor would report of a photograph."""
    sensor = Sensor(**given)
    maps = [output.with_suffix(f".{name}.npy") for name in sensor.maps()]
    for file in {output, output.with_suffix(".json"), *maps, *companion_files(output)}:
        refuse_overwrite(file, [photo, *inputs])
    image = as_image(read_image(photo, white=white, gray=gray))
    height, width = (size * sensor.oversampling for size in image.shape[:2])
    shape = (sensor.frames, height, math.ceil(width / 8), *image.shape[2:])
    with (
        create_bits(output, shape, width, sensor) as packed,
        progress(1) as begin,
    ):
        bits = sensor.expose(
            image, seed, out=packed, threads=threads, progress=begin("drawing bits")
        )
    out.print(f"{output}: {bits!r}", soft_wrap=True, markup=False)
