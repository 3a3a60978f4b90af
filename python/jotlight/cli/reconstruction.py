"""One reconstruction: its data, its method, and the files to write."""

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.cli.advice import range_advice
from jotlight.cli.applied_calibration import AppliedCalibration
from jotlight.cli.capture_options import CaptureOptions
from jotlight.cli.captured import Captured, add_sensor, check_outputs_of, of_window
from jotlight.cli.color_choice import (
    refuse_demosaicing,
    takes_color_network,
    without_demosaicing,
)
from jotlight.cli.console import caution, live_iterations, progress, report
from jotlight.cli.jot_checks import mask_hot_jots
from jotlight.cli.method_options import MethodOptions
from jotlight.cli.motion_options import ImageMotionOptions, MotionOptions, describe
from jotlight.cli.output_options import ImageOutputOptions, describe_tone
from jotlight.cli.records import Records, origin_of
from jotlight.cli.sensor_options import CapturedSensorOptions
from jotlight.estimators.brightness import BRIGHTNESS_QUANTILE, UNITS
from jotlight.estimators.demosaicing import TITLES as DEMOSAICING
from jotlight.estimators.problem import ConvergenceHistories
from jotlight.evaluation.channels import takes_channels
from jotlight.evaluation.choice import BY_COLOR_NETWORK, COLOR_NETWORK, Choice, choose_method
from jotlight.evaluation.info import Info
from jotlight.evaluation.methods import DEFAULT_METHOD, METHODS
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.uncertainty import check_errors_known
from jotlight.files import atomic_write_together
from jotlight.formats.capture import Capture
from jotlight.formats.checked_reading import with_checksum
from jotlight.networks.color_network import AnyNetwork
from jotlight.networks.loading import load_image_network
from jotlight.networks.pretrained import pretrained
from jotlight.sensing.bits import Bits
from jotlight.sensing.channels import last_channel_axis
from jotlight.sensing.merged import Merged
from jotlight.sensing.pixel_counts import Data, gray_images


@dataclasses.dataclass(frozen=True)
class Reconstruction:
    """All that determines the estimate of an image."""

    path: Path | str
    captured: Captured
    """The capture, whose sensor has the frames of one image."""
    choice: Choice
    method: str | AnyNetwork | None
    """The name of the method, or the network. None: the color network."""
    settings: dict[str, Any]
    """Keyword arguments of the method."""
    calibration: AppliedCalibration | None
    white: float | None
    """Largest intensity, if the capture or the user states it."""
    model: Path | None = None
    """File of the network, if the user passes one."""

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
    ) -> Reconstruction:
        """Return the reconstruction of an image.

        Parameters
        ----------
        output : Path
            Output, beside which the calibration is recorded.
        window : int, optional
            Number of frames of the image. Default: all.
        """
        opened = self.capture.open(self.path, self.sensor.stated_trials(), self.sensor.bit_depth)
        # Whether the color network takes a single merged image depends on what was merged.
        may_be_color = window is not None or not self.motion.motion
        return self.prepare_opened(opened, output, window=window, may_be_color=may_be_color)

    def prepare_opened(
        self,
        opened: Capture,
        output: Path,
        *,
        window: int | None = None,
        may_be_color: bool = False,
    ) -> Reconstruction:
        """Return the reconstruction of an image from an opened capture, as :meth:`prepare`.

        With `may_be_color`, the method may be the color network.
        """
        request = self.method.request()
        if self.motion.factor > 1:
            request = request or DEFAULT_METHOD
        may_be_color &= (
            self.method.demosaicing in (None, BY_COLOR_NETWORK) and not self.method.fallback
        )
        network = None if self.method.model is None else load_image_network(self.method.model)
        sensor_kwargs = self.sensor.to_kwargs()
        calibration = None
        if self.sensor.calibration is not None:
            calibration = AppliedCalibration.read(self.sensor.calibration, output)
            self.check_outputs([calibration.record])
        known = None if calibration is None else calibration.calibration
        captured = self._adapt(add_sensor(opened, self.path, sensor_kwargs, known), network, window)
        is_range_known = captured.has_own_sensor or self.sensor.max_intensity is not None
        choice = choose_method(
            captured.sensor,
            requested=request,
            network=network,
            is_range_known=is_range_known,
            is_color=may_be_color and takes_color_network(captured),
        )
        choice.check_precision(self.method.precision, fallback=self.method.fallback)
        if self.motion.factor > 1 and choice.quality is None and network is None:
            raise ValueError(
                f"upsample: expected a network, but the method is {choice.method}; leave it out"
            )
        if choice.quality is not None and captured.sensor.mosaic is None:
            network = pretrained(captured.sensor, choice.quality)
        captured = _with_max_intensity(captured, choice.max_intensity)
        # The color network is the default for colors, and has no name.
        named = None if choice.method == COLOR_NETWORK else choice.method
        method = named if network is None else network
        settings = self.method.settings()
        white = choice.max_intensity if is_range_known else None
        return Reconstruction(
            self.path,
            captured,
            choice,
            method,
            settings,
            calibration,
            white,
            self.method.model,
        )

    def _adapt(
        self, captured: Captured, network: AnyNetwork | None, window: int | None
    ) -> Captured:
        """Return the capture as the options, the network, and the window of an image change it."""
        if self.sensor.find_hot_jots:
            captured = mask_hot_jots(captured)
        is_range_open = self.sensor.max_intensity is None
        if network is not None and network.trials_range is None and is_range_open:
            captured = _with_max_intensity(captured, network.sensor.max_intensity)
        if window is None:
            return captured
        if isinstance(captured.data, Bits) and self.sensor.frames is not None:
            raise ValueError(
                "frames: --window states the frames of each image; --frame-range selects frames of "
                "the capture"
            )
        return of_window(captured, window)


def _with_max_intensity(captured: Captured, max_intensity: float) -> Captured:
    sensor = captured.sensor.replace(max_intensity=max_intensity)
    return dataclasses.replace(captured, sensor=sensor)


@dataclasses.dataclass(frozen=True)
class Brightness:
    """Largest value of an estimate, and its brightness without the brightest 0.1 %."""

    maximum: float
    quantile: float


def reconstruct_image(
    job: Reconstruction,
    outputs: ImageOutputOptions,
    motion: ImageMotionOptions,
    threads: int | None,
) -> None:
    """Write and report the estimate of one image."""
    captured = job.captured
    found = []
    paths, all_paths = outputs.paths(), [*outputs.paths(), *motion.paths()]
    records = Records(all_paths, job.calibration)
    # Creating the files reveals a folder that cannot be written before any work.
    with atomic_write_together(all_paths, records.paths()) as files:
        watched, checksum = with_checksum(captured.data)
        captured = dataclasses.replace(captured, data=watched)
        merged, aligned = None, None
        if motion.motion:
            merged, path = motion.align(captured, threads)
            job = _with_colors(job, merged)
            if outputs.uncertainty is not None and merged is None:
                check_errors_known(job.method, captured.sensor)
            aligned = motion.facts_of(path)
        title = job.choice.title
        metadata = outputs.metadata(captured.sensor, job.choice.method, captured.provenance)
        if motion.motion:
            metadata |= origin_of(job, checksum(), aligned)
            motion.write(files[len(paths) : len(all_paths)], merged, path, metadata)
            found = describe(merged, path)
        data = captured.summed() if merged is None else merged
        start = time.perf_counter()
        estimate, ending = _estimate(job, data, threads)
        seconds = time.perf_counter() - start
        metadata |= origin_of(job, checksum(), aligned)
        tones = outputs.write(
            files[: len(paths)],
            estimate,
            data,
            data.sensor if isinstance(data, Merged) else captured.sensor,
            method=job.method,
            demosaicing=None if isinstance(data, Merged) else job.settings.get("demosaicing"),
            white=job.white,
            metadata=metadata,
            threads=threads,
        )
        records.write(files[len(all_paths) :], files, job, metadata)
    scale = outputs.scale(captured.sensor)
    units = "intensities" if outputs.units == "intensity" else UNITS[outputs.units]
    display = [f" ({describe_tone(tone)})" for tone in tones]
    preview = "" if outputs.preview is None else display.pop()
    report(
        f"{outputs.output}: {' x '.join(map(str, estimate.shape))}, {units} "
        f"{scale * estimate.min():.3g} to {scale * estimate.max():.3g}{''.join(display)}, by "
        f"{title}{ending} in {seconds:.3g} s"
    )
    if outputs.preview is not None:
        report(f"{outputs.preview}: image for display{preview}")
    if outputs.uncertainty is not None:
        report(f"{outputs.uncertainty}: confidence intervals of {outputs.coverage:g}")
    report(*found)
    report_assumptions(
        job, Brightness(float(estimate.max()), float(np.quantile(estimate, BRIGHTNESS_QUANTILE)))
    )


def _with_colors(job: Reconstruction, merged: Merged | None) -> Reconstruction:
    """Return the reconstruction by the color network, if it takes the data after an alignment.

    `merged` is None for a scene that stands still behind a mosaic. Requested methods stay.
    """
    if merged is not None:
        refuse_demosaicing(job.settings)
    demosaicing = job.settings.get("demosaicing")
    others = job.settings.keys() - {"demosaicing", "precision"}
    is_default = demosaicing not in DEMOSAICING and not others
    if job.choice.reason == "requested" or not is_default:
        return job
    if merged is None:
        takes = takes_color_network(job.captured)
    else:
        takes = takes_channels(gray_images(merged))
    choice = choose_method(job.captured.sensor, is_color=takes)
    if choice.method != COLOR_NETWORK:
        return job
    own = {name: getattr(job.choice, name) for name in ("max_intensity", "notes")}
    return dataclasses.replace(job, choice=dataclasses.replace(choice, **own), method=None)


def _estimate(
    job: Reconstruction, data: Data, threads: int | None
) -> tuple[npt.NDArray[np.float32], str]:
    """Return the estimate of an image, and how the iterations ended or what was blended."""
    title, settings = job.choice.title, job.settings
    if isinstance(data, Merged):
        settings = without_demosaicing(settings)

    def run(**others: Any) -> tuple[npt.NDArray[np.float32], Info]:
        return reconstruct(
            data,
            data.sensor if isinstance(data, Merged) else job.captured.sensor,
            method=job.method,
            channel_axis=last_channel_axis(data),
            threads=threads,
            return_info=True,
            **{**settings, **others},
        )

    if isinstance(job.method, str) and METHODS[job.method].iterative:
        with live_iterations(title) as callback:
            estimate, info = run(callback=callback)
        assert info.history is not None, "the progress of an iterative method"
        return estimate, f" ({_describe_convergence(info.history)})"
    with progress(None) as begin:
        begin(title)
        estimate, info = run()
    after = info.title.removeprefix(title) if info.title.startswith(title) else ""
    if info.shares is None:
        return estimate, after
    shares = [f"{share:.0%} {name}" for name, share in info.shares.items()]
    return estimate, f"{after} ({', '.join(shares)})"


def _describe_convergence(histories: ConvergenceHistories) -> str:
    """Return how the iterations ended: those of the channel that took longest."""
    each = histories if isinstance(histories, list) else [histories]
    iterations = max(history.iterations for history in each)
    text = f"{iterations} iteration{'' if iterations == 1 else 's'}"
    if not all(history.converged for history in each):
        text += ", NOT converged"
    if (weight := float(np.mean([np.mean(history.weight) for history in each]))) > 0:
        text += f", weight {weight:.3g}"
    return text


def report_assumptions(job: Reconstruction, brightness: Brightness) -> None:
    """Print what was assumed, and what could be better."""
    captured, label = job.captured, f"by {job.choice.method}"
    *about_file, about_sensor = captured.notes()
    applied = (
        []
        if job.calibration is None
        else job.calibration.notes(captured.sensor, captured.provenance)
    )
    report(*about_file, *applied, about_sensor, *job.choice.notes)
    remark = range_advice(job.choice, brightness.maximum, brightness.quantile)
    if remark is not None:
        caution(label, remark)
