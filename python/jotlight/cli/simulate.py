"""``jotlight simulate``: the bits of a photograph."""

import math
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from jotlight.checks import as_image
from jotlight.cli.common_options import Gray, Photo, Seed, Threads, White
from jotlight.cli.console import progress, report
from jotlight.cli.sensor_options import ExposureOptions
from jotlight.files import refuse_overwrite
from jotlight.formats.description import companion_files
from jotlight.formats.writing import choose_output_format, write_capture
from jotlight.images.io import read_image
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames, Packed
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

    def draw(start: int, stop: int) -> Packed:
        frames = slice(start, stop)
        return np.asarray(exposed.expose(image, seed, frames=frames, threads=threads).packed)

    bits = Bits(Frames(shape, draw), width, exposed)
    with progress(1) as begin:
        write_capture(bits, output, choose_output_format(output, "npy"), begin("drawing bits"))
    report(f"{output}: {bits!r}")
