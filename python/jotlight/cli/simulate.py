"""``jotlight simulate``: the bits of a photograph."""

import math
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.checks import as_image
from jotlight.cli.common_options import Gray, Photo, Seed, Threads, White
from jotlight.cli.console import progress, report
from jotlight.cli.sensor_options import ExposureOptions
from jotlight.files import refuse_overwrite
from jotlight.formats.cube import create_bits
from jotlight.formats.description import companion_files
from jotlight.images.io import read_image
from jotlight.sensing.sensor import Sensor


def simulate(
    photo: Photo,
    /,
    *,
    output: Annotated[
        Path,
        Parameter(
            alias="-o", help="Packed bits, .npy. A .json that describes them lies beside it."
        ),
    ],
    sensor: ExposureOptions = ExposureOptions(),
    seed: Seed = 0,
    gray: Gray = False,
    white: White = None,
    threads: Threads = None,
) -> None:
    """Simulate the bits that a quanta image sensor reports of a photograph."""
    exposed = Sensor(**sensor.to_kwargs())
    maps = [output.with_suffix(f".{name}.npy") for name in exposed.maps()]
    for file in {output, output.with_suffix(".json"), *maps, *companion_files(output)}:
        refuse_overwrite(file, [photo, *sensor.map_files()])
    image = as_image(read_image(photo, white=white, gray=gray))
    height, width = (size * exposed.oversampling for size in image.shape[:2])
    shape = (exposed.frames, height, math.ceil(width / 8), *image.shape[2:])
    with create_bits(output, shape, width, exposed) as packed, progress(1) as begin:
        bits = exposed.expose(
            image, seed, out=packed, threads=threads, progress=begin("drawing bits")
        )
    report(f"{output}: {bits!r}")
