"""Options that name the output files of an image or a film, and the writing of an image."""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from jotlight.cli.options.common_options import FILM_PANEL, OUTPUT_PANEL
from jotlight.errors import percent_advice
from jotlight.estimators.brightness import UNITS, unit_scale
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.records.records import image_facts, tone_facts
from jotlight.images.clipping import Clipping
from jotlight.images.image_stack import stack_writer
from jotlight.images.io import DISPLAYED, FLOATS, image_writer
from jotlight.images.tone import CURVES, Tone, check_curve, display_tone
from jotlight.images.video import DEFAULT_FPS, check_kind, is_floats
from jotlight.parameter_names import check_choice
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor

_DEFAULT_CURVE = "gamma"

_SHOWN = ".png"
"""Ending of a file that shows the uncertainty."""


def describe_tone(tone: Tone) -> str:
    """Return the curve and the white of an image for display."""
    return f"{tone.curve} curve, white at {tone.white:.3g}"


@Parameter(name="*", group=OUTPUT_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """The file to write, and its contents."""

    output: Annotated[
        Path,
        Parameter(
            alias="-o",
            help="A .png or .jpg for display; a .tif, .exr, or .npy for floats that are never "
            "clipped.",
        ),
    ]
    units: Annotated[
        str,
        Parameter(
            help="Units of floats: intensity; photons, which a pixel of median response detects "
            "per frame; or photons-per-second, which need --exposure-time."
        ),
    ] = "intensity"
    curve: Annotated[
        str | None,
        Parameter(
            help=f"Tone curve of an image for display: {', '.join(CURVES)}. Default: "
            f"{_DEFAULT_CURVE} for a preview or a film, and linear for an output in .png or .jpg."
        ),
    ] = None
    white: Annotated[
        float | None,
        Parameter(
            help="Intensity that is white in an image for display. Default of an output in .png or "
            ".jpg: the largest intensity, if the capture or --max-intensity states it; otherwise "
            "1, or about the 99.5th percentile if the image would be dark or clipped. Default of "
            "other images for display: the 99.5th percentile."
        ),
    ] = None
    depth: Annotated[int, Parameter(help="Bits per value of a .png: 8 or 16.")] = 8

    def check(self) -> None:
        """Raise ValueError for options that do not belong together."""
        check_choice("units", self.units, UNITS)
        if self.curve is not None:
            check_curve(self.curve)
        if self.white is not None and not 0 < self.white < np.inf:
            raise ValueError(f"white: expected a finite intensity above 0, got {self.white}")

    def scale(self, sensor: Sensor) -> np.float32:
        """Return the factor from intensity to the units."""
        return np.float32(unit_scale(sensor, self.units))

    def fit_tone(self, estimates: npt.NDArray[np.float32]) -> Tone:
        """Return the tone curve for estimates that are displayed."""
        return Tone.fit(estimates, self.curve or _DEFAULT_CURVE, white=self.white)

    def metadata(
        self, sensor: Sensor, method: str, provenance: Provenance | None
    ) -> dict[str, Any]:
        """Return the facts that a file of floats states about itself."""
        largest = sensor.max_intensity * float(self.scale(sensor))
        units = UNITS[self.units]
        return image_facts(sensor, method, provenance, units=units, largest_value=largest)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImageOutputOptions(OutputOptions):
    """The files of one image, and their contents."""

    preview: Annotated[
        Path | None,
        Parameter(
            help="A .png or .jpg for display, in addition to the output. White is at the 99.5th "
            "percentile, or that of --white. Default: none."
        ),
    ] = None
    uncertainty: Annotated[
        Path | None,
        Parameter(
            help="A .npz, .npy, or .tif with the standard error, confidence interval, and flags of "
            "each pixel, or a .png that shows them. Default: none."
        ),
    ] = None
    level: Annotated[
        float | None,
        Parameter(help="Coverage of the confidence interval of --uncertainty. Default: 0.95."),
    ] = None

    def check(self) -> None:
        """Raise ValueError for options that do not belong together."""
        super().check()
        displayed = self.output.suffix.lower() in DISPLAYED
        floats = self.output.suffix.lower() in FLOATS
        if self.curve is not None and self.preview is None and floats:
            raise ValueError(
                f"curve: is for a .png or .jpg, not for the floats of {self.output}; --preview "
                "writes an image for display in addition"
            )
        if self.white is not None and self.preview is None and floats:
            raise ValueError(f"white: is for a .png or .jpg, not for the floats of {self.output}")
        if self.preview is not None and self.preview.suffix.lower() not in DISPLAYED:
            raise ValueError(
                f"preview: expected a name that ends in .png or .jpg, got {self.preview}"
            )
        if self.units != "intensity" and displayed:
            raise ValueError(
                f"units: are for floats, and {self.output} is for display; write a .tif, .exr or "
                ".npy, and add --preview for an image for display"
            )
        if self.uncertainty is not None:
            if self.uncertainty.suffix.lower() != _SHOWN:
                stack_writer(self.uncertainty)
            if not 0.5 <= self.coverage < 1:
                advice = percent_advice(self.coverage, 0.5)
                raise ValueError(f"level: expected a number in [0.5, 1), got {self.level}{advice}")
        elif self.level is not None:
            raise ValueError("level: is for the confidence interval; add --uncertainty u.npz")

    @property
    def coverage(self) -> float:
        """Coverage of the confidence interval."""
        return 0.95 if self.level is None else self.level

    def paths(self) -> list[Path]:
        """Return all files to write."""
        paths = (self.output, self.preview, self.uncertainty)
        return [path for path in paths if path is not None]

    def write(
        self,
        files: list[Path],
        estimate: npt.NDArray[np.float32],
        known: Uncertainty | None,
        scale: np.float32,
        *,
        white: float | None,
        metadata: dict[str, Any],
    ) -> list[Tone]:
        """Write the temporary files, in the order of :meth:`paths`.

        `known` is the uncertainty of the estimate, if it is written, `scale` is the factor from
        intensity to the units, and `white` is the largest intensity, if it is stated. Return the
        tone curve of each image for display.
        """
        remaining = list(files)
        tones = []
        if self.output.suffix.lower() in DISPLAYED:
            tones.append(display_tone(estimate, self.curve, self.stated_white(white)))
            note = metadata | tone_facts(tones[0])
            write = image_writer(self.output, depth=self.depth, note=note)
            write(remaining.pop(0), tones[0](estimate))
        else:
            image_writer(self.output, note=metadata)(remaining.pop(0), estimate * scale)
        if self.preview is not None:
            tones.append(self.fit_tone(estimate))
            note = metadata | tone_facts(tones[-1])
            image_writer(self.preview, note=note)(remaining.pop(0), tones[-1](estimate))
        if self.uncertainty is not None and known is not None:
            if self.uncertainty.suffix.lower() == _SHOWN:
                description = {"Description": json.dumps(metadata)}
                known.plot().savefig(remaining.pop(0), format="png", metadata=description)
            else:
                flags = "1 unlit, 2 saturated, 4 dead, 8 unlikely"
                facts = {**metadata, "level": self.coverage, "flags": flags}
                stack_writer(self.uncertainty, facts)(remaining.pop(0), known.arrays())
        return tones

    def stated_white(self, largest: float | None) -> float | None:
        """Return the white of an output in .png or .jpg, or None if the image decides it.

        `largest` is the largest intensity, if it is stated.
        """
        return largest if self.white is None and self.curve is None else self.white


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmOptions(OutputOptions):
    """Windows of frames, one for each image of a film, and the file to write."""

    output: Annotated[
        Path,
        Parameter(
            alias="-o",
            help="A .mp4, a .gif, or a name without ending for a new folder of .png, for display; "
            "a .npy or .tif for a stack of floats that are never clipped.",
        ),
    ]
    window: Annotated[
        int,
        Parameter(
            group=FILM_PANEL,
            help="Number of frames of each image of the film. For a stack of counts, the number of "
            "its images, whatever their frames.",
        ),
    ]
    step: Annotated[
        int | None,
        Parameter(
            group=FILM_PANEL,
            help="Frames, or images of a stack of counts, from one window to the next. Default: "
            "the size of a window.",
        ),
    ] = None
    fps: Annotated[
        float, Parameter(group=FILM_PANEL, help="Images per second of a .mp4 or .gif, from 0.01.")
    ] = DEFAULT_FPS

    def fit_film_tone(
        self, samples: Sequence[npt.NDArray[np.float32]]
    ) -> tuple[Tone, Clipping | None]:
        """Return the tone curve for all images, and what counts the brighter pixels.

        The white is a percentile of some images, the samples. A white that the user has chosen may
        clip any image.
        """
        tone = self.fit_tone(np.stack(samples))
        return tone, Clipping(tone.white, is_percentile=True) if self.white is None else None

    def check(self) -> None:
        """Raise ValueError or OSError for options that do not suit a film."""
        super().check()
        floats = is_floats(self.output)
        if self.units != "intensity" and not floats:
            raise ValueError(
                f"units: are for floats, .npy or .tif, and {self.output} is for display"
            )
        if self.curve is not None and floats:
            raise ValueError(f"curve: is for display, not for the floats of {self.output}")
        if self.white is not None and floats:
            raise ValueError(f"white: is for display, not for the floats of {self.output}")
        check_kind(self.output, self.fps, self.depth)
        if self.output.suffix == "" and self.output.exists():
            raise FileExistsError(
                f"cannot write {self.output}: it exists already; choose another name"
            )
