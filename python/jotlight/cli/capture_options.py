"""What commands that open captures share."""

import dataclasses
import re
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
import typer

from jotlight.calibration import Calibration
from jotlight.cli.console import out, progress
from jotlight.files import refuse_overwrite
from jotlight.formats import FORMATS, open_capture
from jotlight.formats.capture import Capture, CountStack
from jotlight.formats.description import companion_files
from jotlight.formats.orientation import FLIPS
from jotlight.sensing.bits import Bits
from jotlight.sensing.pixel_counts import carried_sensor
from jotlight.sensing.provenance import Provenance
from jotlight.sensing.sensor import Sensor


def _option(help_: str, *names: str) -> object:
    return typer.Option(*names, help=help_, rich_help_panel="Capture")


Format = Annotated[
    str | None,
    _option(
        f"Of what is read: {', '.join(FORMATS)}. Default: what the content tells; raw frames "
        "tell nothing.",
        "--format",
    ),
]
Width = Annotated[int | None, _option("True width in jots, where the file does not tell.")]
FrameRange = Annotated[
    str | None,
    _option("Some of the frames: 100:200 is 100 to 199, counted from 0; 0:200:2 every second."),
]
Rotate = Annotated[int, _option("Degrees, anticlockwise: a multiple of 90.")]
Flip = Annotated[str | None, _option(f"After that, mirror: {' or '.join(FLIPS)}.")]
Counts = Annotated[
    bool | None,
    _option(
        "Whether the numbers are counts or bits. Default: uint8 of three or four dimensions in a "
        ".npy is bits, and so is bool of as many; other numbers are counts.",
        "--counts/--bits",
    ),
]
Unpacked = Annotated[
    bool | None,
    _option(
        "Whether each number is one bit, 0 and 1 or 0 and 255, or each byte has eight. Default: "
        "eight, and what does not look so is refused.",
        "--unpacked/--packed",
    ),
]
Key = Annotated[str | None, _option("Name of the array in a .npz, .mat, HDF5 file or zarr folder.")]


def frames_of(text: str | None) -> slice | None:
    """The frames of an A:B or A:B:STEP."""
    if text is None:
        return None
    match = re.fullmatch(r"(\d{0,15}):(\d{0,15})(?::(\d{0,15}))?", text.strip(), re.ASCII)
    if match is None or (match[3] and int(match[3]) == 0):
        raise ValueError(f"frame-range: expected A:B, A: or :B in whole numbers, got {text!r}")
    return slice(*(int(number) if number else None for number in match.groups()))


@dataclasses.dataclass(frozen=True)
class CaptureOptions:
    """A capture, and the options that say how it is opened."""

    path: Path
    format: str | None = None
    width: int | None = None
    frame_range: str | None = None
    rotate: int = 0
    flip: str | None = None
    key: str | None = None
    counts: bool | None = None
    unpacked: bool | None = None

    def open(self) -> Capture:
        """Open it, with images of counts not yet summed."""
        return open_capture(
            self.path,
            format=self.format,
            width=self.width,
            frames=frames_of(self.frame_range),
            rotate=self.rotate,
            flip=self.flip,
            key=self.key,
            counts=self.counts,
            unpacked=self.unpacked,
        )

    def words(self, key: str = "--sensor-key") -> list[str]:
        """The options that were given, as `jotlight train --sensor` takes them.

        Other commands name the array by another option.
        """
        values = {
            "--format": self.format,
            "--width": self.width,
            "--frame-range": self.frame_range,
            "--rotate": self.rotate or None,
            "--flip": self.flip,
            key: self.key,
        }
        given = [(name, str(value)) for name, value in values.items() if value is not None]
        words = [word for pair in given for word in pair]
        if self.counts is not None:
            words.append("--counts" if self.counts else "--bits")
        if self.unpacked is not None:
            words.append("--unpacked" if self.unpacked else "--packed")
        return words


def refuse_capture_overwrite(output: Path, data: Path) -> None:
    """Raise ValueError when a file to be written is part of what is read."""
    refuse_overwrite(output, [data, *companion_files(data)])
    if data.is_dir() and data.resolve() in (output.resolve(), *output.resolve().parents):
        raise ValueError(
            f"{output}: the folder {data} is read, so nothing is written into it; give another name"
        )


def describe_provenance(provenance: Provenance | None) -> list[str]:
    """What was assumed of a file, one line each."""
    return [] if provenance is None else provenance.describe()


def check_told(path: Path, told: int | None, given: int, words: str) -> None:
    """Raise ValueError when counts are out of another number of bits than options say."""
    if told not in (None, given):
        raise ValueError(
            f"{path}: tells of counts out of {told} bits, and {words} of {given}; leave the option "
            "out"
        )


def with_frames(capture: CountStack, path: Path, given: dict[str, Any]) -> dict[str, Any]:
    """The parameters given for a sensor that saw counts, with the frames that the file tells.

    Raises
    ------
    ValueError
        When nothing tells out of how many bits the counts are, or the file contradicts what is
        given.
    """
    told, jots = capture.total_trials, given.get("oversampling", 1) ** 2
    if "frames" not in given and told is not None and jots > 0 and told % jots == 0:
        return {**given, "frames": told // jots}
    if "frames" in given or "oversampling" in given:
        names = (name for name in ("frames", "oversampling") if name in given)
        words = " and ".join(f"--{name} {given[name]}" for name in names)
        check_told(path, told, given.get("frames", 1) * jots, words)
        return given
    if told is None:
        raise ValueError(
            f"{path}: holds counts, and nothing tells out of how many bits; give --frames, or "
            "--oversampling where a pixel covers many jots"
        )
    return given


def seen_by_sensor(
    capture: Capture,
    path: Path,
    given: dict[str, Any],
    calibration: Calibration | None = None,
) -> tuple[Bits | npt.NDArray[np.int32], Sensor, str]:
    """The data, their sensor, and in a word where it is from."""
    if isinstance(capture, Bits):
        if calibration is not None:
            calibration.check_capture(capture.shape[1:3], capture.provenance)
        sensor = carried_sensor(capture)
        if sensor is None:
            words = "nothing beside the bits tells their sensor; assumed"
            if calibration is not None:
                return capture, calibration.sensor(**{"frames": len(capture), **given}), words
            return capture, Sensor(**{"frames": len(capture), **given}), words
        if calibration is not None:
            return capture, calibration.applied_to(sensor, **given), "sensor"
        return capture, sensor.replace(**given), "sensor"
    given = with_frames(capture, path, given)
    with progress(1) as begin:
        counts = capture.sum(begin("summing"))
    if calibration is None:
        return counts, Sensor(**given), "assumed"
    side = given.get("oversampling", 1)
    calibration.check_capture(tuple(side * size for size in counts.shape[:2]), capture.provenance)
    return counts, calibration.sensor(**given), "assumed"


def seen_and_told(
    capture: Capture, path: Path, given: dict[str, Any], calibration: Path | None
) -> tuple[Bits | npt.NDArray[np.int32], Sensor]:
    """The data and their sensor, once it is said where that is from."""
    found = None if calibration is None else Calibration.load(calibration)
    seen, sensor, where = seen_by_sensor(capture, path, given, found)
    for line in (*describe_provenance(capture.provenance), f"{where}: {sensor!r}"):
        out.print(line, soft_wrap=True, markup=False)
    return seen, sensor
