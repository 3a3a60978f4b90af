"""Options that describe a sensor."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any

import numpy.typing as npt
from cyclopts import Parameter

from jotlight.cli.common_options import SENSOR_PANEL
from jotlight.formats.arrays import read_npy
from jotlight.formats.images.captures import read_mask
from jotlight.sensing.maps import MAPS
from jotlight.sensing.sensor import KERNELS

Oversampling = Annotated[int, Parameter(alias="-k", help="K̂: each pixel covers K̂ x K̂ jots.")]
Frames = Annotated[int, Parameter(alias="-t", help="T: number of binary frames.")]


@Parameter(name="*", group=SENSOR_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Parameters of a :class:`jotlight.Sensor`; None where an option is not set."""

    oversampling: Oversampling | None = None
    frames: Frames | None = None
    gain: Annotated[
        float | None,
        Parameter(
            help="α: photons on a pixel of intensity 1, over all jots and frames. Default: K, the "
            "number of trials per pixel."
        ),
    ] = None
    threshold: Annotated[
        int | None, Parameter(alias="-q", help="q: number of photons that make a jot report 1.")
    ] = None
    kernel: Annotated[
        str | None, Parameter(help=f"Spread of a pixel's light: {', '.join(KERNELS)}.")
    ] = None
    dark_counts: Annotated[
        str | None,
        Parameter(
            help="d: detections per jot and frame without light. A number, or a .npy map of the "
            "jots."
        ),
    ] = None
    efficiency: Annotated[
        str | None,
        Parameter(
            help="η: fraction of photons that are detected. A number, or a .npy map of the jots."
        ),
    ] = None
    mask: Annotated[
        Path | None,
        Parameter(
            help="Dead jots: a .npy of bool that is True for dead jots, or a PNG that is black for "
            "live jots."
        ),
    ] = None
    max_intensity: Annotated[
        float | None, Parameter(help="S: largest intensity of an estimate.")
    ] = None

    def _set(self) -> dict[str, Any]:
        fields = (field.name for field in dataclasses.fields(SensorOptions))
        values = {name: getattr(self, name) for name in fields}
        return {name: value for name, value in values.items() if value is not None}

    def to_kwargs(self) -> dict[str, Any]:
        """Return the keyword arguments of a Sensor, with maps read from their files."""
        kwargs = self._set()
        for name in ("dark_counts", "efficiency"):
            if name in kwargs:
                kwargs[name] = _number_or_map(kwargs[name])
        if "mask" in kwargs:
            kwargs["mask"] = read_mask(Path(kwargs["mask"]))
        return kwargs

    def stated_trials(self) -> int | None:
        """Return the number of trials per pixel if the options state it."""
        if self.frames is None:
            return None
        return self.frames * (self.oversampling or 1) ** 2

    def map_files(self) -> list[Path]:
        """Return the files that hold maps."""
        values = self._set()
        return [Path(values[name]) for name in MAPS if name in values]

    def to_argv(self) -> list[str]:
        """Return the options as words of a command line."""
        return [
            word
            for name, value in self._set().items()
            for word in (f"--{name.replace('_', '-')}", str(value))
        ]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExposureOptions(SensorOptions):
    """Parameters of a sensor to simulate."""

    oversampling: Oversampling = 4
    frames: Frames = 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class CalibratedSensorOptions(SensorOptions):
    """Parameters of the sensor of a capture, with its calibration."""

    calibration: Annotated[
        Path | None,
        Parameter(
            help="Dark counts, dead jots and response of the sensor, from `jotlight calibrate`."
        ),
    ] = None
    find_hot_jots: Annotated[
        bool,
        Parameter(
            negative=(),
            help="Find jots that are much brighter than their neighbors, and treat them as dead, "
            "for sensors without a dark capture.",
        ),
    ] = False

    def to_argv(self) -> list[str]:
        """Return the options as words of a command line."""
        calibration = [] if self.calibration is None else ["--calibration", str(self.calibration)]
        hot = ["--find-hot-jots"] if self.find_hot_jots else []
        return [*calibration, *hot, *super().to_argv()]


def _number_or_map(text: str) -> float | npt.NDArray[Any]:
    try:
        return float(text)
    except ValueError:
        return read_npy(text)
