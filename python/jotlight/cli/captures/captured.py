"""The data of a capture together with their sensor."""

import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

from jotlight.array_types import Counts
from jotlight.calibration import Calibration
from jotlight.calibration.stated_sensor import stated_sensor
from jotlight.chunks import windows
from jotlight.cli.terminal.console import progress
from jotlight.errors import counted
from jotlight.files import check_outputs
from jotlight.formats.capture import Capture, CountStack, assumed_sensor_note
from jotlight.formats.npy.description import companion_files
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.bits_checks import check_fits
from jotlight.sensing.bits.frames import read_frames
from jotlight.sensing.bits.readings import Readings
from jotlight.sensing.data.alike_frames import check_cycles, exposure_cycle, repeat_exposures
from jotlight.sensing.data.data_lists import carried_sensor
from jotlight.sensing.data.scaled_counts import scaled_counts_hint
from jotlight.sensing.parameters.provenance import Provenance
from jotlight.sensing.sensor import Sensor


@dataclasses.dataclass(frozen=True)
class Captured:
    """Bits or counts with their sensor."""

    data: Capture
    sensor: Sensor
    has_own_sensor: bool
    """Whether the file states the sensor."""
    provenance: Provenance | None
    hot_jots: int | None = None
    """Number of jots that are treated as dead because they look hot in the scene, if searched."""

    @property
    def states_mosaic(self) -> bool:
        """Whether the file states a mosaic, which the options may remove."""
        return self.data.sensor is not None and self.data.sensor.mosaic is not None

    def summed(self) -> Bits | Readings | Counts:
        """Return the bits, the readings of several bits, or the sum of a stack of counts."""
        if isinstance(self.data, Bits):
            return self.data
        if self.sensor.bit_depth > 1:
            return self.data.readings(self.sensor)
        with progress(1) as begin:
            return self.data.sum(begin("summing"))

    def with_sum_provenance(self) -> Self:
        """Return the same with the provenance of the sum, if images of counts are summed."""
        if isinstance(self.data, Bits) or self.sensor.bit_depth > 1:
            return self
        return dataclasses.replace(self, provenance=self.data.sum_provenance)

    def notes(self) -> list[str]:
        """Return the assumptions about the file and the sensor, one line each."""
        hot = []
        if self.hot_jots is not None:
            hot = [f"hot jots in the scene, which are treated as dead: {self.hot_jots}"]
        return [*provenance_notes(self.provenance), *hot, self.sensor_note()]

    def sensor_note(self) -> str:
        """Return the sensor, and whether it is assumed, in one line."""
        if self.has_own_sensor:
            return f"sensor: {self.sensor!r}"
        if isinstance(self.data, Bits):
            return assumed_sensor_note(self.sensor)
        return f"assumed{_frames_of_each(self.data, self.sensor)}: {self.sensor!r}"


def _frames_of_each(stack: CountStack, sensor: Sensor) -> str:
    """Return the frames that each of several images of counts is taken to have, in words."""
    if len(stack) == 1 or stack.trials is None:
        return ""
    each = counted(stack.trials // sensor.oversampling**2, "frame")
    return f", with {each} in each of the {len(stack)} images of counts"


def provenance_notes(provenance: Provenance | None) -> list[str]:
    """Return the assumptions about a file, one line each."""
    return [] if provenance is None else provenance.describe()


def add_sensor(
    capture: Capture,
    path: Path | str,
    sensor_kwargs: dict[str, Any],
    calibration: Calibration | None = None,
) -> Captured:
    """Return the data of a capture with their sensor.

    The sensor is the one of the file, changed first by the calibration and then by the options.

    Parameters
    ----------
    capture : Bits or CountStack
        Opened capture.
    path : Path or str
        Name for messages.
    sensor_kwargs : dict
        Keyword arguments of the sensor that the user set.
    calibration : Calibration, optional
        Calibration of the sensor.
    """
    if isinstance(capture, Bits):
        own = carried_sensor(capture)
        sensor = stated_sensor(
            own,
            calibration,
            sensor_kwargs,
            frames=len(capture),
            jots=capture.shape[1:3],
            provenance=capture.provenance,
        )
        return Captured(capture, sensor, own is not None, capture.provenance)
    if capture.sensor is not None or sensor_kwargs.get("bit_depth", 1) > 1:
        return _add_sensor_to_readings(capture, sensor_kwargs, calibration)
    sensor_kwargs = _with_stated_frames(capture, path, sensor_kwargs)
    side = sensor_kwargs.get("oversampling", 1)
    jots = tuple(side * size for size in capture.images.shape[1:3])
    sensor = stated_sensor(
        None, calibration, sensor_kwargs, frames=1, jots=jots, provenance=capture.provenance
    )
    return Captured(capture.with_trials_of(sensor), sensor, False, capture.provenance)


def _add_sensor_to_readings(
    stack: CountStack, sensor_kwargs: dict[str, Any], calibration: Calibration | None
) -> Captured:
    if calibration is not None:
        raise ValueError(
            "calibration: expected none, because it is for single bits, but the capture has "
            "readings of several bits; state --dark-counts, --efficiency, and --mask"
        )
    if "bit_depth" in sensor_kwargs:
        stack.check_bit_depth(sensor_kwargs["bit_depth"])
    if stack.sensor is not None:
        sensor = stack.sensor.replace(**sensor_kwargs)
    else:
        sensor = Sensor(**{"frames": len(stack), **sensor_kwargs})
    return Captured(stack, sensor, stack.sensor is not None, stack.provenance)


def _with_stated_frames(
    capture: CountStack, path: Path | str, sensor_kwargs: dict[str, Any]
) -> dict[str, Any]:
    """Return the keyword arguments with the frames that a file of counts states.

    Raises
    ------
    ValueError
        When the number of trials is unknown, or the file contradicts the options.
    """
    trials, jots = capture.total_trials, sensor_kwargs.get("oversampling", 1) ** 2
    if "frames" not in sensor_kwargs and trials is not None and jots > 0 and trials % jots == 0:
        return {**sensor_kwargs, "frames": trials // jots}
    names = [name for name in ("frames", "oversampling") if name in sensor_kwargs]
    if names:
        options = " and ".join(f"--{name} {sensor_kwargs[name]}" for name in names)
        expected = sensor_kwargs.get("frames", 1) * jots
        number = len(capture.images)
        if trials is not None and number > 1 and expected == capture.trials and trials % jots == 0:
            raise ValueError(
                f"{path}: holds {number} images of {counted(expected, 'trial')} each, and their "
                f"sum has {counted(trials, 'trial')}, but {options} means {expected}; write "
                f"--frames {trials // jots}"
            )
        check_trials(path, trials, expected, options)
        return sensor_kwargs
    if trials is None:
        values = read_frames(capture.images, 0, 1)
        hint = scaled_counts_hint(values)
        if hint is None and values.min() >= 0 and values.max() == 1:
            hint = "the values are only 0 and 1; if each number is one bit, add --unpacked"
        raise ValueError(
            f"{path}: holds counts of an unknown number of trials; set --frames, or "
            "--oversampling where a pixel covers many jots; "
            + (hint or "if it is a photograph, `jotlight simulate` makes a capture of it")
        )
    return sensor_kwargs


def check_trials(path: Path | str, stated: int | None, trials: int, options: str) -> None:
    """Raise ValueError when a file states another number of trials than the options."""
    if stated is not None and stated != trials:
        raise ValueError(
            f"{path}: states counts of {counted(stated, 'trial')}, but {options} means {trials}; "
            "leave the option out"
        )


def check_outputs_of(
    captures: Iterable[Path], outputs: Iterable[Path | None], inputs: Iterable[Path | None] = ()
) -> None:
    """Raise ValueError as :func:`check_outputs`, and when an output is part of a capture.

    `inputs` are the files to read in addition to the captures.
    """
    captures, requested = list(captures), list(filter(None, outputs))
    parts = [path for capture in captures for path in (capture, *companion_files(capture))]
    check_outputs(requested, [*inputs, *parts])
    folders = [capture for capture in captures if capture.is_dir()]
    for output in requested:
        for folder in folders:
            if folder.resolve() in (output.resolve(), *output.resolve().parents):
                raise ValueError(
                    f"{output}: lies in the folder {folder}, which is read; choose another name"
                )


def of_window(captured: Captured, window: int, step: int | None) -> Captured:
    """Return a capture with the sensor of one window of its frames.

    Raises
    ------
    ValueError
        When the windows are no part of the data, or see different exposures.
    """
    data, sensor = captured.data, captured.sensor
    check_cycles(exposure_cycle(sensor), window, step)
    if isinstance(data, Bits):
        windows(len(data), window)
        check_fits(data.shape, sensor)
        each = 1
    else:
        _check_window_of_counts(len(data), sensor.frames, window)
        each = sensor.frames // len(data)
    return dataclasses.replace(captured, sensor=repeat_exposures(sensor, each * window))


def _check_window_of_counts(number: int, frames: int, window: int) -> None:
    """Raise ValueError unless a window is a number of images of counts."""
    if 1 <= window <= number:
        return
    each, rest = divmod(frames, number)
    advice = ""
    if not rest and each and window % each == 0 and 1 <= window // each <= number:
        images = window // each
        advice = f"; for {window} frames, {each} in each image, write --window {images}"
    raise ValueError(
        f"window: expected 1 to the capture's {number} images of counts, got {window}{advice}"
    )
