"""``jotlight film``: an image of each of many windows of frames."""

import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from cyclopts import Parameter

from jotlight.chunks import windows
from jotlight.cli.advice import caution_about_motion, representatives
from jotlight.cli.capture_options import CaptureOptions
from jotlight.cli.color_choice import has_colors, without_demosaicing
from jotlight.cli.common_options import FILM_PANEL, Threads, convert_file
from jotlight.cli.console import progress, report, shape_text
from jotlight.cli.inputs import Inputs, Reconstruction
from jotlight.cli.jot_checks import caution_about_jots
from jotlight.cli.method_options import MethodOptions
from jotlight.cli.motion_options import FilmMotionOptions
from jotlight.cli.output_options import OutputOptions, describe_tone
from jotlight.cli.reconstruction import Brightness, report_assumptions
from jotlight.cli.records import Records, origin_of
from jotlight.cli.sensor_options import CapturedSensorOptions
from jotlight.estimators.brightness import BRIGHTNESS_QUANTILE, UNITS
from jotlight.estimators.demosaicing import TITLES
from jotlight.evaluation.choice import FILM_NETWORK
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.records import tone_facts
from jotlight.files import atomic_write_together
from jotlight.formats.capture import Capture
from jotlight.formats.checked_reading import with_checksum
from jotlight.formats.locations import is_url
from jotlight.images.io import check_depth
from jotlight.images.tone import Tone
from jotlight.images.video import DEFAULT_FPS, check_fps, is_floats, video_writer
from jotlight.motion.film import film as merge_windows
from jotlight.motion.film_estimates import FilmEstimates
from jotlight.motion.film_image import FilmImage
from jotlight.motion.memory import remembers
from jotlight.networks.film_network import FilmNetwork
from jotlight.networks.precision import F32
from jotlight.networks.pretrained import pretrained_film
from jotlight.sensing.alike_frames import repeat_exposures
from jotlight.sensing.bits import Bits
from jotlight.sensing.channels import last_channel_axis
from jotlight.sensing.merged import Merged
from jotlight.sensing.sensor import Sensor

Image = npt.NDArray[np.float32]


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmOptions(OutputOptions):
    """Windows of frames, one for each image of a film, and the file to write."""

    output: Annotated[
        Path,
        Parameter(
            alias="-o",
            help="A .mp4, a .gif, or a name without ending for a new folder of .png, for display; "
            "a .npy or .tif for a stack of floats that are never clipped.",
        ),
    ]
    window: Annotated[
        int,
        Parameter(
            group=FILM_PANEL,
            help="Number of frames of each image of the film. For a stack of counts, the number of "
            "its images, whatever their frames.",
        ),
    ]
    step: Annotated[
        int | None,
        Parameter(
            group=FILM_PANEL,
            help="Frames, or images of a stack of counts, from one window to the next. Default: "
            "the size of a window.",
        ),
    ] = None
    fps: Annotated[
        float, Parameter(group=FILM_PANEL, help="Images per second of a .mp4 or .gif, from 0.01.")
    ] = DEFAULT_FPS

    def check(self) -> None:
        """Raise ValueError or OSError for options that do not suit a film."""
        super().check()
        floats = is_floats(self.output)
        if self.units != "intensity" and not floats:
            raise ValueError(
                f"units: are for floats, .npy or .tif, and {self.output} is for display"
            )
        if self.curve is not None and floats:
            raise ValueError(f"curve: is for display, not for the floats of {self.output}")
        if self.white is not None and floats:
            raise ValueError(f"white: is for display, not for the floats of {self.output}")
        # A name without ending is that of a folder of .png.
        check_depth(self.output.suffix.lower() or ".png", self.depth, floats=".tif or .npy")
        check_fps(self.output, self.fps)
        if self.output.suffix == "" and self.output.exists():
            raise FileExistsError(
                f"cannot write {self.output}: it exists already; choose another name"
            )


def film(
    data: Annotated[
        str,
        Parameter(
            converter=convert_file, help="A capture of bits or counts: a file, a folder, or a URL."
        ),
    ],
    /,
    *,
    outputs: FilmOptions,
    method: MethodOptions = MethodOptions(),
    capture: CaptureOptions = CaptureOptions(),
    sensor: CapturedSensorOptions = CapturedSensorOptions(),
    motion: FilmMotionOptions = FilmMotionOptions(),
    threads: Threads = None,
) -> None:
    """Reconstruct a film from bits or counts: one image for each window of frames.

    With --motion, each image shows the middle of its window, or the last frame with --causal. The
    motion is carried from image to image.
    """
    path = data if is_url(data) else Path(data)
    inputs = Inputs(path, method, capture, sensor, motion)
    outputs.check()
    motion.check()
    inputs.check_outputs([outputs.output])
    job = inputs.prepare(outputs.output, window=outputs.window, step=outputs.step)
    if motion.recurrent:
        job = _by_film_network(job)
    spans = windows(len(job.captured.data), outputs.window, outputs.step)
    brightness = _write(job, outputs, motion, spans, threads)
    report_assumptions(job, brightness)
    whole = _sensor_of_all(job, outputs.window)
    caution_about_jots(dataclasses.replace(job.captured, sensor=whole), threads)
    if not motion.motion:
        parts = (job.captured.data[span] for span in representatives(spans))
        caution_about_motion(parts, job.captured.sensor, threads)


def _by_film_network(job: Reconstruction) -> Reconstruction:
    """Return a reconstruction whose title is that of the film network."""
    if job.choice.is_requested or job.settings.keys() - {"precision"}:
        raise ValueError(
            "recurrent: the film network is a method of its own; leave out --method, --quality, "
            "--model, and their options"
        )
    if has_colors(job.captured):
        raise ValueError("recurrent: the film network is for gray films; leave it out for colors")
    FilmNetwork.check_sensor(job.captured.sensor)
    return dataclasses.replace(job, choice=dataclasses.replace(job.choice, method=FILM_NETWORK))


def _write(
    job: Reconstruction,
    outputs: FilmOptions,
    motion: FilmMotionOptions,
    spans: list[slice],
    threads: int | None,
) -> Brightness:
    """Write and report the estimate of every window, and return the maximum brightness.

    One window at a time is in memory.
    """
    scale = outputs.scale(job.captured.sensor)
    data, checksum = with_checksum(job.captured.data)
    records = Records([outputs.output], job.calibration, every=True)
    has_memory = _has_memory(outputs, motion)
    minimum, maximum, brightness = np.inf, 0.0, 0.0
    summary = _Summary()
    start = time.perf_counter()
    with atomic_write_together([], records.paths(), output=outputs.output) as files:
        with progress(len(spans)) as begin:
            tone = None
            if not is_floats(outputs.output):
                # Sums of moving frames are about as bright as merged ones, and take less time.
                begin("choosing the tone curve", 0)
                samples = [_estimate(job, data[span], threads) for span in representatives(spans)]
                tone = outputs.fit_tone(np.stack(samples))
            with video_writer(
                outputs.output, len(spans), tone=tone, fps=outputs.fps, depth=outputs.depth
            ) as add:
                captured = dataclasses.replace(job.captured, data=data)
                watched = dataclasses.replace(job, captured=captured)
                images = _images(watched, outputs, motion, spans, summary, threads)
                for number in range(len(spans)):
                    begin(f"image {number + 1} of {len(spans)}")
                    image = next(images)
                    minimum = min(minimum, float(image.min()))
                    maximum = max(maximum, float(image.max()))
                    brightness = max(brightness, float(np.quantile(image, BRIGHTNESS_QUANTILE)))
                    add(image * scale)
        seconds = time.perf_counter() - start
        facts = outputs.metadata(job.captured.sensor, job.choice.method, job.captured.provenance)
        facts |= {"window": outputs.window, "step": outputs.step or outputs.window}
        facts |= tone_facts(tone)
        aligned = {**motion.facts(), "memory": has_memory} if motion.motion else None
        facts |= origin_of(job, checksum(), aligned)
        records.write(files, [outputs.output], job, facts)
    unused = len(data) - spans[-1].stop
    lie = "lies" if unused == 1 else "lie"
    each = job.captured.sensor.frames // outputs.window
    report(
        f"{outputs.output}: {len(spans)} image{'s' * (len(spans) > 1)} of "
        f"{shape_text(image.shape)} from {_amount(data, outputs.window, each)} each"
        f"{' and from those before that agree' if has_memory and summary.accepted else ''}, "
        f"values {scale * minimum:.3g} to {scale * maximum:.3g} ({_display(outputs, tone)}), by "
        f"{job.choice.title} in {seconds:.3g} s"
        + (f"; {_amount(data, unused, each)} at the end {lie} in no window" if unused else "")
    )
    report(*summary.lines(job.settings.get("demosaicing")))
    return Brightness(maximum, brightness)


def _has_memory(outputs: FilmOptions, motion: FilmMotionOptions) -> bool:
    """Return whether images also count bits from before their windows."""
    window = outputs.window
    step = window if outputs.step is None else outputs.step
    return motion.motion and remembers(
        motion.memory, window, step, causal=motion.causal, upsample=motion.factor
    )


def _amount(data: Capture, number: int, each: int) -> str:
    """Return a number of frames, or of images of counts of `each` frames, as a text."""
    text = f"{number * each} frame{'s' * (number * each > 1)}"
    images = f"{number} image{'s' * (number > 1)} of counts"
    # Frames of readings of several bits have no trials.
    are_counts = not isinstance(data, Bits) and data.trials is not None
    return f"{images} ({text})" if are_counts else text


@dataclasses.dataclass
class _Summary:
    """What was found about the motion of all images of a film."""

    images: int = 0
    """Number of all images."""
    models: list[str] = dataclasses.field(default_factory=list)
    """Models of the motions that were estimated anew."""
    accepted: list[float] = dataclasses.field(default_factory=list)
    """Fraction of the bits that agree, of each image that was merged."""

    def add(self, image: FilmImage) -> None:
        """Add an image."""
        self.images += 1
        if not image.is_carried:
            self.models.append(image.motion.model)
        if image.data is image.merged and image.merged.acceptance is not None:
            self.accepted.append(float(image.merged.acceptance.mean()))

    def lines(self, demosaicing: str | None) -> list[str]:
        """Return what was found, or nothing without motion.

        `demosaicing` is the requested one, if any.
        """
        if not self.models:
            return []
        number, models = len(self.models), ", ".join(sorted(set(self.models)))
        line = f"motion: {models}; estimated anew for {number} image{'s' * (number > 1)}"
        if (others := self.images - number) > 0:
            line += f", and carried to {others} other{'s' * (others > 1)}"
        if self.accepted:
            line += (
                f"; {np.mean(self.accepted):.1%} of the bits agree and are used, and "
                f"{min(self.accepted):.1%} or more of each image"
            )
        if demosaicing in TITLES and self.accepted:
            number = len(self.accepted)
            return [
                line,
                f"demosaicing: not used for {number} merged image{'s' * (number > 1)}, because "
                "along the motion each pixel is seen through all filters",
            ]
        return [line]


def _images(
    job: Reconstruction,
    outputs: FilmOptions,
    motion: FilmMotionOptions,
    spans: list[slice],
    summary: _Summary,
    threads: int | None,
) -> Iterator[Image]:
    """Yield the estimates of all windows."""
    data = job.captured.data
    if not motion.motion:
        for span in spans:
            yield _estimate(job, data[span], threads)
        return
    estimates = None
    if motion.recurrent:
        network = pretrained_film().with_precision(job.settings.get("precision", F32))
        estimates = FilmEstimates(network, threads=threads)
    for image in merge_windows(
        data,
        _sensor_of_all(job, outputs.window),
        window=outputs.window,
        step=outputs.step,
        model=motion.model,
        causal=motion.causal,
        memory=motion.memory,
        upsample=motion.factor,
        threads=threads,
    ):
        summary.add(image)
        if estimates is not None:
            yield estimates.add(image)
            continue
        settings = (
            without_demosaicing(job.settings) if isinstance(image.data, Merged) else job.settings
        )
        yield reconstruct(image.data, method=job.method, threads=threads, **settings)


def _sensor_of_all(job: Reconstruction, window: int) -> Sensor:
    """Return the sensor of all frames, rather than those of a window."""
    sensor = job.captured.sensor
    return repeat_exposures(sensor, sensor.frames // window * len(job.captured.data))


def _estimate(job: Reconstruction, part: Capture, threads: int | None) -> Image:
    """Return the estimate of a window without alignment."""
    sensor = job.captured.sensor
    if isinstance(part, Bits):
        pixels: Any = part
    else:
        pixels = part.sum() if sensor.bit_depth == 1 else part.readings(sensor)
    image: Image = reconstruct(
        pixels,
        sensor,
        method=job.method,
        channel_axis=last_channel_axis(pixels),
        threads=threads,
        **job.settings,
    )
    return image


def _display(outputs: FilmOptions, tone: Tone | None) -> str:
    """Return the units of floats, or the tone curve."""
    return UNITS[outputs.units] if tone is None else describe_tone(tone)
