"""``jotlight convert``: a capture in another format."""

import dataclasses
from pathlib import Path, PurePath
from typing import Annotated, Any

from cyclopts import Parameter

from jotlight._engine import __version__
from jotlight.cli.captures.captured import check_outputs_of, provenance_notes
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.run_options import CapturePaths, RunOptions, name_output
from jotlight.cli.terminal.console import progress, report, shape_text
from jotlight.files import atomic_write, write_file
from jotlight.formats.capture import Capture, CountStack
from jotlight.formats.frames.checked_reading import with_checksum
from jotlight.formats.npy.description import companion_files
from jotlight.formats.opening.locations import file_state, is_url
from jotlight.formats.registry import WRITERS
from jotlight.formats.writing import choose_output_format, write_capture
from jotlight.output_links import follow_link
from jotlight.runs.jobs import conversion_record, conversion_text
from jotlight.runs.records import read_json
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.frames import Frames


def convert(
    *data: CapturePaths,
    output: Annotated[
        Path,
        Parameter(alias="-o", help="A file or, for formats of many files, a new folder."),
    ],
    to: Annotated[
        str | None,
        Parameter(
            help=f"Format to write: {', '.join(WRITERS)}. Default: the one that the ending of the "
            "output implies."
        ),
    ] = None,
    add_up: Annotated[
        bool,
        Parameter(
            name="--sum",
            help="Write the sum of several images of counts. Default: they are refused.",
        ),
    ] = False,
    capture: CaptureOptions = CaptureOptions(),
    run: RunOptions = RunOptions(),
) -> None:
    """Convert a capture to another format, in constant memory.

    The command refuses a capture that does not match its checksums. Formats for bits receive the
    bits, and all others receive the counts, the sum of the bits. With --window, each capture
    becomes a .zarr of counts, one image for each window. Several captures need a name such as
    -o copies/{name}.npy.
    """
    if not data:
        raise ValueError("expected a capture: a file, a folder, a URL, or a glob")
    if run.is_requested(data):
        if add_up:
            raise ValueError("sum: is for one stack of images of counts; name one capture")
        _convert_many(data, output, to, capture, run)
        return
    path = data[0] if is_url(data[0]) else Path(data[0])
    _convert_one(path, name_output(output, data[0]), to, capture, add_up=add_up)


def _convert_many(
    data: tuple[str, ...],
    output: Path,
    to: str | None,
    capture: CaptureOptions,
    run: RunOptions,
) -> None:
    """Convert many captures, or one to counts of its windows."""
    from jotlight.cli.runs.capture_jobs import Target, conversion_job
    from jotlight.cli.runs.many import process
    from jotlight.runs.capture_source import CaptureSource
    from jotlight.runs.jobs import Job

    def make_job(target: Target, bits: Bits, source: CaptureSource) -> tuple[Job, list[str]]:
        return conversion_job(target, bits, source, run, to)

    def check_name(output: Path) -> None:
        choose_output_format(output, to)

    process(data, output, capture, run, None, check_name, make_job)


def _convert_one(
    data: Path | str, output: Path, to: str | None, capture: CaptureOptions, *, add_up: bool
) -> None:
    """Convert one capture, and report it."""
    name = choose_output_format(output, to)
    outputs = {output}
    if name in ("npy", "npy.gz"):
        outputs |= companion_files(follow_link(output))
    check_outputs_of([data] if isinstance(data, Path) else [], outputs)
    opened, checksum = with_checksum(_summable(capture.open(data), data, add_up=add_up))
    record = conversion_record(output)
    if record.exists() and "run" not in read_json(record):
        raise ValueError(f"{record}: the record of the copy belongs here; choose another name")
    run = _run(data, opened, name)
    content = "packed" if isinstance(opened, Bits) else "counts"
    with atomic_write(record, output=output) as temporary:
        # If there is no space for the record, nothing is written. It does not become longer.
        write_file(temporary, conversion_text(run, _bytes_of(opened), 0, content))
        written = _write(opened, output, name)
        write_file(temporary, conversion_text(run, *checksum(), content))
    report(f"{output}: {name}, {written}", *provenance_notes(opened.provenance))


def _summable(opened: Capture, data: Path | str, *, add_up: bool) -> Capture:
    """Return a capture, whose images of counts may be added up, or raise ValueError."""
    is_stack = isinstance(opened, CountStack) and opened.sensor is None and len(opened) > 1
    if add_up and not is_stack:
        raise ValueError(f"sum: {data} is no stack of images of counts; leave it out")
    if not isinstance(opened, CountStack) or not is_stack:
        return opened
    if not add_up:
        raise ValueError(
            f"{data}: holds {len(opened)} images of counts, and no format to write has place for "
            "more than one; --sum writes their sum, --frame-range selects one, and `jotlight film` "
            "and `jotlight reconstruct --motion` read the stack itself"
        )
    return dataclasses.replace(opened, provenance=opened.sum_provenance)


def _write(opened: Capture, output: Path, name: str) -> str:
    """Write a copy in the format `name`, and return what was written."""
    with progress(1) as begin:
        update = begin("converting")
        if isinstance(opened, Bits):
            write_capture(opened, output, name, update)
            return f"{opened!r}" if WRITERS[name].bits else f"counts of {opened!r}"
        if opened.sensor is not None:
            write_capture(opened.readings(), output, name)
            return f"{opened.readings()!r}"
        if isinstance(opened.images, Frames):
            opened.images.verify()
        counts = opened.sum(update)
        trials, provenance = opened.total_trials, opened.provenance
        write_capture(counts, output, name, trials=trials, provenance=provenance)
        size = shape_text(counts.shape)
        return f"<counts: {size}, {counts.min()} to {counts.max()}>"


def _bytes_of(opened: Capture) -> int:
    return opened.packed.nbytes if isinstance(opened, Bits) else opened.images.nbytes


def _run(data: Path | str, opened: Capture, name: str) -> dict[str, Any]:
    """Return what a copy in the format `name` is made of."""
    provenance = opened.provenance
    shape = opened.shape if isinstance(opened, Bits) else opened.images.shape
    size, modified = file_state(str(data))
    return {
        "jotlight": __version__,
        "capture": PurePath(data).name,
        "bytes": size,
        "modified": modified,
        "format": provenance.format if provenance else None,
        "provenance": provenance.to_json() if provenance else None,
        "bits" if isinstance(opened, Bits) else "counts": list(shape),
        "to": name,
    }
