"""``jotlight reconstruct``: an image from bits or counts."""

from jotlight.cli.advice import caution_about_motion
from jotlight.cli.capture_options import CaptureOptions
from jotlight.cli.common_options import CapturePath, Threads
from jotlight.cli.jot_checks import caution_about_jots
from jotlight.cli.method_options import MethodOptions
from jotlight.cli.motion_options import ImageMotionOptions
from jotlight.cli.output_options import ImageOutputOptions
from jotlight.cli.reconstruction import Inputs, reconstruct_image
from jotlight.cli.sensor_options import CapturedSensorOptions
from jotlight.evaluation.uncertainty import check_errors_known
from jotlight.images.io import image_writer


def reconstruct(
    data: CapturePath,
    /,
    *,
    outputs: ImageOutputOptions,
    method: MethodOptions = MethodOptions(),
    capture: CaptureOptions = CaptureOptions(),
    sensor: CapturedSensorOptions = CapturedSensorOptions(),
    motion: ImageMotionOptions = ImageMotionOptions(),
    threads: Threads = None,
) -> None:
    """Reconstruct an image from bits or counts.

    The sensor is the one that the capture states, changed first by the calibration and then by the
    options. With a calibration, OUTPUT.json records what was applied. If the scene moves, --motion
    aligns the frames.
    """
    inputs = Inputs(data, method, capture, sensor, motion)
    outputs.check()
    motion.check()
    inputs.check_outputs([*outputs.paths(), *motion.paths()])
    image_writer(outputs.output, depth=outputs.depth)
    job = inputs.prepare(outputs.output)
    if outputs.uncertainty is not None:
        check_errors_known(job.method, job.captured.sensor)
    reconstruct_image(job, outputs, motion, threads)
    caution_about_jots(job.captured, threads)
    if not motion.motion:
        caution_about_motion([job.captured.data], job.captured.sensor, threads)
