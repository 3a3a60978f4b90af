"""`jotlight calibrate`: a dark and a flat capture into the calibration of a sensor."""

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from jotlight.calibration import calibrate as calibrated
from jotlight.calibration.estimate import MAX_DARK
from jotlight.cli import capture_options, sensor_options
from jotlight.cli.console import out, progress
from jotlight.files import atomic_write, refuse_overwrite
from jotlight.formats.capture import Capture, CountStack
from jotlight.sensing.bits import Bits


def calibrate(
    dark: Annotated[Path, typer.Argument(help="A capture without light, of bits or counts.")],
    flat: Annotated[
        Path | None,
        typer.Argument(help="A capture of even light, with the exposure time of the dark one."),
    ] = None,
    *,
    output: Annotated[Path, typer.Option("--output", "-o", help="The calibration, .safetensors.")],
    frames: Annotated[
        int | None, typer.Option("--frames", "-t", help="Out of how many frames counts are.")
    ] = None,
    flat_frames: Annotated[
        int | None, typer.Option(help="The same of the flat capture. Default: --frames.")
    ] = None,
    threshold: Annotated[
        int, typer.Option("--threshold", "-q", help="q: photons that make a jot report 1.")
    ] = 1,
    false_positive_rate: Annotated[
        float,
        typer.Option(help="Share of ordinary jots, at most, that are called hot; dead likewise."),
    ] = 1e-4,
    max_dark: Annotated[
        float,
        typer.Option(
            help="Dark counts per frame above which a hot jot is masked; below, its bits are used "
            "and its dark counts known."
        ),
    ] = MAX_DARK,
    plot: Annotated[Path | None, typer.Option(help="A page of plots: .png, .pdf or .svg.")] = None,
    key: capture_options.Key = None,
    flat_key: Annotated[
        str | None,
        typer.Option(
            help="Name of the array of the flat capture. Default: --key.",
            rich_help_panel="Capture",
        ),
    ] = None,
    counts: capture_options.Counts = None,
    unpacked: capture_options.Unpacked = None,
    width: capture_options.Width = None,
    format_: capture_options.Format = None,
    frame_range: capture_options.FrameRange = None,
    rotate: capture_options.Rotate = 0,
    flip: capture_options.Flip = None,
    threads: sensor_options.Threads = None,
) -> None:
    """Find dark counts, hot and dead jots, and the response of each jot.

    The options of a capture hold for both of them. `jotlight reconstruct --calibration` takes the
    file.
    """
    if output.suffix.lower() != ".safetensors":
        raise ValueError(f"{output}: expected a name that ends in .safetensors")
    inputs = [path for path in (dark, flat) if path is not None]
    for file in (output, plot):
        for path in inputs:
            if file is not None:
                capture_options.refuse_capture_overwrite(file, path)
    if plot is not None:
        from jotlight import plots

        plots.check_figure(plot)
        refuse_overwrite(plot, [output])
    reading = capture_options.CaptureOptions(
        dark, format_, width, frame_range, rotate, flip, key, counts, unpacked
    )
    captures = [reading.open()]
    if flat is not None:
        captures.append(dataclasses.replace(reading, path=flat, key=flat_key or key).open())
    if frames is not None and all(isinstance(capture, Bits) for capture in captures):
        raise ValueError(
            "frames: is for counts; these are bits, which tell how many there are, and "
            "--frame-range takes some of them"
        )
    told = [_frames_of(captures[0], dark, "--frames", frames, None)]
    if flat is not None and flat_frames is None and isinstance(captures[0], Bits):
        told.append(_frames_of(captures[1], flat, "--frames", frames, None))
    elif flat is not None:
        told.append(_frames_of(captures[1], flat, "--flat-frames", flat_frames, frames))
    with atomic_write(output) as temporary, progress(1) as begin:
        update = begin("calibrating")
        data = [
            capture.sum() if isinstance(capture, CountStack) else capture for capture in captures
        ]
        found = calibrated(
            data[0],
            data[1] if flat is not None else None,
            frames=told[0],
            flat_frames=told[-1] if flat is not None else None,
            threshold=threshold,
            false_positive_rate=false_positive_rate,
            max_dark=max_dark,
            threads=threads,
            progress=update,
            provenance={
                name: capture.provenance
                for name, capture in zip(("dark", "flat"), captures, strict=False)
                if capture.provenance is not None
            },
        )
        found.save(temporary)
        if plot is not None:
            from jotlight.calibration.figure import page

            with atomic_write(plot) as temporary_plot:
                page(found).savefig(temporary_plot, dpi=110)
    for capture in captures:
        for line in capture_options.describe_provenance(capture.provenance):
            out.print(line, soft_wrap=True, markup=False)
    from jotlight.calibration.figure import facts

    for name, value in facts(found):
        out.print(f"{name}: {value}", soft_wrap=True, markup=False)
    out.print(f"{output}: for jotlight reconstruct --calibration", soft_wrap=True, markup=False)


def _frames_of(
    capture: Capture, path: Path, option: str, given: int | None, otherwise: int | None
) -> int | None:
    """Out of how many frames counts are: what the file tells, and an option may only repeat."""
    if isinstance(capture, Bits):
        # Those of --frames are for the other capture.
        return given if option == "--flat-frames" else None
    if given is not None:
        capture_options.check_told(path, capture.total_trials, given, option)
        return given
    return capture.total_trials or otherwise
