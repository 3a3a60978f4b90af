"""``jotlight calibrate``: the calibration of a sensor from a dark and a flat capture."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.calibration import Calibration
from jotlight.calibration import calibrate as estimate_calibration
from jotlight.calibration.calibrate import MAX_DARK
from jotlight.cli.captures.captured import check_outputs_of, check_trials, provenance_notes
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.common_options import CAPTURE_PANEL, Threads, convert_file
from jotlight.cli.options.sensor_values import read_mosaic
from jotlight.cli.terminal.console import progress, report
from jotlight.files import atomic_write
from jotlight.formats.capture import Capture, CountStack
from jotlight.sensing.bits.bits import Bits


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """Parameters of :func:`jotlight.calibrate`."""

    frames: Annotated[
        int | None,
        Parameter(alias="-t", help="Number of frames summed in counts. Default: that of the file."),
    ] = None
    flat_frames: Annotated[
        int | None,
        Parameter(help="Number of frames summed in flat counts. Default: --frames."),
    ] = None
    threshold: Annotated[
        int | None,
        Parameter(
            alias="-q",
            help="q: number of photons that make a jot report 1. Default: that of the file, or 1.",
        ),
    ] = None
    false_positive_rate: Annotated[
        float,
        Parameter(
            help="Maximum fraction of ordinary jots that are called hot, and that are called dead."
        ),
    ] = 1e-4
    max_dark: Annotated[
        float,
        Parameter(
            help="Dark counts per frame above which a hot jot is masked. Below that, its bits are "
            "used with its dark counts."
        ),
    ] = MAX_DARK
    mosaic: Annotated[
        str | None,
        Parameter(
            converter=convert_file,
            help="Color filters of the jots in the flat capture, such as RGGB, or a .json. "
            "Default: that of the file, or gray.",
        ),
    ] = None


def calibrate(
    dark: Annotated[Path, Parameter(help="A capture without light, of bits or counts.")],
    flat: Annotated[
        Path | None,
        Parameter(
            help="A capture of uniform light, with the exposure time of the dark one. "
            "Default: none."
        ),
    ] = None,
    /,
    *,
    output: Annotated[Path, Parameter(alias="-o", help="The calibration, .safetensors.")],
    options: CalibrationOptions = CalibrationOptions(),
    plot: Annotated[
        Path | None, Parameter(help="A page of plots: .png, .pdf, or .svg. Default: none.")
    ] = None,
    capture: CaptureOptions = CaptureOptions(),
    flat_key: Annotated[
        str | None,
        Parameter(
            group=CAPTURE_PANEL, help="Name of the array of the flat capture. Default: --key."
        ),
    ] = None,
    threads: Threads = None,
) -> None:
    """Find the dark counts, the hot and dead jots, and the response of each jot.

    The options of a capture hold for both captures. `jotlight reconstruct --calibration` reads the
    file.
    """
    _check_outputs([path for path in (dark, flat) if path is not None], output, plot)
    captures = [_open(capture, dark)]
    flat_frames = None
    if flat is not None:
        flat_options = dataclasses.replace(capture, key=flat_key or capture.key)
        captures.append(_open(flat_options, flat))
    _refuse_frames_of_bits(captures, options)
    dark_frames = _stated_frames(captures[0], dark, "--frames", options.frames)
    if flat is not None:
        flat_frames = _flat_frames(captures, flat, options)
    with atomic_write(output) as temporary, progress(1) as begin:
        frames = dark_frames, flat_frames
        calibration = _estimate(captures, options, frames, begin("calibrating"), threads)
        calibration.save(temporary)
        if plot is not None:
            _draw(calibration, plot)
    for opened in captures:
        report(*provenance_notes(opened.provenance))
    from jotlight.calibration.figure import facts

    report(*(f"{name}: {value}" for name, value in facts(calibration)))
    report(f"{output}: for jotlight reconstruct --calibration")


def _open(options: CaptureOptions, path: Path) -> Capture:
    """Return the bits or the counts of a capture.

    Raises
    ------
    ValueError
        When it has readings of several bits, whose sum is no count of ones.
    """
    opened = options.open(path)
    if isinstance(opened, CountStack) and opened.sensor is not None:
        raise ValueError(
            f"{path}: expected bits, or counts of ones, because a calibration is for single bits, "
            f"but the capture has readings of {opened.sensor.bit_depth} bits; `jotlight "
            "reconstruct` takes measured --dark-counts, --efficiency, and --mask for them"
        )
    if isinstance(opened, CountStack):
        return dataclasses.replace(opened, provenance=opened.sum_provenance)
    return opened


def _estimate(
    captures: list[Capture],
    options: CalibrationOptions,
    frames: tuple[int | None, int | None],
    update: Callable[[float], None],
    threads: int | None,
) -> Calibration:
    """Return the calibration from a dark capture, and from a flat one if there is one.

    `frames` are the numbers of frames that their counts are out of.
    """
    dark, *flat = (each.sum() if isinstance(each, CountStack) else each for each in captures)
    return estimate_calibration(
        dark,
        flat[0] if flat else None,
        frames=frames[0],
        flat_frames=frames[1],
        threshold=options.threshold,
        false_positive_rate=options.false_positive_rate,
        max_dark=options.max_dark,
        mosaic=None if options.mosaic is None else read_mosaic(options.mosaic),
        threads=threads,
        progress=update,
        provenance={
            name: each.provenance
            for name, each in zip(("dark", "flat"), captures, strict=False)
            if each.provenance is not None
        },
    )


def _check_outputs(captures: list[Path], output: Path, plot: Path | None) -> None:
    """Raise ValueError for outputs that cannot be written."""
    if output.suffix.lower() != ".safetensors":
        raise ValueError(f"{output}: expected a name that ends in .safetensors")
    check_outputs_of(captures, [output, plot])
    if plot is not None:
        import jotlight.plots as plots

        plots.check_figure(plot)


def _draw(calibration: Calibration, plot: Path) -> None:
    from jotlight.plots import save_figure

    save_figure(calibration.plot(), plot)


def _refuse_frames_of_bits(captures: list[Capture], options: CalibrationOptions) -> None:
    if options.frames is not None and all(isinstance(each, Bits) for each in captures):
        raise ValueError(
            "frames: is for counts. These captures hold bits, which state their frames; "
            "--frame-range selects some of them"
        )


def _flat_frames(captures: list[Capture], path: Path, options: CalibrationOptions) -> int | None:
    """Return the number of frames that are summed in flat counts, or None for bits."""
    dark, flat = captures
    if isinstance(flat, Bits):
        # --frames belongs to dark counts. The library refuses any number beside bits.
        return options.flat_frames
    if options.flat_frames is not None:
        return _stated_frames(flat, path, "--flat-frames", options.flat_frames)
    if isinstance(dark, Bits):
        return _stated_frames(flat, path, "--frames", options.frames)
    return _stated_frames(flat, path, "--flat-frames", None) or options.frames


def _stated_frames(capture: Capture, path: Path, option: str, frames: int | None) -> int | None:
    """Return the number of frames that are summed in counts: the file's, or that of an option.

    Bits need no such number, so it is None.
    """
    if isinstance(capture, Bits):
        return None
    if frames is not None:
        check_trials(path, capture.total_trials, frames, f"{option} {frames}")
        return frames
    return capture.total_trials
