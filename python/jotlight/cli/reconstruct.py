"""``jotlight reconstruct``: an image from bits or counts."""

from dataclasses import fields, replace
from pathlib import Path

from jotlight.cli.captures.jot_checks import caution_about_jots
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.common_options import Threads
from jotlight.cli.options.method_options import MethodOptions
from jotlight.cli.options.motion_options import ImageMotionOptions, MotionOptions
from jotlight.cli.options.output_options import ImageOutputOptions, OutputOptions
from jotlight.cli.options.run_options import CapturePaths, RunOptions, name_output
from jotlight.cli.options.sensor_options import CapturedSensorOptions
from jotlight.cli.reconstruction.inputs import Inputs
from jotlight.cli.reconstruction.reconstruction import reconstruct_image
from jotlight.cli.reports.advice import caution_about_motion
from jotlight.evaluation.uncertainty import check_errors_known
from jotlight.formats.opening.locations import is_url
from jotlight.images.io import image_writer
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor


def reconstruct(
    *data: CapturePaths,
    outputs: ImageOutputOptions,
    method: MethodOptions = MethodOptions(),
    capture: CaptureOptions = CaptureOptions(),
    sensor: CapturedSensorOptions = CapturedSensorOptions(),
    motion: ImageMotionOptions = ImageMotionOptions(),
    run: RunOptions = RunOptions(),
    threads: Threads = None,
) -> None:
    """Reconstruct an image from bits or counts, or images of many captures or windows.

    The sensor is the one that the capture states, changed first by the calibration and then by the
    options. With a calibration, OUTPUT.json records what was applied. If the scene moves, --motion
    aligns the frames.

    With --window, each capture becomes a video in a .zarr. Several captures need a name such as
    -o videos/{name}.zarr. The command continues a run that was stopped: results that are complete
    are not made again.
    """
    if not data:
        raise ValueError("expected a capture: a file, a folder, a URL, or a glob")
    outputs.check()
    if run.is_requested(data):
        _reconstruct_many(data, outputs, method, capture, sensor, motion, run, threads)
        return
    outputs = replace(outputs, output=name_output(outputs.output, data[0]))
    path = data[0] if is_url(data[0]) else Path(data[0])
    inputs = Inputs(path, method, capture, sensor, motion, threads)
    motion.check()
    inputs.check_outputs([*outputs.paths(), *motion.paths()])
    image_writer(outputs.output, depth=outputs.depth)
    job = inputs.prepare(outputs.output)
    if outputs.uncertainty is not None and motion.factor > 1:
        raise ValueError("uncertainty: is not known for the finer grid of --upsample")
    if outputs.uncertainty is not None:
        # After an alignment, the data may have no mosaic.
        seen = job.captured.sensor
        check_errors_known(job.request.method, without_mosaic(seen) if motion.motion else seen)
    reconstruct_image(job, outputs, motion, threads)
    caution_about_jots(job.captured, threads)
    if not motion.motion:
        caution_about_motion([job.captured.data], job.captured.sensor, threads)


def _refuse_options_of_images(
    outputs: ImageOutputOptions, motion: ImageMotionOptions, run: RunOptions
) -> None:
    """Raise ValueError for options that a run over many captures or windows does not accept."""
    plain = ImageOutputOptions(output=outputs.output, depth=outputs.depth)
    if run.window is None:  # each capture becomes an image, which may be for display
        plain = replace(plain, curve=outputs.curve, white=outputs.white)
    of_films = {each.name for base in (OutputOptions, MotionOptions) for each in fields(base)}
    for given, default in ((outputs, plain), (motion, ImageMotionOptions())):
        for name in (each.name for each in fields(given)):
            if getattr(given, name) != getattr(default, name):
                option = name.replace("_", "-")
                is_of_films = run.window is not None and name in of_films
                film = f", or use `jotlight film`, which takes --window and --{option}"
                raise ValueError(
                    f"{option}: is for one image of one capture, but --window, globs, and several "
                    f"captures make many; name one capture{film if is_of_films else ''}"
                )


def _reconstruct_many(
    data: tuple[str, ...],
    outputs: ImageOutputOptions,
    method: MethodOptions,
    capture: CaptureOptions,
    sensor: CapturedSensorOptions,
    motion: ImageMotionOptions,
    run: RunOptions,
    threads: int | None,
) -> None:
    """Reconstruct many captures, or the windows of one."""
    from jotlight.cli.runs.capture_jobs import Target, check_image_name, reconstruction_job
    from jotlight.cli.runs.many import process
    from jotlight.runs.capture_source import CaptureSource
    from jotlight.runs.jobs import Job
    from jotlight.runs.names import find_captures

    find_captures(data, run.storage_options())  # an error for a glob that matches nothing
    _refuse_options_of_images(outputs, motion, run)
    method.to_request()  # an error for an unknown method, before captures are opened
    sensors: dict[Sensor, Sensor] = {}

    def make_job(target: Target, bits: Bits, source: CaptureSource) -> tuple[Job, list[str]]:
        inputs = Inputs(Path(target.path), method, capture, sensor, motion, threads)
        return reconstruction_job(target, bits, source, inputs, run, outputs, sensors)

    def check_name(output: Path) -> None:
        check_image_name(output, outputs.depth)

    process(data, outputs.output, capture, run, threads, check_name, make_job)
