"""A calibration as `jotlight reconstruct` applies it, and the record of that beside the picture."""

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

import numpy as np

from jotlight._engine import __version__
from jotlight.calibration import Calibration
from jotlight.files import atomic_write
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor

_FORMAT = "jotlight picture"
_MOST_JSON = 1 << 20
_RECORDED = (
    "provenance", "false_positive_rate", "max_dark", "hot_threshold", "hot_probability", "prnu", "scale",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class AppliedCalibration:
    """A calibration, the file it is from, and where it is recorded."""

    calibration: Calibration
    name: str
    sha256: str
    record: Path

    @classmethod
    def read(cls, path: Path, output: Path) -> Self:
        """Read a calibration for a picture.

        Raises
        ------
        ValueError
            When it is damaged, or something of others stands where the record goes.
        """
        calibration = Calibration.load(path)
        record = output.with_name(f"{output.name}.json")
        if record.exists() and not _ours(record):
            raise ValueError(
                f"{record}: what was applied would be recorded here, but the file is not of "
                "jotlight and is not overwritten; give the picture another name"
            )
        return cls(calibration, path.name, hashlib.sha256(path.read_bytes()).hexdigest(), record)

    def told(self, sensor: Sensor, provenance: Provenance | None) -> list[str]:
        """What was applied, one line each; maps that options gave take the calibration's place."""
        found = self.calibration
        used = self._used(sensor)
        applied = []
        if used["dark_counts"]:
            applied.append(f"dark counts (median {np.median(found.dark_counts):.3g} per frame)")
        if used["mask"]:
            applied.append(f"{found.mask.sum()} masked jots")
        if used["efficiency"]:
            applied.append(f"response (PRNU {found.prnu:.2%})")
        lines = [f"calibration {self.name}: {', '.join(applied) or 'nothing of it'}"]
        if applied and (unsure := found.unconfirmed_reason(provenance)) is not None:
            lines.append(f"calibration {self.name}: {unsure}; jots are taken to lie alike")
        return lines

    def _used(self, sensor: Sensor) -> dict[str, bool]:
        found = self.calibration
        return {
            "dark_counts": np.array_equal(sensor.dark_counts, found.dark_counts),
            "efficiency": found.efficiency is not None
            and np.array_equal(sensor.efficiency, found.efficiency),
            "mask": sensor.mask is not None and np.array_equal(sensor.mask, found.mask),
        }

    def description(
        self, sensor: Sensor, method: str, data: str, provenance: Provenance | None
    ) -> dict[str, Any]:
        """What goes into the record."""
        return {
            "format": _FORMAT,
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


@contextlib.contextmanager
def recorded(known: AppliedCalibration | None) -> Iterator[Callable[..., None]]:
    """Give a function that writes the record; it appears when the block ends, or not at all."""
    if known is None:
        yield lambda *_: None
        return
    with atomic_write(known.record) as temporary:

        def record(sensor: Sensor, method: str, data: str, provenance: Provenance | None) -> None:
            description = known.description(sensor, method, data, provenance)
            temporary.write_text(json.dumps(description, indent=2) + "\n", encoding="utf-8")

        yield record


def _ours(path: Path) -> bool:
    try:
        if path.stat().st_size > _MOST_JSON:
            return False
        told = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(told, dict) and told.get("format") == _FORMAT
