"""Options that say how to open a capture."""

import dataclasses
import re
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from jotlight.cli.options.common_options import CAPTURE_PANEL
from jotlight.errors import warn
from jotlight.formats import FORMATS
from jotlight.formats.capture import Capture, CountStack
from jotlight.formats.frames.orientation import FLIPS
from jotlight.formats.frames.reading_options import ReadingOptions
from jotlight.formats.frames.scaled import unscale
from jotlight.formats.opening.opening import read_capture
from jotlight.sensing.bits.crop import parse_region
from jotlight.sensing.bits.frames import read_frames
from jotlight.sensing.data.scaled_counts import SCALES, scaled_counts_hint

_KEY = "Name of the array in a .npz, .mat, HDF5 file or zarr folder. Default: its only array."


@Parameter(name="*", group=CAPTURE_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class CaptureOptions:
    """Parameters of :class:`ReadingOptions`; None where an option is not set."""

    key: Annotated[str | None, Parameter(help=_KEY)] = None
    counts: Annotated[
        bool | None,
        Parameter(
            negative="--bits",
            help="Read numbers as counts or as bits. Default: in a .npy, bool and uint8 of three "
            "or four dimensions are bits. All other numbers are counts.",
        ),
    ] = None
    unpacked: Annotated[
        bool | None,
        Parameter(
            negative="--packed",
            help="Read one bit from each number, 0 and 1 or 0 and 255, or eight bits from each "
            "byte. Default: eight. Data that look like one bit per number are then refused.",
        ),
    ] = None
    width: Annotated[
        int | None,
        Parameter(help="Width in jots, for files that do not state it. Default: that of the file."),
    ] = None
    format: Annotated[
        str | None,
        Parameter(
            help=f"Format of the capture: {', '.join(FORMATS)}. Default: detected from the "
            "content, which is impossible for raw frames."
        ),
    ] = None
    layout: Annotated[
        str | None,
        Parameter(
            help="Layout of raw frames of other cameras: rows and columns, such as 256x512. Each "
            "byte holds eight bits, and the first jot is the most significant one. For other "
            "layouts, add bit_order=little, word=<u4, dtype=uint8, or numbers of bytes as "
            "row_bytes, file_header, frame_header, and frame_footer, such as "
            "256x512,bit_order=little,file_header=16. Quote < and >. Default: that of the --format."
        ),
    ] = None
    frame_range: Annotated[
        str | None,
        Parameter(
            help="Some of the frames, counted from 0. 100:200 is frames 100 to 199, and 0:200:2 "
            "is every second frame. Default: all."
        ),
    ] = None
    rotate: Annotated[
        int, Parameter(help="Counterclockwise rotation in degrees, a multiple of 90.")
    ] = 0
    flip: Annotated[
        str | None,
        Parameter(help=f"Mirror after the rotation: {' or '.join(FLIPS)}. Default: none."),
    ] = None
    region: Annotated[
        str | None,
        Parameter(
            help="Some of the rows and columns, counted from 0 after the rotation, in jots. "
            "10:40,16:48 is rows 10 to 39 and columns 16 to 47. Maps, calibrations, and mosaics of "
            "other options are those of the region. Default: all."
        ),
    ] = None

    isolate: Annotated[
        bool,
        Parameter(
            negative="--no-isolate",
            help="Read HDF5 and MATLAB 7.3 files in a child process, because damaged files can "
            "crash the HDF5 library. --no-isolate saves 0.2 s for files that you trust.",
        ),
    ] = True

    counts_scale: Annotated[
        float | None,
        Parameter(
            help="For images that hold means of frames: the value of a pixel that is 1 in all "
            "frames, such as 255, or 1 for floats. --trials states the number of frames. Default: "
            "the images hold whole counts."
        ),
    ] = None
    trials: Annotated[
        int | None,
        Parameter(
            help="With --counts-scale: number of frames of which each value is the mean. Default: "
            "--frames divided by the number of images, in commands that have --frames."
        ),
    ] = None

    def open(
        self, path: Path | str, total_trials: int | None = None, bit_depth: int | None = None
    ) -> Capture:
        """Return the bits or the counts of a capture. A stack of counts is not yet summed.

        Parameters
        ----------
        path : Path or str
            Capture, or its URL.
        total_trials : int, optional
            Number of trials of the whole capture, for scaled counts of an unstated number.
        bit_depth : int, optional
            The bits of a reading, if they are stated. Numbers are then readings.
        """
        options = self.to_options(bit_depth)
        capture = read_capture(path, options)
        if options.holds_readings:
            return capture
        if self.counts_scale is None:
            if isinstance(capture, CountStack) and total_trials is not None:
                _warn_about_means(capture, total_trials / len(capture))
            return capture
        trials = self.trials
        if trials is None and total_trials is not None:
            trials, rest = divmod(total_trials, len(capture))
            if rest:
                raise ValueError(
                    f"frames: expected a multiple of the {len(capture)} images of counts, because "
                    f"it states the frames of all of them together, got {total_trials}; state the "
                    "frames of each image by --trials"
                )
        return unscale(capture, self.counts_scale, trials)

    def to_options(self, bit_depth: int | None = None) -> ReadingOptions:
        """Return the options as the library takes them, with the bits of a reading if stated."""
        return ReadingOptions(
            format=self.format,
            layout=self.layout,
            width=self.width,
            frames=parse_frame_range(self.frame_range),
            rotate=self.rotate,
            flip=self.flip,
            region=None if self.region is None else parse_region(self.region),
            key=self.key,
            counts=self.counts,
            unpacked=self.unpacked,
            isolate=self.isolate,
            counts_scale=self.counts_scale,
            trials=self.trials,
            bit_depth=None if bit_depth == 1 else bit_depth,
        )

    def to_argv(self, key_option: str = "--key") -> list[str]:
        """Return the options as words of a command line, which may rename `--key`."""
        values = {
            "--format": self.format,
            "--layout": self.layout,
            "--width": self.width,
            "--frame-range": self.frame_range,
            "--rotate": self.rotate or None,
            "--flip": self.flip,
            "--region": self.region,
            key_option: self.key,
            "--counts-scale": self.counts_scale,
            "--trials": self.trials,
        }
        argv = [
            word
            for option, value in values.items()
            if value is not None
            for word in (option, str(value))
        ]
        if self.counts is not None:
            argv.append("--counts" if self.counts else "--bits")
        if self.unpacked is not None:
            argv.append("--unpacked" if self.unpacked else "--packed")
        if not self.isolate:
            argv.append("--no-isolate")
        return argv


@dataclasses.dataclass(frozen=True, kw_only=True)
class TargetCaptureOptions(CaptureOptions):
    """Parameters of the capture for which a network is trained.

    In that command, `--key` names the array of training images.
    """

    key: Annotated[str | None, Parameter(name="--sensor-key", help=_KEY)] = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ViewedCaptureOptions(CaptureOptions):
    """Parameters of a capture that the viewer shows as a whole."""

    region: Annotated[str | None, Parameter(show=False)] = None
    """Refused, with the command to use instead."""


def _warn_about_means(stack: CountStack, trials: float) -> None:
    """Issue a warning if the counts of 255 or 65535 trials look like means of fewer frames."""
    if trials not in SCALES:
        return
    values = read_frames(stack.images, 0, 1)
    hint = scaled_counts_hint(values) if stack.trials is None else None
    if hint is not None:
        warn(f"counts: {hint}")  # as the library, so that it is shown once


def parse_frame_range(text: str | None) -> slice | None:
    """Return the frames of A:B or A:B:STEP, or None for all frames.

    Examples
    --------
    >>> parse_frame_range("100:200")
    slice(100, 200, None)
    """
    if text is None:
        return None
    match = re.fullmatch(r"(\d{0,15}):(\d{0,15})(?::(\d{0,15}))?", text.strip(), re.ASCII)
    if match is None or (match[3] and int(match[3]) == 0):
        raise ValueError(
            "frame-range: expected A:B, A:, :B, or A:B:STEP in whole numbers from 0 upward, and a "
            f"step of 1 or more, got {text!r}"
        )
    return slice(*(int(number) if number else None for number in match.groups()))
