"""`jotlight simulate`: a photograph into bits."""

import math
from pathlib import Path
from typing import Annotated

import typer

from jotlight.cli import options
from jotlight.cli.console import out, progress
from jotlight.formats.npy import created_bits
from jotlight.image import as_image
from jotlight.pictures import read_picture
from jotlight.sensor import Sensor


def simulate(
    photo: Annotated[Path, typer.Argument(help="PNG, JPEG, TIFF or .npy.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Packed bits, .npy; a .json goes beside it.")
    ],
    oversampling: options.Oversampling = 4,
    frames: options.Frames = 1,
    gain: options.Gain = None,
    threshold: options.Threshold = None,
    kernel: options.Kernel = None,
    dark_counts: options.DarkCounts = None,
    efficiency: options.Efficiency = None,
    mask: options.Mask = None,
    max_intensity: options.MaxIntensity = None,
    seed: options.Seed = 0,
    gray: options.Gray = False,
    white: options.White = None,
    threads: options.Threads = None,
) -> None:
    """Draw the bits that a quanta image sensor would report of a photograph."""
    sensor = Sensor(
        **options.sensor_parameters(
            oversampling=oversampling,
            frames=frames,
            gain=gain,
            threshold=threshold,
            kernel=kernel,
            dark_counts=dark_counts,
            efficiency=efficiency,
            mask=mask,
            max_intensity=max_intensity,
        )
    )
    image = as_image(read_picture(photo, white=white, gray=gray))
    height, width = (size * sensor.oversampling for size in image.shape[:2])
    shape = (sensor.frames, height, math.ceil(width / 8), *image.shape[2:])
    with (
        created_bits(output, shape, width, sensor) as packed,
        progress(1) as begin,
    ):
        bits = sensor.expose(
            image, seed, out=packed, threads=threads, progress=begin("drawing bits")
        )
    out.print(f"{output}: {bits!r}", soft_wrap=True, markup=False)
