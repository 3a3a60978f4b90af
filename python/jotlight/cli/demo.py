"""`jotlight demo`: the whole way on a photograph that is already there."""

from pathlib import Path
from typing import Annotated

import typer

from jotlight.cli.compare import run_comparison
from jotlight.cli.console import out
from jotlight.datasets import PHOTOGRAPHS, photograph
from jotlight.evaluation.compare import select_methods
from jotlight.evaluation.methods import METHODS
from jotlight.sensing.sensor import Sensor


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="The figure.")] = Path(
        "jotlight-demo.png"
    ),
    photo: Annotated[
        str, typer.Option(help=f"A photograph of scikit-image: {', '.join(PHOTOGRAPHS)}.")
    ] = "camera",
) -> None:
    """Turn a photograph into single-photon bits and back, by all methods without extra packages."""
    image = photograph(photo)
    sensor = Sensor(oversampling=4)
    height, width = image.shape[:2]
    jots = sensor.bits_per_pixel * image.size
    out.print(
        f"The photograph '{photo}' of {height} x {width} pixels, seen by a sensor of "
        f"{jots / 1e6:.1f} million one-bit pixels: {sensor.bits_per_pixel} bits for each value of "
        "the picture.\n"
    )
    # Those with a package of their own take longer than a demonstration should; `compare` has them.
    names = [name for name in select_methods(sensor) if METHODS[name].required_package is None]
    run_comparison(image, sensor, output, names, seed=0)
