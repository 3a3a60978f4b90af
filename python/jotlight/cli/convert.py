"""``jotlight convert``: a capture in another format."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.cli.capture_options import CaptureOptions
from jotlight.cli.captured import provenance_notes, refuse_capture_overwrite
from jotlight.cli.console import progress, report
from jotlight.cli.run_options import CapturePaths, RunOptions
from jotlight.formats.description import companion_files
from jotlight.formats.registry import WRITERS
from jotlight.formats.writing import choose_output_format, write_capture
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames


def convert(
    *data: CapturePaths,
    output: Annotated[
        Path,
        Parameter(alias="-o", help="A file or, for formats of many files, a new folder."),
    ],
    to: Annotated[
        str | None,
        Parameter(
            help=f"Format to write: {', '.join(WRITERS)}. Default: the one that the output's name "
            "implies."
        ),
    ] = None,
    capture: CaptureOptions = CaptureOptions(),
    run: RunOptions = RunOptions(),
) -> None:
    """Convert a capture that matches its checksums to another format, in constant memory.

    Bits stay bits in formats that hold bits. Other formats receive the counts, the sum of the bits.
    With --window, each capture becomes a .zarr of counts, one image for each window. Several
    captures need a name such as -o copies/{name}.npy.
    """
    if not data:
        raise ValueError("expected a capture: a file, a folder, a URL, or a glob")
    if run.is_requested(data):
        _convert_many(data, output, to, capture, run)
        return
    _convert_one(Path(data[0]), output, to, capture)


def _convert_many(
    data: tuple[str, ...],
    output: Path,
    to: str | None,
    capture: CaptureOptions,
    run: RunOptions,
) -> None:
    """Convert many captures, or one to counts of its windows."""
    from jotlight.cli.many import Target, conversion_job, process
    from jotlight.dask.jobs import CaptureSource, Job

    def make_job(target: Target, bits: Bits, source: CaptureSource) -> Job:
        return conversion_job(target, bits, source, run, to)

    process(data, output, capture, run, None, make_job)


def _convert_one(data: Path, output: Path, to: str | None, capture: CaptureOptions) -> None:
    """Convert one capture, and report it."""
    name = choose_output_format(output, to)
    outputs = {output}
    if name in ("npy", "npy.gz"):
        outputs |= companion_files(output)
    for file in outputs:
        refuse_capture_overwrite(file, data)
    opened = capture.open(data)
    provenance = opened.provenance
    with progress(1) as begin:
        update = begin("converting")
        if isinstance(opened, Bits):
            write_capture(opened, output, name, update)
            written = f"{opened!r}" if WRITERS[name].bits else f"counts of {opened!r}"
        else:
            if opened.sensor is not None:
                write_capture(opened.readings(), output, name)
                report(f"{output}: {name}, {opened.readings()!r}", *provenance_notes(provenance))
                return
            if isinstance(opened.images, Frames):
                opened.images.verify()
            counts = opened.sum(update)
            write_capture(counts, output, name, trials=opened.total_trials, provenance=provenance)
            size = " x ".join(map(str, counts.shape))
            written = f"<counts: {size}, {counts.min()} to {counts.max()}>"
    report(f"{output}: {name}, {written}", *provenance_notes(provenance))
