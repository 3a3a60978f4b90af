"""Options that describe a sensor."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from jotlight.cli.options.common_options import KNOWN_SENSOR_PANEL, SENSOR_PANEL, convert_file
from jotlight.cli.options.sensor_values import number_or_map, read_mosaic, values_of_frames
from jotlight.formats.images.maps import is_map, read_mask
from jotlight.sensing.sensor import KERNELS, Sensor

if TYPE_CHECKING:
    from jotlight.networks.loading import AnyNetwork

_OVERSAMPLING = "K̂: each pixel covers K̂ x K̂ jots, the pixels of the camera."
_FRAMES = "T: number of binary frames."
_MAX_INTENSITY = "S: largest intensity of an estimate."

_NoOption = Annotated[None, Parameter(parse=False)]
"""The type of a parameter that a command does not take."""

_MAPS = "dark_counts", "efficiency", "mask"
"""Options that take files of maps."""

_NO_MOSAIC = "none"
"""The value of --mosaic that removes the mosaic of a capture or a calibration."""


@Parameter(name="*", group=KNOWN_SENSOR_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class SensorOptions:
    """Parameters of a :class:`jotlight.Sensor`; None where an option is not set."""

    oversampling: Annotated[
        int | None,
        Parameter(alias="-k", help=f"{_OVERSAMPLING} Default: 1."),
    ] = None
    frames: Annotated[
        int | None,
        Parameter(
            alias="-t",
            help=f"{_FRAMES} Of images of counts, those of all images that --frame-range selects, "
            "together. Default: those of the capture, or 1.",
        ),
    ] = None
    gain: Annotated[
        str | None,
        Parameter(
            help="α, the exposure: photons on a pixel of intensity 1, over all jots and frames. "
            "For a bracket, the photons of each frame: 64,8,1 divides the frames into three equal "
            "groups, one after the other, and 64,8,1,... repeats the three values from frame to "
            "frame. Default: K, the number of bits per pixel, so one photon per jot and frame."
        ),
    ] = None
    threshold: Annotated[
        str | None,
        Parameter(
            alias="-q",
            converter=convert_file,
            help="q: number of photons that make a jot report 1: one number, several as in "
            "--gain, or a .npy or .tif map of the jots. Default: 1.",
        ),
    ] = None
    kernel: Annotated[
        str | None,
        Parameter(
            help="g, the point spread function (PSF) that spreads a pixel's light over the jots: "
            f"{', '.join(KERNELS)}. Default: {KERNELS[0]}."
        ),
    ] = None
    dark_counts: Annotated[
        str | None,
        Parameter(
            converter=convert_file,
            help="d: detections per jot and frame without light, the dark count rate (DCR) times "
            "the exposure time. A number, or a .npy or .tif map of the jots. Default: 0.",
        ),
    ] = None
    efficiency: Annotated[
        str | None,
        Parameter(
            converter=convert_file,
            help="η, the photon detection efficiency (PDE) or quantum efficiency: fraction of the "
            "photons that are detected. A number, or a .npy or .tif map of the jots. Default: 1.",
        ),
    ] = None
    mask: Annotated[
        Path | None,
        Parameter(
            help="Dead jots: a .npy of bool or whole numbers, a .png, or a .tif, where 0 (black) "
            "is a live jot. Default: all jots are live."
        ),
    ] = None
    max_intensity: Annotated[float | None, Parameter(help=f"{_MAX_INTENSITY} Default: 1.")] = None
    exposure_time: Annotated[
        float | None,
        Parameter(
            help="Exposure time of a frame in seconds, for photons per second. Default: unknown."
        ),
    ] = None
    bit_depth: Annotated[
        int | None,
        Parameter(
            help="b: bits of a reading. With 2 to 16 bits, a reading is a number of photons. "
            "Default: 1."
        ),
    ] = None
    read_noise: Annotated[
        float | None,
        Parameter(
            help="σ: standard deviation of the read noise, in photons (electrons). Default: 0."
        ),
    ] = None
    mosaic: Annotated[
        str | None,
        Parameter(
            converter=convert_file,
            help="Color filters of the pixels, from the top left: letters such as RGGB, with / "
            "between rows of more than 2 x 2; or a .json with pattern, filters, transmission, and "
            "white_balance; or none. Default: that of the capture or the calibration, else none.",
        ),
    ] = None

    def stated(self) -> dict[str, Any]:
        """Return the values of the options that the user passes, by the names of the parameters."""
        fields = (field.name for field in dataclasses.fields(SensorOptions))
        values = {name: getattr(self, name) for name in fields}
        return {name: value for name, value in values.items() if value is not None}

    def to_kwargs(self) -> dict[str, Any]:
        """Return the keyword arguments of a Sensor, with maps read from their files."""
        kwargs = self.stated()
        for name in ("dark_counts", "efficiency"):
            if name in kwargs:
                kwargs[name] = number_or_map(name, kwargs[name])
        frames = kwargs.get("frames")
        for name, kind in (("gain", float), ("threshold", int)):
            if name in kwargs:
                kwargs[name] = values_of_frames(name, kwargs[name], kind, frames)
        if "mosaic" in kwargs:
            mosaic = str(kwargs["mosaic"])
            kwargs["mosaic"] = None if mosaic == _NO_MOSAIC else read_mosaic(mosaic)
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
        values = self.stated()
        maps = [Path(values[name]) for name in _MAPS if name in values]
        threshold, mosaic = (str(values.get(name, "")) for name in ("threshold", "mosaic"))
        others = [threshold] * is_map(threshold) + [mosaic] * mosaic.endswith(".json")
        return [*maps, *map(Path, others)]

    def to_argv(self) -> list[str]:
        """Return the options as words of a command line."""
        return [
            word
            for name, value in self.stated().items()
            for word in (f"--{name.replace('_', '-')}", str(value))
        ]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ModelSensorOptions(SensorOptions):
    """Parameters of a sensor to simulate, which is that of a network of the user if there is one.

    A network for any sensor has none.
    """

    oversampling: Annotated[
        int | None,
        Parameter(alias="-k", help=f"{_OVERSAMPLING} Default: that of --model, or 4."),
    ] = None
    frames: Annotated[
        int | None, Parameter(alias="-t", help=f"{_FRAMES} Default: those of --model, or 1.")
    ] = None

    def sensor_for(self, network: "AnyNetwork | None") -> Sensor:
        """Return the sensor of a network, or of no network, changed by the options."""
        kwargs = self.to_kwargs()
        if network is not None and network.trials_range is None:
            return network.sensor.replace(**kwargs)
        return Sensor(**{"oversampling": 4, **kwargs})


@Parameter(name="*", group=SENSOR_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluatedSensorOptions(ModelSensorOptions):
    """Parameters of the sensor with which a method is evaluated."""

    mosaic: _NoOption = None


@Parameter(name="*", group=SENSOR_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class ExposureOptions(SensorOptions):
    """Parameters of a sensor to simulate."""

    oversampling: Annotated[int, Parameter(alias="-k", help=_OVERSAMPLING)] = 4
    frames: Annotated[int, Parameter(alias="-t", help=_FRAMES)] = 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class CalibratedSensorOptions(SensorOptions):
    """Parameters of a sensor, with its calibration."""

    calibration: Annotated[
        Path | None,
        Parameter(
            help="Dark counts, dead jots, and response of the sensor, from `jotlight calibrate`. "
            "Default: none."
        ),
    ] = None

    def to_argv(self) -> list[str]:
        """Return the options as words of a command line."""
        calibration = [] if self.calibration is None else ["--calibration", str(self.calibration)]
        return [*calibration, *super().to_argv()]


@Parameter(name="*", group=SENSOR_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class PlannedSensorOptions(CalibratedSensorOptions):
    """Parameters of a sensor whose quality is predicted."""

    frames: Annotated[int | None, Parameter(alias="-t", help=f"{_FRAMES} Default: 4096.")] = None
    gain: Annotated[
        str | None,
        Parameter(
            help="α, the exposure: photons on a pixel of intensity 1, over all jots and frames. It "
            "only defines the unit of --max-intensity. Default: K, the number of bits per pixel."
        ),
    ] = None
    threshold: Annotated[
        str | None,
        Parameter(
            alias="-q",
            converter=convert_file,
            help="q: number of photons that make a jot report 1. Default: 1.",
        ),
    ] = None
    max_intensity: Annotated[
        float | None,
        Parameter(help=f"{_MAX_INTENSITY} Default: the one half a count below saturation."),
    ] = None
    exposure_time: Annotated[float | None, Parameter(show=False)] = None
    """Refused, with the option to use instead."""
    mosaic: _NoOption = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrainedSensorOptions(CalibratedSensorOptions):
    """Parameters of the sensor for which a network is trained."""

    oversampling: Annotated[
        int | None,
        Parameter(alias="-k", help=f"{_OVERSAMPLING} Default: that of --sensor or --start, or 4."),
    ] = None
    frames: Annotated[
        int | None,
        Parameter(alias="-t", help=f"{_FRAMES} Default: those of --sensor or --start, or 1."),
    ] = None
    bit_depth: _NoOption = None
    read_noise: _NoOption = None
    mosaic: _NoOption = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class CapturedSensorOptions(CalibratedSensorOptions):
    """Parameters of the sensor of a capture, with its calibration or its hot jots."""

    max_intensity: Annotated[
        float | None,
        Parameter(
            help=f"{_MAX_INTENSITY} Default: with the box kernel, the one half a count below "
            "saturation, but at least 1; with other kernels, 1."
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
        return [*(["--find-hot-jots"] if self.find_hot_jots else []), *super().to_argv()]


@dataclasses.dataclass(frozen=True, kw_only=True)
class TunedSensorOptions(CapturedSensorOptions):
    """Parameters of the sensor of a capture on which a network is fine-tuned."""

    max_intensity: Annotated[
        float | None, Parameter(help=f"{_MAX_INTENSITY} Default: 1, or that of --start.")
    ] = None
    bit_depth: _NoOption = None
    read_noise: _NoOption = None
    mosaic: _NoOption = None
