"""``jotlight reconstruct --window``: a video of sliding windows of frames."""

import dataclasses
import time
from typing import Annotated

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from jotlight.cli.applied_calibration import recorded
from jotlight.cli.common_options import VIDEO_PANEL
from jotlight.cli.console import progress, report
from jotlight.cli.output_options import UNITS, OutputOptions
from jotlight.cli.reconstruction import Brightness, Reconstruction
from jotlight.estimators.brightness import BRIGHTNESS_QUANTILE
from jotlight.images.io import image_writer
from jotlight.images.tone import Tone
from jotlight.images.video import is_floats, video_writer, windows
from jotlight.sensing.bits import Bits


@Parameter(name="*", group=VIDEO_PANEL)
@dataclasses.dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """Windows of frames, one for each image of a video."""

    window: Annotated[
        int | None,
        Parameter(
            help="Number of frames of each image of a video. The output is a new folder of .png, "
            "a .mp4 or a .npy."
        ),
    ] = None
    step: Annotated[
        int | None,
        Parameter(help="Frames from one window to the next. Default: the size of a window."),
    ] = None
    fps: Annotated[float, Parameter(help="Images per second of a .mp4.")] = 25.0

    def check(self, outputs: OutputOptions) -> None:
        """Raise ValueError or OSError for options that do not suit a video."""
        output = outputs.output
        floats = is_floats(output)
        for name in ("preview", "uncertainty"):
            if getattr(outputs, name) is not None:
                raise ValueError(f"{name}: is for a single image, not for the images of a video")
        if outputs.units != "intensity" and not floats:
            raise ValueError(f"units: are for floats, .npy, and {output} is for display")
        image_writer("a.npy" if output.suffix else "a.png", depth=outputs.depth)
        if not 0 < self.fps < 1e4:
            raise ValueError(f"fps: expected images per second above 0, got {self.fps}")
        if output.suffix == "" and output.exists():
            raise FileExistsError(f"cannot write {output}: it exists already; choose another name")


def reconstruct_video(
    job: Reconstruction, bits: Bits, video: VideoOptions, window: int, threads: int | None
) -> Brightness:
    """Write and report the estimate of every window and return the maximum brightness.

    The sensor of the reconstruction is that of a window. One window at a time is in memory.
    """
    outputs, sensor = job.outputs, job.captured.sensor
    spans = windows(bits, window, video.step)

    def estimate_window(span: slice) -> npt.NDArray[np.float32]:
        part = bits[span]
        # These bits carry no sensor, since theirs has the frames of the whole capture.
        part = Bits(part.packed, part.width)
        return job.run(part, sensor, threads=threads, **job.settings)

    scale = outputs.scale(sensor)
    minimum, maximum, brightness = np.inf, 0.0, 0.0
    start = time.perf_counter()
    with recorded(job.calibration) as record:
        with progress(len(spans)) as begin:
            tone = None
            if not is_floats(outputs.output):
                begin("choosing the tone curve", 0)
                tone = outputs.video_tone([estimate_window(span) for span in _samples(spans)])
            with video_writer(
                outputs.output, len(spans), tone=tone, fps=video.fps, depth=outputs.depth
            ) as add:
                for number, span in enumerate(spans):
                    begin(f"window {number + 1} of {len(spans)}")
                    image = estimate_window(span)
                    minimum = min(minimum, float(image.min()))
                    maximum = max(maximum, float(image.max()))
                    brightness = max(brightness, float(np.quantile(image, BRIGHTNESS_QUANTILE)))
                    add(image * scale)
        seconds = time.perf_counter() - start
        record(*job.record_arguments)
    unused = len(bits) - spans[-1].stop
    report(
        f"{outputs.output}: {len(spans)} image{'s' * (len(spans) > 1)} of "
        f"{' x '.join(map(str, image.shape))} from {window} frame{'s' * (window > 1)} each, "
        f"values {scale * minimum:.3g} to {scale * maximum:.3g} ({_display(outputs, tone)}), by "
        f"{job.choice.title} in {seconds:.3g} s"
        + (f"; {unused} frames at the end lie in no window" if unused else "")
    )
    return Brightness(maximum, brightness)


def _samples(spans: list[slice]) -> list[slice]:
    """Return the first, the middle and the last window, which stand for all."""
    return [spans[index] for index in sorted({0, len(spans) // 2, len(spans) - 1})]


def _display(outputs: OutputOptions, tone: Tone | None) -> str:
    """Return the units of floats, or the tone curve."""
    return (
        UNITS[outputs.units] if tone is None else f"{tone.curve} curve, white at {tone.white:.3g}"
    )
