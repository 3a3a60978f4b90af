"""Options and help panels that several commands share."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter, Token
from cyclopts import convert as convert_tokens

from jotlight.evaluation.methods import METHOD_NAMES
from jotlight.networks.architectures import QUALITIES
from jotlight.networks.precision import F32, PRECISIONS
from jotlight.paths import complete_path

METHOD_PANEL = Group("Iterative methods", sort_key=1)
TRAINING_PANEL = Group("Training", sort_key=2)
NETWORK_PANEL = Group("Network", sort_key=3)
SENSOR_PANEL = Group("Sensor", sort_key=4)
KNOWN_SENSOR_PANEL = Group(
    "Sensor",
    help="A capture or a network that states its sensor replaces these defaults.",
    sort_key=4,
)
CAPTURE_PANEL = Group("Capture", sort_key=5)
OUTPUT_PANEL = Group("Output", sort_key=6)
FILM_PANEL = Group("Film", sort_key=7)
MOTION_PANEL = Group("Motion", sort_key=8)


def convert_file(kind: Any, tokens: Sequence[Token]) -> Any:
    """Return the value of an option or an argument that is, or may be, the name of a file.

    Shells leave a ``~`` as it is in ``--output=~/a.npy`` and inside quotes, and ``.`` has no name.
    """
    completed = [token.evolve(value=complete_path(token.value)) for token in tokens]
    return convert_tokens(kind, completed)


CapturePath = Annotated[Path, Parameter(help="A capture of bits or counts: a file or a folder.")]
Photo = Annotated[Path, Parameter(help="A photograph: PNG, JPEG, TIFF, or .npy.")]
Seed = Annotated[int, Parameter(help="Seed of the random numbers.")]
Gray = Annotated[bool, Parameter(help="Convert a color photograph to gray.")]
White = Annotated[
    float | None,
    Parameter(
        help="Level of the photograph that stands for intensity 1. Default: the largest level of "
        "its format, and 1 for floats. Required for integers of an unknown scale."
    ),
]
ImageKey = Annotated[
    str | None, Parameter(help="Name of the array of images in a .npz. Default: its only array.")
]
Model = Annotated[
    Path | None, Parameter(help="A network of your own: a .safetensors file. Default: none.")
]
NAMES = ", ".join(METHOD_NAMES)
OWN = "MODULE:FUNCTION for a function of your own, such as mine:denoise in mine.py"
Quality = Annotated[
    str | None,
    Parameter(
        help=f"Size of the trained network to use in place of a method: {', '.join(QUALITIES)}. "
        "Default: that of --method."
    ),
]
Precision = Annotated[
    str | None,
    Parameter(
        help=f"Precision of the products of a deep network: {' or '.join(PRECISIONS)}. bf16 is "
        f"faster on processors with AMX, and emulated on others. Default: {F32}."
    ),
]
Threads = Annotated[int | None, Parameter(help="Number of threads. Default: all cores.")]
