"""Records of the origin of results: notes in files that have a place for them, or files beside."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jotlight._engine import __version__
from jotlight.cli.captures.applied_calibration import (
    AppliedCalibration,
    check_record,
    record_path,
)
from jotlight.cli.reconstruction.inputs import Reconstruction
from jotlight.evaluation.records.records import FORMAT, maps_sha256
from jotlight.evaluation.records.weights import weight_files, weights_sha256
from jotlight.files import write_file
from jotlight.formats.files.checksums import file_checksum
from jotlight.formats.opening.locations import file_state
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.sensor import Sensor

_NO_PLACE = (".npy", ".npz")
"""Endings of files that have no place for a note."""


_SPARE_BYTES = 1 << 13
"""Space in bytes for what a record states only when its output is complete."""


class Records:
    """The records beside the outputs of a reconstruction.

    An output has one if its format has no place for a note, and the first output also if a
    calibration is applied.

    Parameters
    ----------
    outputs : sequence of paths
    calibration : AppliedCalibration or None
    every : bool
        Whether each output has one.

    Raises
    ------
    ValueError
        When a record would replace a file that is not a record.
    """

    def __init__(
        self,
        outputs: Sequence[Path],
        calibration: AppliedCalibration | None,
        *,
        every: bool = False,
    ) -> None:
        self._calibration = calibration
        self._places = [
            (index, record_path(output))
            for index, output in enumerate(outputs)
            if every
            or output.suffix.lower() in _NO_PLACE
            or (index == 0 and calibration is not None)
        ]
        for path in self.paths():
            check_record(path)

    def paths(self) -> list[Path]:
        """Return the paths of the records."""
        return [path for _, path in self._places]

    def reserve(
        self, files: Sequence[Path], job: Reconstruction, origin: Mapping[str, Any]
    ) -> None:
        """Fill temporary files, so that a full disk is found before an output is complete.

        :meth:`write` replaces their content by a shorter one. `origin` is what is known before.
        """
        for file, (index, _) in zip(files, self._places, strict=True):
            text = json.dumps(self._content(index, job, origin), indent=2)
            write_file(file, text + " " * _SPARE_BYTES)

    def write(
        self,
        files: Sequence[Path],
        outputs: Sequence[Path],
        job: Reconstruction,
        origin: Mapping[str, Any],
    ) -> None:
        """Write temporary files, in the order of :meth:`paths`.

        `outputs` are the files of the outputs, which are complete, and `origin` is what they were
        made of.
        """
        for file, (index, _) in zip(files, self._places, strict=True):
            content = self._content(index, job, origin)
            if outputs[index].is_file():
                content["sha256"] = file_checksum(outputs[index])
            write_file(file, json.dumps(content, indent=2) + "\n")

    def _content(
        self, index: int, job: Reconstruction, origin: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Return the content of the record of an output, without the checksum of the output."""
        content: dict[str, Any] = {"format": FORMAT, "version": 1, "jotlight": __version__}
        if index == 0 and self._calibration is not None:
            content = self._calibration.description(*job.record_arguments)
        return {**content, "origin": dict(origin)}


def origin_of(
    job: Reconstruction,
    sensors: Sequence[Sensor],
    checksum: tuple[int, int],
    motion: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Return what a result was made of, and how, in addition to its sensor and method.

    `sensors` are those of the data of the images, `checksum` is the size and the CRC-32 of the
    frames, and `motion` is how they were aligned.
    """
    choice, calibration = job.choice, job.calibration
    content = "packed" if isinstance(job.captured.data, Bits) else "counts"
    return {
        "capture": Path(job.path).name,
        "bytes": file_state(str(job.path))[0],
        f"{content}_bytes": checksum[0],
        f"{content}_crc32": f"{checksum[1]:08x}",
        "model": job.model and job.model.name,
        "weights_sha256": weights_sha256(
            weight_files(
                sensors,
                choice.method,
                choice.quality,
                model=job.model,
                is_conditional=job.request.fallback,
                is_color=choice.is_color,
            )
        ),
        "calibration_sha256": calibration and calibration.sha256,
        "maps_sha256": maps_sha256(job.captured.sensor),
        "hot_jots": job.captured.hot_jots,
        "options": job.request.settings(),
        "motion": motion,
    }
