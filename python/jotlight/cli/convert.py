"""`jotlight convert`: a capture from one format into another."""

from pathlib import Path
from typing import Annotated

import typer

from jotlight.cli import capture_options
from jotlight.cli.console import out, progress
from jotlight.formats.description import companion_files
from jotlight.formats.registry import WRITERS
from jotlight.formats.writing import choose_output_format, write_capture
from jotlight.sensing.bits import Bits


def convert(
    data: Annotated[Path, typer.Argument(help="A capture: a file, or a folder of files.")],
    *,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="A file or, for formats of many files, a new folder."),
    ],
    to: Annotated[
        str | None,
        typer.Option(
            help=f"Format to write: {', '.join(WRITERS)}. Default: what the output's name tells."
        ),
    ] = None,
    format_: capture_options.Format = None,
    frame_range: capture_options.FrameRange = None,
    rotate: capture_options.Rotate = 0,
    flip: capture_options.Flip = None,
    width: capture_options.Width = None,
    key: capture_options.Key = None,
    counts: capture_options.Counts = None,
    unpacked: capture_options.Unpacked = None,
) -> None:
    """Convert a capture from one format into another, in constant memory.

    Bits stay bits where the format holds them, and else are summed to counts.
    """
    name = choose_output_format(output, to)
    made = {output}
    if name in ("npy", "npy.gz"):
        made |= companion_files(output)
    for file in made:
        capture_options.refuse_capture_overwrite(file, data)
    reading = capture_options.CaptureOptions(
        data, format_, width, frame_range, rotate, flip, key, counts, unpacked
    )
    capture = reading.open()
    provenance = capture.provenance
    with progress(1) as begin:
        update = begin("converting")
        if isinstance(capture, Bits):
            write_capture(capture, output, name, update)
            what = f"{capture!r}"
            if not WRITERS[name].bits:
                what = f"counts of {capture!r}"
        else:
            image = capture.sum(update)
            write_capture(image, output, name, trials=capture.total_trials, provenance=provenance)
            size = " x ".join(map(str, image.shape))
            what = f"<counts: {size}, {image.min()} to {image.max()}>"
    out.print(f"{output}: {name}, {what}", soft_wrap=True, markup=False)
    for line in capture_options.describe_provenance(provenance):
        out.print(line, soft_wrap=True, markup=False)
