"""The inputs of a reconstruction: the capture, its sensor, and the method."""

import dataclasses
from pathlib import Path
from typing import Any

from jotlight.cli.captures.applied_calibration import AppliedCalibration
from jotlight.cli.captures.captured import Captured, add_sensor, check_outputs_of, of_window
from jotlight.cli.captures.color_choice import (
    takes_capture,
)
from jotlight.cli.captures.jot_checks import mask_hot_jots
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.method_options import MethodOptions
from jotlight.cli.options.motion_options import MotionOptions
from jotlight.cli.options.sensor_options import CapturedSensorOptions
from jotlight.evaluation.choice import Choice
from jotlight.evaluation.methods import COLOR_NETWORK, DEFAULT_METHOD
from jotlight.evaluation.request import Request
from jotlight.formats.capture import Capture
from jotlight.networks.loading import AnyNetwork
from jotlight.networks.planes_network import ColorNetwork
from jotlight.sensing.bits.bits import Bits


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reconstruction:
    """All that determines the estimate of an image."""

    path: Path | str
    captured: Captured
    """The capture, whose sensor has the frames of one image."""
    choice: Choice
    request: Request
    """The method, by its name or as a network, and its settings. No name: the color network, which
    is recommended."""
    calibration: AppliedCalibration | None
    white: float | None
    """Largest intensity, if the capture or the user states it."""
    model: Path | None = None
    """File of the network, if the user passes one."""

    @property
    def title(self) -> str:
        """Name of the method in messages, with the file of the user's network."""
        own = "" if self.model is None else f" ({self.model.name})"
        return f"{self.choice.title}{own}"

    @property
    def record_arguments(self) -> tuple[Any, ...]:
        """Arguments of :meth:`AppliedCalibration.description`."""
        captured = self.captured
        return captured.sensor, self.choice.method, Path(self.path).name, captured.provenance


@dataclasses.dataclass(frozen=True)
class Inputs:
    """The options that say what to reconstruct, and how."""

    path: Path | str
    """The capture, or its URL."""
    method: MethodOptions
    capture: CaptureOptions
    sensor: CapturedSensorOptions
    motion: MotionOptions
    threads: int | None
    """Number of threads. None: all."""

    def check_outputs(self, outputs: list[Path]) -> None:
        """Raise ValueError when outputs have the same name, or that of a file to read."""
        files = [self.method.model, self.sensor.calibration, *self.sensor.map_files()]
        captures = [self.path] if isinstance(self.path, Path) else []
        check_outputs_of(captures, outputs, [*files, *self.motion.files()])

    def prepare(
        self,
        output: Path,
        *,
        window: int | None = None,
        step: int | None = None,
    ) -> Reconstruction:
        """Return the reconstruction of an image.

        Parameters
        ----------
        output : Path
            Output, beside which the calibration is recorded.
        window : int, optional
            Number of frames of the image. Default: all.
        step : int, optional
            Frames from one window to the next. Default: the size of a window.
        """
        opened = self.capture.open(self.path, self.sensor.stated_trials(), self.sensor.bit_depth)
        # Whether the color network takes a single merged image depends on what was merged.
        may_be_color = window is not None or not self.motion.motion
        return self.prepare_opened(
            opened, output, window=window, step=step, may_be_color=may_be_color
        )

    def prepare_opened(
        self,
        opened: Capture,
        output: Path,
        *,
        window: int | None = None,
        step: int | None = None,
        may_be_color: bool = False,
    ) -> Reconstruction:
        """Return the reconstruction of an image from an opened capture, as :meth:`prepare`.

        With `may_be_color`, the color network may be recommended. It may be requested anyway.
        """
        request = self.method.to_request()
        if self.motion.factor > 1 and request.method is None:
            request = dataclasses.replace(request, method=DEFAULT_METHOD)
        network = request.method if isinstance(request.method, AnyNetwork) else None
        sensor_kwargs = self.sensor.to_kwargs()
        calibration = None
        if self.sensor.calibration is not None:
            calibration = AppliedCalibration.read(self.sensor.calibration, output)
            self.check_outputs([calibration.record])
        known = None if calibration is None else calibration.calibration
        captured = self._adapt(add_sensor(opened, self.path, sensor_kwargs, known), network)
        if window is not None:
            captured = self._of_window(captured, window, step)
        is_range_known = captured.has_own_sensor or self.sensor.max_intensity is not None
        # A merged image may have no mosaic.
        asked = request if may_be_color else dataclasses.replace(request, demosaicing=None)
        may_be_color |= request.method == COLOR_NETWORK or isinstance(network, ColorNetwork)
        choice = asked.choose(
            captured.sensor,
            takes_colors=may_be_color and takes_capture(captured),
            is_range_known=is_range_known,
        )
        if self.motion.factor > 1 and choice.quality is None and network is None:
            raise ValueError(
                f"upsample: expected a network, but the method is {choice.method}; leave it out"
            )
        request = request.of_choice(choice)
        captured = _with_max_intensity(captured, choice.max_intensity)
        white = choice.max_intensity if is_range_known else None
        return Reconstruction(
            path=self.path,
            captured=captured,
            choice=choice,
            request=request,
            calibration=calibration,
            white=white,
            model=self.method.model,
        )

    def _adapt(self, captured: Captured, network: AnyNetwork | None) -> Captured:
        """Return the capture as the options and the network change it."""
        if self.sensor.find_hot_jots:
            captured = mask_hot_jots(captured, self.threads)
        is_range_open = self.sensor.max_intensity is None
        if network is not None and network.trials_range is None and is_range_open:
            captured = _with_max_intensity(captured, network.sensor.max_intensity)
        return captured

    def _of_window(self, captured: Captured, window: int, step: int | None) -> Captured:
        """Return the capture with the sensor of a window."""
        stated = self.sensor.frames
        if isinstance(captured.data, Bits) and stated not in (None, len(captured.data)):
            raise ValueError(
                "frames: --window states the frames of each image; --frame-range selects frames of "
                "the capture"
            )
        return of_window(captured, window, step)


def _with_max_intensity(captured: Captured, max_intensity: float) -> Captured:
    sensor = captured.sensor.replace(max_intensity=max_intensity)
    return dataclasses.replace(captured, sensor=sensor)
