"""``jotlight convert``: a capture in another format."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.cli.capture_options import CaptureOptions
from jotlight.cli.captured import provenance_notes, refuse_capture_overwrite
from jotlight.cli.common_options import CapturePath
from jotlight.cli.console import progress, report
from jotlight.formats.description import companion_files
from jotlight.formats.registry import WRITERS
from jotlight.formats.writing import choose_output_format, write_capture
from jotlight.sensing.bits import Bits
from jotlight.sensing.frames import Frames


def convert(
    data: CapturePath,
    /,
    *,
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
) -> None:
    """Convert a capture that matches its checksums to another format, in constant memory.

    Bits stay bits in formats that hold bits. Other formats receive the counts, the sum of the bits.
    """
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
            if isinstance(opened.images, Frames):
                opened.images.verify()
            counts = opened.sum(update)
            write_capture(counts, output, name, trials=opened.total_trials, provenance=provenance)
            size = " x ".join(map(str, counts.shape))
            written = f"<counts: {size}, {counts.min()} to {counts.max()}>"
    report(f"{output}: {name}, {written}", *provenance_notes(provenance))
