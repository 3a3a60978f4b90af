"""Options that several commands share."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import typer

from jotlight.formats.npy import read_npy
from jotlight.sensor import KERNELS

_SENSOR = "Sensor"

Oversampling = Annotated[
    int | None,
    typer.Option(
        "--oversampling", "-k", help="K̂: each pixel covers K̂ x K̂ jots.", rich_help_panel=_SENSOR
    ),
]
Frames = Annotated[
    int | None,
    typer.Option("--frames", "-t", help="T: binary frames.", rich_help_panel=_SENSOR),
]
Gain = Annotated[
    float | None,
    typer.Option(
        help="α: photons on a pixel of intensity 1, over all jots and frames. Default: K, the "
        "number of bits per pixel.",
        rich_help_panel=_SENSOR,
    ),
]
Threshold = Annotated[
    int | None,
    typer.Option(
        "--threshold", "-q", help="q: photons that make a jot report 1.", rich_help_panel=_SENSOR
    ),
]
Kernel = Annotated[
    str | None,
    typer.Option(
        help=f"How a pixel's light is spread: {', '.join(KERNELS)}.", rich_help_panel=_SENSOR
    ),
]
DarkCounts = Annotated[
    str | None,
    typer.Option(
        help="d: detections per jot and frame without light; a number, or a .npy map of the jots.",
        rich_help_panel=_SENSOR,
    ),
]
Efficiency = Annotated[
    float | None,
    typer.Option(help="η: the share of photons that are detected.", rich_help_panel=_SENSOR),
]
Mask = Annotated[
    Path | None,
    typer.Option(
        help="A .npy of bool over the jots, True for a dead one.", rich_help_panel=_SENSOR
    ),
]
MaxIntensity = Annotated[
    float | None,
    typer.Option(
        help="S: the largest intensity that an estimate may have.", rich_help_panel=_SENSOR
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of the random bits.")]
Gray = Annotated[bool, typer.Option("--gray", help="Turn a colour photograph into grey.")]
White = Annotated[
    float | None,
    typer.Option(
        help="Level of the photograph that stands for intensity 1; needed for integers whose "
        "scale is unknown."
    ),
]
Threads = Annotated[int | None, typer.Option(help="Threads to use. Default: all.")]


def sensor_parameters(
    *,
    dark_counts: str | None,
    mask: Path | None,
    **numbers: float | str | None,
) -> dict[str, Any]:
    """Those parameters of a sensor that were given, the maps read from their files."""
    given: dict[str, Any] = {name: value for name, value in numbers.items() if value is not None}
    if dark_counts is not None:
        given["dark_counts"] = _number_or_map(dark_counts)
    if mask is not None:
        given["mask"] = np.array(read_npy(mask))
    return given


def _number_or_map(text: str) -> float | npt.NDArray[Any]:
    try:
        return float(text)
    except ValueError:
        return np.array(read_npy(text))
