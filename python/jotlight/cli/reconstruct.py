"""``jotlight reconstruct``: an image from bits or counts."""

import dataclasses
from pathlib import Path

from jotlight.cli.advice import range_advice, training_advice
from jotlight.cli.applied_calibration import AppliedCalibration
from jotlight.cli.capture_options import CaptureOptions
from jotlight.cli.captured import Captured, add_sensor, refuse_capture_overwrite
from jotlight.cli.common_options import CapturePath, Threads
from jotlight.cli.console import caution, report
from jotlight.cli.method_options import MethodOptions
from jotlight.cli.output_options import OutputOptions
from jotlight.cli.reconstruction import Brightness, Reconstruction, reconstruct_image
from jotlight.cli.sensor_options import CalibratedSensorOptions
from jotlight.cli.video import VideoOptions, reconstruct_video
from jotlight.evaluation.methods import METHODS, choose_method
from jotlight.files import refuse_overwrite
from jotlight.images.io import image_writer
from jotlight.images.video import windows
from jotlight.networks.network import Network
from jotlight.networks.pretrained import pretrained
from jotlight.sensing.bits import Bits, check_fits


def reconstruct(
    data: CapturePath,
    /,
    *,
    outputs: OutputOptions,
    method: MethodOptions = MethodOptions(),
    capture: CaptureOptions = CaptureOptions(),
    sensor: CalibratedSensorOptions = CalibratedSensorOptions(),
    video: VideoOptions = VideoOptions(),
    threads: Threads = None,
) -> None:
    """Reconstruct an image from bits or counts.

    The sensor is the one that the capture states, changed first by the calibration and then by the
    options. With a calibration, OUTPUT.json records what was applied.
    """
    sensor_kwargs = sensor.to_kwargs()
    inputs = [method.model, sensor.calibration, *sensor.map_files()]
    _check_outputs(data, outputs, video, sensor, inputs)
    request = method.request(needs_uncertainty=outputs.uncertainty is not None)
    network = None if method.model is None else Network.load(method.model)
    opened = capture.open(data)
    calibration = None
    if sensor.calibration is not None:
        calibration = AppliedCalibration.read(sensor.calibration, outputs.output)
        refuse_capture_overwrite(calibration.record, data)
        refuse_overwrite(calibration.record, inputs)
    known = None if calibration is None else calibration.calibration
    captured = add_sensor(opened, data, sensor_kwargs, known)
    if network is not None and network.trials_range is None and sensor.max_intensity is None:
        captured = _with_max_intensity(captured, network.sensor.max_intensity)
    if video.window is not None:
        captured = _of_window(captured, data, video.window, video.step)
    is_bits = isinstance(captured.data, Bits)
    advice = training_advice(data, capture, sensor, window=video.window, is_bits=is_bits)
    choice = choose_method(
        captured.sensor,
        requested=request,
        network=network,
        is_bits=is_bits,
        is_range_known=captured.has_own_sensor or sensor.max_intensity is not None,
        remedy=advice,
    )
    if choice.quality is not None:
        network = pretrained(captured.sensor, choice.quality)
    captured = _with_max_intensity(captured, choice.max_intensity)
    run = METHODS[choice.method].run if network is None else network.reconstruct
    job = Reconstruction(data, captured, choice, run, method.settings(), outputs, calibration)
    if video.window is not None and isinstance(captured.data, Bits):
        brightness = reconstruct_video(job, captured.data, video, video.window, threads)
    else:
        brightness = reconstruct_image(job, threads)
    _report_assumptions(job, brightness, advice)


def _check_outputs(
    data: Path,
    outputs: OutputOptions,
    video: VideoOptions,
    sensor: CalibratedSensorOptions,
    inputs: list[Path | None],
) -> None:
    """Raise ValueError or OSError for outputs that cannot be written, before any work."""
    outputs.check()
    for path in outputs.paths():
        refuse_overwrite(path, inputs)
        refuse_capture_overwrite(path, data)
    if video.window is None:
        if video.step is not None:
            raise ValueError("step: is for a video, which --window selects")
        image_writer(outputs.output, depth=outputs.depth)
        return
    video.check(outputs)
    if sensor.frames is not None:
        raise ValueError(
            "frames: --window states the frames of each image; --frame-range selects frames of "
            "the capture"
        )


def _with_max_intensity(captured: Captured, max_intensity: float) -> Captured:
    sensor = captured.sensor.replace(max_intensity=max_intensity)
    return dataclasses.replace(captured, sensor=sensor)


def _of_window(captured: Captured, path: Path, window: int, step: int | None) -> Captured:
    """Return a capture with the sensor of one window of its frames."""
    if not isinstance(captured.data, Bits):
        raise ValueError(f"window: is for bits, and {path} holds counts")
    check_fits(captured.data, captured.sensor)
    windows(captured.data, window, step)
    return dataclasses.replace(captured, sensor=captured.sensor.replace(frames=window))


def _report_assumptions(job: Reconstruction, brightness: Brightness, training: str) -> None:
    """Print what was assumed, and what could be better."""
    provenance_notes_, sensor_note = job.captured.notes()[:-1], job.captured.notes()[-1]
    applied = (
        []
        if job.calibration is None
        else job.calibration.notes(job.captured.sensor, job.captured.provenance)
    )
    report(*provenance_notes_, *applied, sensor_note, *job.choice.notes)
    label = f"by {job.choice.method}"
    for message in job.choice.warnings:
        caution(label, message)
    remark = range_advice(job.choice, brightness.maximum, brightness.quantile, training)
    if remark is not None:
        caution(label, remark)
