"""The report of a film: what was found about its images, as lines of text."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.cli.options.output_options import FilmOptions, describe_tone
from jotlight.cli.reconstruction.inputs import Reconstruction
from jotlight.cli.terminal.console import shape_text
from jotlight.estimators.brightness import BRIGHTNESS_QUANTILE, UNITS
from jotlight.estimators.demosaicing import TITLES
from jotlight.formats.capture import Capture
from jotlight.images.clipping import Clipping
from jotlight.images.tone import Tone
from jotlight.motion.films.image import FilmImage
from jotlight.sensing.bits.bits import Bits


@dataclasses.dataclass
class FilmSummary:
    """What was found about all images of a film."""

    has_memory: bool
    """Whether images also count bits from before their windows."""
    tone: Tone | None = None
    """The tone curve of a film for display."""
    clipping: Clipping | None = None
    """What counts pixels that are brighter than its white, unless the user has chosen this."""
    seconds: float = 0.0
    """Computing time."""
    images: int = 0
    """Number of all images."""
    shape: tuple[int, ...] = ()
    """Shape of each image."""
    minimum: float = np.inf
    """Smallest intensity."""
    maximum: float = 0.0
    """Largest intensity."""
    brightness: float = 0.0
    """Largest brightness of an image without its brightest 0.1 %."""
    found: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    """The settings that the method found for each image."""
    models: list[str] = dataclasses.field(default_factory=list)
    """Models of the motions that were estimated anew."""
    accepted: list[float] = dataclasses.field(default_factory=list)
    """Fraction of the bits that agree, of each image that was merged."""

    def add(self, image: npt.NDArray[np.float32]) -> None:
        """Add the estimate of an image."""
        self.images += 1
        self.shape = image.shape
        self.minimum = min(self.minimum, float(image.min()))
        self.maximum = max(self.maximum, float(image.max()))
        self.brightness = max(self.brightness, float(np.quantile(image, BRIGHTNESS_QUANTILE)))
        if self.clipping is not None:
            self.clipping.count(image)

    def add_motion(self, image: FilmImage) -> None:
        """Add the motion of an image."""
        if not image.is_carried:
            self.models.append(image.motion.model)
        if image.data is image.merged and image.merged.acceptance is not None:
            self.accepted.append(float(image.merged.acceptance.mean()))

    @property
    def uses_memory(self) -> bool:
        """Whether an image was merged that may count bits from before its window."""
        return self.has_memory and bool(self.accepted)

    def motion_lines(self, demosaicing: str | None) -> list[str]:
        """Return what was found about the motion, or nothing without motion.

        `demosaicing` is the requested one, if any.
        """
        if not self.models:
            return []
        number, models = len(self.models), ", ".join(sorted(set(self.models)))
        line = f"motion: {models}; estimated anew for {number} image{'s' * (number > 1)}"
        if (others := self.images - number) > 0:
            line += f", and carried to {others} other{'s' * (others > 1)}"
        if self.accepted:
            line += (
                f"; {np.mean(self.accepted):.1%} of the bits agree and are used, and "
                f"{min(self.accepted):.1%} or more of each image"
            )
        if demosaicing in TITLES and self.accepted:
            number = len(self.accepted)
            return [
                line,
                f"demosaicing: not used for {number} merged image{'s' * (number > 1)}, because "
                "along the motion each pixel is seen through all filters",
            ]
        return [line]


def film_lines(
    job: Reconstruction, outputs: FilmOptions, spans: Sequence[slice], summary: FilmSummary
) -> list[str]:
    """Return the lines of the report of a film that was written."""
    scale, data, tone = outputs.scale(job.captured.sensor), job.captured.data, summary.tone
    each = job.captured.sensor.frames // outputs.window
    unused = len(data) - spans[-1].stop
    lie = "lies" if unused == 1 else "lie"
    others = " and from those before that agree" if summary.uses_memory else ""
    display = UNITS[outputs.units] if tone is None else describe_tone(tone)
    line = (
        f"{outputs.output}: {len(spans)} image{'s' * (len(spans) > 1)} of "
        f"{shape_text(summary.shape)} from {_amount(data, outputs.window, each)} each{others}, "
        f"values {scale * summary.minimum:.3g} to {scale * summary.maximum:.3g} ({display}), by "
        f"{job.title} in {summary.seconds:.3g} s"
    )
    if unused:
        line += f"; {_amount(data, unused, each)} at the end {lie} in no window"
    return [line, *summary.motion_lines(job.request.demosaicing)]


def _amount(data: Capture, number: int, each: int) -> str:
    """Return a number of frames, or of images of counts of `each` frames, as a text."""
    text = f"{number * each} frame{'s' * (number * each > 1)}"
    images = f"{number} image{'s' * (number > 1)} of counts"
    # Frames of readings of several bits have no trials.
    are_counts = not isinstance(data, Bits) and data.trials is not None
    return f"{images} ({text})" if are_counts else text
