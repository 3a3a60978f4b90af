"""What `jotlight reconstruct` writes beside and instead of a single picture."""

import contextlib
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import typer

from jotlight import __version__
from jotlight.estimators.brightness import detected_photons
from jotlight.estimators.uncertainty import uncertainty
from jotlight.files import atomic_write
from jotlight.images.image_stack import stack_writer
from jotlight.images.io import DISPLAYED, FLOATS, image_writer
from jotlight.images.tone import CURVES, Tone, check_curve
from jotlight.sensing.bits import Bits
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor

UNITS = {"intensity": "intensity", "photons": "detected photons per pixel and frame"}
"""The units that floats may have, and what a file says of them."""

_DEFAULT_CURVE = "gamma"


def _option(help_: str, *names: str, panel: str = "Output") -> Any:
    return typer.Option(*names, help=help_, rich_help_panel=panel)


Units = Annotated[
    str,
    _option(
        "Of a .tif, .exr or .npy: intensity, or photons (per frame, as a pixel of median response "
        "detects them)."
    ),
]
Preview = Annotated[
    Path | None, _option("A .png or .jpg to look at beside the picture, white at a percentile.")
]
Curve = Annotated[
    str | None,
    _option(
        f"Tone curve of what is to look at: {', '.join(CURVES)}. Default: {_DEFAULT_CURVE} for a "
        "preview or a film; a .png or .jpg as the picture itself is linear, white at the largest "
        "intensity."
    ),
]
UncertaintyFile = Annotated[
    Path | None,
    _option(
        "Standard error, confidence interval and flags of each pixel, for the method mle: a .npz, "
        ".npy or .tif.",
        "--uncertainty",
    ),
]
Level = Annotated[float, _option("Coverage of the confidence interval.")]
Window = Annotated[
    int | None,
    _option(
        "Frames of each picture of a film; the output is a new folder of .png, a .mp4 or a .npy.",
        panel="Video",
    ),
]
Step = Annotated[
    int | None,
    _option("Frames from one window to the next. Default: as many as a window.", panel="Video"),
]
Fps = Annotated[float, _option("Pictures per second of a .mp4.", panel="Video")]


@dataclasses.dataclass(frozen=True)
class OutputOptions:
    """Which files are wanted and what is to stand in them."""

    picture: Path
    preview: Path | None = None
    uncertainty: Path | None = None
    units: str = "intensity"
    curve: str | None = None
    level: float = 0.95
    depth: int = 8

    def __post_init__(self) -> None:
        if self.units not in UNITS:
            raise ValueError(f"units: expected one of {', '.join(UNITS)}, got {self.units!r}")
        if self.curve is not None:
            check_curve(self.curve)
        if (
            self.curve is not None
            and self.preview is None
            and self.picture.suffix.lower() in FLOATS
        ):
            raise ValueError(
                f"curve: is for a .png or .jpg, not for the floats of {self.picture}; --preview "
                "asks for one beside it"
            )
        names = [path.resolve() for path in self.paths()]
        if len(set(names)) < len(names):
            raise ValueError("expected another name for each file to be written, got one twice")
        if self.preview is not None and self.preview.suffix.lower() not in DISPLAYED:
            raise ValueError(f"preview: expected a name in .png or .jpg, got {self.preview}")
        if self.units != "intensity" and self.picture.suffix.lower() in DISPLAYED:
            raise ValueError(
                f"units: are for numbers, and {self.picture} is to look at; write a .tif, .exr or "
                ".npy, with --preview for a picture beside it"
            )
        if self.uncertainty is not None:
            stack_writer(self.uncertainty)
            if not 0.5 <= self.level < 1:
                raise ValueError(f"level: expected 0.5 to below 1, got {self.level}")

    def paths(self) -> list[Path]:
        """All files to be written."""
        return [p for p in (self.picture, self.preview, self.uncertainty) if p is not None]

    def scale(self, sensor: Sensor) -> np.float32:
        """What an intensity is to be multiplied by for the units."""
        return np.float32(detected_photons(sensor) if self.units == "photons" else 1)

    @contextlib.contextmanager
    def files(self) -> Iterator[list[Path]]:
        """Make the temporary files, so that a place that cannot be written to is found early."""
        with contextlib.ExitStack() as stack:
            yield [stack.enter_context(atomic_write(path)) for path in self.paths()]

    def write(
        self,
        files: list[Path],
        picture: npt.NDArray[np.float32],
        seen: Bits | npt.NDArray[np.int32],
        sensor: Sensor,
        *,
        white: float,
        note: dict[str, Any],
        threads: int | None,
    ) -> None:
        """Fill the files in the order of :meth:`paths`."""
        rest = list(files)
        displayed = self.picture.suffix.lower() in DISPLAYED
        if displayed and self.curve is not None:
            write = image_writer(self.picture, depth=self.depth)
            write(rest.pop(0), Tone.fit(picture, self.curve)(picture))
        else:
            write = image_writer(self.picture, depth=self.depth, white=white, note=note)
            write(rest.pop(0), picture * self.scale(sensor))
        if self.preview is not None:
            tone = Tone.fit(picture, self.curve or _DEFAULT_CURVE)
            image_writer(self.preview)(rest.pop(0), tone(picture))
        if self.uncertainty is not None:
            known = uncertainty(seen, sensor, confidence_level=self.level, threads=threads)
            facts = {**note, "level": self.level, "flags": "1 unlit, 2 saturated, 4 dead"}
            planes = known.arrays(float(self.scale(sensor)))
            stack_writer(self.uncertainty, facts)(rest.pop(0), planes)

    def note(self, sensor: Sensor, method: str, provenance: Provenance | None) -> dict[str, Any]:
        """What a file says of itself."""
        return {
            "software": f"jotlight {__version__}",
            "units": UNITS[self.units],
            "largest_value": sensor.max_intensity * float(self.scale(sensor)),
            "method": method,
            "sensor": {**sensor.scalars(), **dict.fromkeys(sensor.maps(), "a map")},
            "provenance": None if provenance is None else provenance.to_json(),
        }

    def film_tone(self, pictures: list[npt.NDArray[np.float32]]) -> Tone:
        """One curve for all pictures of a film, from some of them, so that nothing flickers."""
        return Tone.fit(np.stack(pictures), self.curve or _DEFAULT_CURVE)
