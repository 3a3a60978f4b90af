"""The calibration that ``jotlight reconstruct`` applies, and its record beside the output."""

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any, Self

import numpy as np

from jotlight._engine import __version__
from jotlight.calibration import Calibration
from jotlight.calibration.jot_mosaics import has_filters_of_jots
from jotlight.evaluation.records.records import FORMAT
from jotlight.output_links import follow_link, name_beside
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor

_MAX_JSON_BYTES = 1 << 20
_RECORDED = (
    "provenance",
    "false_positive_rate",
    "max_dark",
    "hot_threshold",
    "hot_probability",
    "prnu",
    "scale",
)
"""Numbers of a calibration that the record repeats."""


@dataclasses.dataclass(frozen=True)
class AppliedCalibration:
    """A calibration with its file and the path of its record."""

    calibration: Calibration
    name: str
    sha256: str
    record: Path

    @classmethod
    def read(cls, path: Path, output: Path) -> Self:
        """Return the calibration of a file, to be recorded beside an output.

        Raises
        ------
        ValueError
            When the file is damaged, or the record would replace a file that is not a record.
        """
        calibration = Calibration.load(path)
        record = record_path(output)
        check_record(record)
        return cls(calibration, path.name, hashlib.sha256(path.read_bytes()).hexdigest(), record)

    def notes(self, sensor: Sensor, provenance: Provenance | None) -> list[str]:
        """Return what was applied, one line each. Maps from options replace the calibration's."""
        found = self.calibration
        used = self._used(sensor)
        applied = []
        if used["dark_counts"]:
            applied.append(f"dark counts (median {np.median(found.dark_counts):.3g} per frame)")
        if used["mask"]:
            applied.append(f"{found.mask.sum()} masked jots")
        if used["efficiency"]:
            applied.append(f"response (PRNU {found.prnu:.2%})")
        if used["mosaic"]:
            applied.append(f"color filters {sensor.mosaic!r}")
        lines = [f"calibration {self.name}: {', '.join(applied) or 'nothing'}"]
        if applied and (unsure := found.unconfirmed_reason(provenance)) is not None:
            lines.append(
                f"calibration {self.name}: {unsure}; the jots are assumed to be in the same places"
            )
        if found.mosaic is not None and sensor.mosaic is not None and not used["mosaic"]:
            side = sensor.oversampling
            lines.append(
                f"calibration {self.name}: its jots have color filters {found.mosaic!r}, and the "
                f"sensor has {sensor.mosaic!r} on pixels of {side} x {side} jots, which are used"
            )
        return lines

    def _used(self, sensor: Sensor) -> dict[str, bool]:
        found = self.calibration
        return {
            "dark_counts": np.array_equal(sensor.dark_counts, found.dark_counts),
            "efficiency": found.efficiency is not None
            and np.array_equal(sensor.efficiency, found.efficiency),
            "mask": sensor.mask is not None and np.array_equal(sensor.mask, found.mask),
            "mosaic": found.mosaic is not None
            and has_filters_of_jots(sensor, found.mosaic, found.shape),
        }

    def description(
        self, sensor: Sensor, method: str, data: str, provenance: Provenance | None
    ) -> dict[str, Any]:
        """Return the contents of the record."""
        return {
            "format": FORMAT,
            "version": 1,
            "jotlight": __version__,
            "data": data,
            "provenance": None if provenance is None else provenance.to_json(),
            "method": method,
            "sensor": sensor.scalars(),
            "calibration": {
                "file": self.name,
                "sha256": self.sha256,
                "applied": self._used(sensor),
                "masked_jots": int(sensor.mask.sum()) if sensor.mask is not None else 0,
                **{
                    name: value
                    for name, value in self.calibration.metadata().items()
                    if name in _RECORDED
                },
            },
        }


def record_path(output: Path) -> Path:
    """Return the path of the record beside an output, which may be a folder of images.

    Beside a folder `NAME`, `NAME.json` may be the description of a capture `NAME.npy`.

    Examples
    --------
    >>> record_path(Path("images/a.npy")).name, record_path(Path("images/a")).name
    ('a.npy.json', 'a.film.json')
    """
    return name_beside(output, ".json" if follow_link(output).suffix else ".film.json")


def check_record(path: Path) -> None:
    """Raise ValueError when a record would replace a file that is not a record."""
    if path.exists() and not _is_record(path):
        raise ValueError(
            f"{path}: the record of the result belongs here, but this file is not such a record; "
            "choose another name for the output"
        )


def _is_record(path: Path) -> bool:
    """Return whether a file is a record that jotlight wrote beside a result."""
    try:
        if path.stat().st_size > _MAX_JSON_BYTES:
            return False
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(record, dict) and record.get("format") == FORMAT
