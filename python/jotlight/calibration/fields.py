"""The data of a calibration."""

from __future__ import annotations

import dataclasses

from jotlight.array_types import Counts, Image, Mask
from jotlight.calibration.bulk import Bulk
from jotlight.calibration.steadiness import Steadiness
from jotlight.sensing.parameters.mosaic import Mosaic
from jotlight.sensing.parameters.provenance import Provenance


@dataclasses.dataclass(frozen=True, eq=False)
class CalibrationFields:
    """The fields of :class:`jotlight.Calibration`, which describes them and adds its methods."""

    dark_counts: Image
    mask: Mask
    hot: Mask
    dead: Mask
    threshold: int
    false_positive_rate: float
    max_dark: float
    bulk: Bulk
    hot_threshold: int
    hot_probability: float
    dark_ones: Counts
    dark_frames: int
    efficiency: Image | None = None
    scale: float = 1.0
    flat_ones: Counts | None = None
    flat_frames: int | None = None
    prnu: float | None = None
    prnu_error: float | None = None
    flat_noise: float | None = None
    dark_steadiness: Steadiness | None = None
    flat_steadiness: Steadiness | None = None
    mosaic: Mosaic | None = None
    provenance: dict[str, Provenance] = dataclasses.field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of jots."""
        height, width = self.dark_counts.shape
        return height, width

    def insufficient_frames_reason(self) -> str | None:
        """Return why the dark capture has too few frames to find hot jots at the rate, or None."""
        if self.hot_threshold <= self.dark_frames:
            return None
        number = self.dark_frames
        probability = self.bulk.tail_probability(number)
        return f"{number} of {number} bits are ones by chance in {probability:.2g} of ordinary jots"
