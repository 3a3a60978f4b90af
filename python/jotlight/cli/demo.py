"""``jotlight demo``: simulation and reconstruction of a photograph that ships with scikit-image."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.cli.compare import run_comparison
from jotlight.cli.reports.simulated_origin import simulated_origin
from jotlight.cli.terminal.console import report
from jotlight.datasets import PHOTOGRAPHS, photograph
from jotlight.evaluation.methods import METHODS
from jotlight.evaluation.run_methods import select_methods
from jotlight.sensing.sensor import Sensor


def demo(
    *,
    output: Annotated[Path, Parameter(alias="-o", help="The figure.")] = Path("jotlight-demo.png"),
    photo: Annotated[
        str, Parameter(help=f"A photograph of scikit-image: {', '.join(PHOTOGRAPHS)}.")
    ] = "camera",
) -> None:
    """Simulate the bits of a photograph, and reconstruct it by all methods that need no extra.

    The figure shows the photograph, the bits, and all estimates.
    """
    image = photograph(photo)
    sensor = Sensor(oversampling=4)
    height, width = image.shape[:2]
    jots = sensor.trials * image.size
    report(
        f"A sensor of {jots / 1e6:.1f} million one-bit pixels exposes the photograph '{photo}' of "
        f"{height} x {width} pixels: {sensor.trials} bits for each value of the image.\n"
    )
    # Methods with an extra package take too long for a demonstration. `jotlight compare` has them.
    names = [name for name in select_methods(sensor) if METHODS[name].required_package is None]
    note = simulated_origin(f"{photo} of scikit-image", [], sensor, names, None, {"seed": 0})
    run_comparison(image, sensor, output, {METHODS[name].title: name for name in names}, note)
