"""Options that several commands share."""

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import typer

from jotlight.formats.arrays import read_npy
from jotlight.formats.image_files import read_mask
from jotlight.sensing.maps import MAPS
from jotlight.sensing.sensor import KERNELS


def _sensor_option(help_: str, *names: str) -> Any:
    return typer.Option(*names, help=help_, rich_help_panel="Sensor")


SENSOR_OPTIONS: dict[str, Any] = {
    "oversampling": Annotated[
        int | None,
        _sensor_option("K̂: each pixel covers K̂ x K̂ jots.", "--oversampling", "-k"),
    ],
    "frames": Annotated[int | None, _sensor_option("T: binary frames.", "--frames", "-t")],
    "gain": Annotated[
        float | None,
        _sensor_option(
            "α: photons on a pixel of intensity 1, over all jots and frames. Default: K, the "
            "number of bits per pixel."
        ),
    ],
    "threshold": Annotated[
        int | None,
        _sensor_option("q: photons that make a jot report 1.", "--threshold", "-q"),
    ],
    "kernel": Annotated[
        str | None, _sensor_option(f"How a pixel's light is spread: {', '.join(KERNELS)}.")
    ],
    "dark_counts": Annotated[
        str | None,
        _sensor_option(
            "d: detections per jot and frame without light; a number, or a .npy map of the jots."
        ),
    ],
    "efficiency": Annotated[
        str | None,
        _sensor_option(
            "η: the share of photons that are detected; a number, or a .npy map of the jots."
        ),
    ],
    "mask": Annotated[
        Path | None,
        _sensor_option(
            "A .npy of bool over the jots, True for a dead one; or a PNG, black for the good ones."
        ),
    ],
    "max_intensity": Annotated[
        float | None, _sensor_option("S: the largest intensity that an estimate may have.")
    ],
}
"""An option for each parameter of a sensor."""


def takes_sensor(**defaults: object) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command all the options of a sensor; its parameter `given` gets those that were set.

    `given` becomes a dict of parameters, with maps read from their files, `defaults` included, and
    `inputs` the list of these files; a command with a parameter `words` gets the same options as
    words for another command line, by parameter.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(command, eval_str=True).parameters
        added = {
            name: inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=defaults.get(name),
                annotation=annotation,
            )
            for name, annotation in SENSOR_OPTIONS.items()
        }

        @functools.wraps(command)
        def run(**options: Any) -> None:
            given = {name: options.pop(name) for name in added}
            if "words" in own:
                options["words"] = {
                    name: [f"--{name.replace('_', '-')}", str(value)]
                    for name, value in given.items()
                    if value is not None
                }
            files = [Path(given[name]) for name in MAPS if given[name]]
            command(**options, given=_read_maps(given), inputs=files)

        parameters = [
            parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
            for parameter in own.values()
            if parameter.name not in ("given", "inputs", "words")
        ]
        parameters += added.values()
        # What typer reads.
        vars(run)["__signature__"] = inspect.Signature(parameters)
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    return decorate


def _read_maps(options: dict[str, Any]) -> dict[str, Any]:
    given = {name: value for name, value in options.items() if value is not None}
    for name in ("dark_counts", "efficiency"):
        if name in given:
            given[name] = _number_or_map(given[name])
    if "mask" in given:
        given["mask"] = read_mask(Path(given["mask"]))
    return given


def _number_or_map(text: str) -> float | npt.NDArray[Any]:
    try:
        return float(text)
    except ValueError:
        return np.array(read_npy(text))


Seed = Annotated[int, typer.Option(help="Seed of the random bits.")]
Gray = Annotated[bool, typer.Option("--gray", help="Turn a colour photograph into grey.")]
White = Annotated[
    float | None,
    typer.Option(
        help="Level of the photograph that stands for intensity 1; needed for integers whose "
        "scale is unknown."
    ),
]
Key = Annotated[str | None, typer.Option(help="Name of the array in a .npz.")]
Threads = Annotated[int | None, typer.Option(help="Threads to use. Default: all.")]
