"""What a run makes of each capture: a video, an image, or a copy in another format.

A job consists of units, which processes on several machines compute in any order. Each unit writes
its results itself, and can be repeated.
"""

import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from jotlight._engine import __version__
from jotlight.errors import error_message
from jotlight.evaluation.records.records import FORMAT, tone_facts
from jotlight.files import atomic_write_together, write_file
from jotlight.formats.files.checksums import file_checksum
from jotlight.formats.frames.checked_reading import with_checksum
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.npy.description import companion_files
from jotlight.formats.opening.opening import read_capture
from jotlight.formats.verification import verify_capture
from jotlight.formats.writing import write_capture
from jotlight.images.io import DISPLAYED, image_writer
from jotlight.images.tone import display_tone
from jotlight.output_links import follow_link, name_beside
from jotlight.runs.capture_source import CaptureSource
from jotlight.runs.estimator import Estimator
from jotlight.runs.records import Record, read_json
from jotlight.runs.results import RecordedResult, measure
from jotlight.runs.spans import Spans
from jotlight.runs.store import VideoStore
from jotlight.runs.streaming import WindowCounter
from jotlight.sensing.bits.bits import Bits


class Job(Protocol):
    """All work on one capture."""

    @property
    def name(self) -> str:
        """The capture, for messages."""

    @property
    def output(self) -> Path:
        """The result."""

    @property
    def nbytes(self) -> int:
        """Maximum number of bytes of the result that are missing."""

    @property
    def is_single(self) -> bool:
        """Whether one unit makes the whole result."""

    def is_complete(self) -> bool:
        """Return whether the result exists, as a whole.

        Raise ValueError if it is that of another run, or a part of it is missing.
        """

    def prepare(self) -> list[int]:
        """Create what the units write to, and return the numbers of the units to compute."""

    def compute(self, unit: int, threads: int | None, mapped: bool) -> None:
        """Compute a unit and write its results."""

    def finish(self) -> None:
        """Complete the result after all units, or raise an error if it is not there."""


@dataclasses.dataclass(frozen=True)
class VideoJob:
    """An estimate, or the counts, of each window of a capture, as images of a zarr array."""

    name: str
    capture: CaptureSource
    spans: Spans
    oversampling: int
    estimator: Estimator | None
    """Method, or None for counts."""
    store: VideoStore

    @property
    def output(self) -> Path:
        """The zarr folder."""
        return self.store.path

    @property
    def nbytes(self) -> int:
        """Number of bytes of the images that are missing."""
        return self.store.missing_nbytes

    @property
    def is_single(self) -> bool:
        """False: several parts may make images."""
        return False

    def is_complete(self) -> bool:
        """Return whether the zarr folder exists."""
        return self.store.is_complete()

    def prepare(self) -> list[int]:
        """Create the array, and return the groups of images that are missing."""
        self.store.create()
        return self.store.missing()

    def compute(self, unit: int, threads: int | None, mapped: bool) -> None:
        """Count or estimate a group of images, and write them. One image is in memory at a time."""
        images, low, high = self.store.images_of(unit), np.inf, -np.inf
        estimator = self.estimator and self.estimator.with_threads(threads)
        counter = WindowCounter(
            self.capture.open(), self.spans, self.oversampling, threads, mapped=mapped
        )
        windows = counter.windows(images.start, images.stop)
        for index, counts in zip(images, windows, strict=True):
            image = counts
            if estimator is not None:
                image = estimator(counts[None], warns=index == images.start)[0]
            self.store.write_image(index, image)
            low, high = min(low, float(image.min())), max(high, float(image.max()))
        facts = {"crc32": f"{counter.checksum.value:08x}", "bytes": counter.checksum.size}
        self.store.mark(unit, {**facts, "minimum": low, "maximum": high})

    def finish(self) -> None:
        """Complete the array: it receives its record and its name."""
        self.store.finish()


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImageJob(RecordedResult):
    """One estimate of a whole capture, as an image with a record beside it."""

    name: str
    capture: CaptureSource
    frames: int
    oversampling: int
    estimator: Estimator
    output: Path
    run: Record
    """What the image is made of, and how."""
    nbytes: int
    depth: int = 8
    curve: str | None = None
    """Tone curve of a .png or .jpg. None for the linear one."""
    white: float | None = None
    """White of a .png or .jpg. None if the image decides it."""

    @property
    def record(self) -> Path:
        """The record beside the image."""
        return name_beside(self.output, ".json")

    def compute(self, unit: int, threads: int | None, mapped: bool) -> None:
        """Count the frames, estimate the image, and write it with its record."""
        self.refuse_complete()
        spans = Spans(self.frames, self.frames, 1)
        counter = WindowCounter(
            self.capture.open(), spans, self.oversampling, threads, mapped=mapped
        )
        counts = next(counter.windows(0, 1))
        estimator = self.estimator.with_threads(threads)
        (image,), found = estimator.run(counts[None], warns=True)
        record: Record = {
            "run": self.run,
            "input": {
                "packed_bytes": counter.checksum.size,
                "packed_crc32": f"{counter.checksum.value:08x}",
            },
            "found": found,
            "minimum": float(image.min()),
            "maximum": float(image.max()),
        }
        if self.output.suffix.lower() in DISPLAYED:
            tone = display_tone(image, self.curve, self.white, self.name)
            record |= tone_facts(tone)
            image = tone(image)
        write = image_writer(self.output, depth=self.depth, note={"jotlight": record})
        with atomic_write_together([self.output], [self.record]) as (file, text):
            write(file, image)
            facts = {"sha256": file_checksum(file), "output": measure(file)}
            content = {"format": FORMAT, **record, **facts}
            write_file(text, json.dumps(content, indent=1))
            self.refuse_complete()


@dataclasses.dataclass(frozen=True)
class ConversionJob(RecordedResult):
    """A capture in another format, with a record beside it."""

    name: str
    capture: CaptureSource
    output: Path
    format: str
    run: Record
    nbytes: int

    @property
    def record(self) -> Path:
        """The record beside the copy."""
        return conversion_record(self.output)

    @property
    def beside(self) -> Iterable[Path]:
        """The maps of a .npy. Its description is left out, because users may change it."""
        if self.format not in ("npy", "npy.gz"):
            return ()
        files = companion_files(follow_link(self.output))
        return (path for path in files if path.suffix != ".json")

    def compute(self, unit: int, threads: int | None, mapped: bool) -> None:
        """Convert the capture, which must match its checksums, and write the record."""
        self.refuse_complete()
        self._begin_record()
        bits, checksum = with_checksum(self.capture.open())
        assert isinstance(bits, Bits), "bits"
        try:
            write_capture(bits, self.output, self.format)
        except OSError:
            # A process with the same run has written the folder. If it has not completed the
            # record, it may have been killed, and the folder may be damaged since.
            if not self.output.is_dir():
                raise
            self.refuse_complete()
            self._check_copy(*checksum())
        text = conversion_text(self.run, *checksum(), output=measure(self.output, self.beside))
        self.refuse_complete()
        write_file(self.record, text, output=self.output)

    def _check_copy(self, size: int, checksum: int) -> None:
        """Raise ValueError unless a copy that exists is intact, and has the frames of the capture.

        `size` and `checksum` are those of the frames of the capture.
        """
        try:
            verify_capture(self.output, format=self.format)
            copy = read_capture(self.output, ReadingOptions(format=self.format))
            if with_checksum(copy)[1]() != (size, checksum):
                raise ValueError("its frames differ from those of the capture")
        except (OSError, ValueError) as error:
            raise ValueError(
                f"{self.output}: expected a copy that matches the capture, because its record "
                f"states no size; got: {error_message(error)}; delete it to make it again"
            ) from error

    def _begin_record(self) -> None:
        """Write the run into the record, before the copy and its size are known.

        So a copy whose process was killed before it completed the record is that of this run. The
        record of a copy that was deleted states an old size, so it is replaced.
        """
        is_begun = self.output.exists() and self.record.exists()
        if not is_begun or read_json(self.record).get("run") != self.run:
            write_file(self.record, json.dumps({"run": self.run}, indent=1), output=self.output)


def conversion_record(output: Path) -> Path:
    """Return the path of the record beside a copy in another format."""
    return name_beside(output, ".run.json")


def conversion_text(
    run: Record, size: int, checksum: int, content: str = "packed", **facts: Any
) -> str:
    """Return the record of a complete copy, with the size and the CRC-32 of the frames.

    `content` is "packed" for packed bits, or "counts".
    """
    read = {f"{content}_bytes": size, f"{content}_crc32": f"{checksum:08x}"}
    return json.dumps({"run": run, "input": read, **facts}, indent=1)


def run_record(
    name: str,
    bits: Bits,
    capture: CaptureSource,
    **facts: Any,
) -> Record:
    """Return what a result is made of, and how, as values of JSON.

    Parameters
    ----------
    name : str
        Name of the capture.
    bits : Bits
    capture : CaptureSource
    **facts
        Further facts.
    """
    return {
        "jotlight": __version__,
        "capture": name,
        "file": bits.provenance.name if bits.provenance else None,
        "bytes": capture.state[0],
        "modified": capture.state[1],
        "format": bits.provenance.format if bits.provenance else None,
        "provenance": bits.provenance.to_json() if bits.provenance else None,
        "read": capture.describe(),
        "bits": list(bits.shape),
        **facts,
    }
