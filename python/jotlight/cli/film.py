"""``jotlight film``: an image of each of many windows of frames."""

import dataclasses
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from jotlight.array_types import Image
from jotlight.chunks import windows
from jotlight.cli.captures.color_choice import has_colors, without_demosaicing
from jotlight.cli.captures.jot_checks import caution_about_jots
from jotlight.cli.options.capture_options import CaptureOptions
from jotlight.cli.options.common_options import Threads, convert_file
from jotlight.cli.options.method_options import MethodOptions
from jotlight.cli.options.motion_options import FilmMotionOptions
from jotlight.cli.options.output_options import FilmOptions
from jotlight.cli.options.sensor_options import CapturedSensorOptions
from jotlight.cli.reconstruction.film_report import FilmSummary, film_lines
from jotlight.cli.reconstruction.inputs import Inputs, Reconstruction
from jotlight.cli.reconstruction.reconstruction import Brightness, report_assumptions
from jotlight.cli.reconstruction.records import Records, origin_of
from jotlight.cli.reports.advice import caution_about_motion, representatives
from jotlight.cli.terminal.console import progress, report
from jotlight.errors import hide_warnings
from jotlight.evaluation.choice import FILM_NETWORK, title_of
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.records.info import Info, mean_settings
from jotlight.evaluation.records.records import tone_facts
from jotlight.files import atomic_write_together
from jotlight.formats.capture import Capture
from jotlight.formats.frames.checked_reading import with_checksum
from jotlight.formats.opening.locations import is_url
from jotlight.images.tone import Tone
from jotlight.images.video import is_floats, video_writer
from jotlight.motion.films.estimates import FilmEstimates
from jotlight.motion.films.film import film as merge_windows
from jotlight.motion.films.memory import remembers
from jotlight.networks.planes_network import FilmNetwork
from jotlight.networks.precision import F32
from jotlight.networks.pretrained import pretrained_film
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.channels import last_channel_axis
from jotlight.sensing.data.alike_frames import repeat_exposures
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor


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
    inputs = Inputs(path, method, capture, sensor, motion, threads)
    outputs.check()
    motion.check()
    inputs.check_outputs([outputs.output])
    job = inputs.prepare(outputs.output, window=outputs.window, step=outputs.step)
    if motion.recurrent:
        job = _by_film_network(job)
    spans = windows(len(job.captured.data), outputs.window, outputs.step)
    summary = _write(job, outputs, motion, spans, threads)
    report(*film_lines(job, outputs, spans, summary))
    if summary.clipping is not None:
        summary.clipping.report()
    report_assumptions(job, Brightness(summary.maximum, summary.brightness))
    whole = _sensor_of_all(job, outputs.window)
    caution_about_jots(dataclasses.replace(job.captured, sensor=whole), threads)
    if not motion.motion:
        parts = (job.captured.data[span] for span in representatives(spans))
        caution_about_motion(parts, job.captured.sensor, threads)


def _by_film_network(job: Reconstruction) -> Reconstruction:
    """Return a reconstruction whose title is that of the film network."""
    if job.choice.is_requested or job.request.settings().keys() - {"precision"}:
        raise ValueError(
            "recurrent: the film network is a method of its own; leave out --method, --quality, "
            "--model, and their options"
        )
    if has_colors(job.captured):
        raise ValueError("recurrent: the film network is for gray films; leave it out for colors")
    FilmNetwork.check_sensor(job.captured.sensor)
    title = title_of(FILM_NETWORK)
    choice = dataclasses.replace(job.choice, method=FILM_NETWORK, title=title)
    return dataclasses.replace(job, choice=choice)


def _write(
    job: Reconstruction,
    outputs: FilmOptions,
    motion: FilmMotionOptions,
    spans: Sequence[slice],
    threads: int | None,
) -> FilmSummary:
    """Write the estimate of every window, and return what was found.

    One window at a time is in memory.
    """
    scale = outputs.scale(job.captured.sensor)
    data, checksum = with_checksum(job.captured.data)
    watched = dataclasses.replace(job, captured=dataclasses.replace(job.captured, data=data))
    records = Records([outputs.output], job.calibration, every=True)
    summary = FilmSummary(_has_memory(outputs, motion))
    aligned = {**motion.facts(), "memory": summary.has_memory} if motion.motion else None
    start = time.perf_counter()
    with atomic_write_together([], records.paths(), output=outputs.output) as files:
        with progress(len(spans)) as begin:
            if not is_floats(outputs.output):
                begin("choosing the tone curve", 0)
                samples = _samples(job, outputs, motion, spans, threads)
                summary.tone, summary.clipping = outputs.fit_film_tone(samples)
            facts = _facts_before(job, outputs, summary.tone)
            known = origin_of(job, [job.captured.sensor], (0, 0), aligned)
            records.reserve(files, job, facts | known)
            with video_writer(
                outputs.output,
                len(spans),
                tone=summary.tone,
                fps=outputs.fps,
                depth=outputs.depth,
                note=facts,
            ) as add:
                images = _images(watched, outputs, motion, spans, summary, threads)
                for number in range(len(spans)):
                    begin(f"image {number + 1} of {len(spans)}")
                    image = next(images)
                    summary.add(image)
                    add(image * scale)
        summary.seconds = time.perf_counter() - start
        facts |= origin_of(job, _sensors_of_images(job, summary), checksum(), aligned)
        facts["found"] = mean_settings(summary.found)
        records.write(files, [outputs.output], job, facts)
    return summary


def _facts_before(job: Reconstruction, outputs: FilmOptions, tone: Tone | None) -> dict[str, Any]:
    """Return the facts about a film that are known before its images."""
    captured = job.captured
    facts = outputs.metadata(captured.sensor, job.choice.method, captured.provenance)
    spans = {"window": outputs.window, "step": outputs.step or outputs.window}
    return facts | spans | tone_facts(tone) | {"capture": Path(job.path).name}


def _sensors_of_images(job: Reconstruction, summary: FilmSummary) -> list[Sensor]:
    """Return the sensors of the data of the images: merged ones have no mosaic."""
    sensor, merged = job.captured.sensor, len(summary.accepted)
    return [
        *([sensor] if merged < summary.images else []),
        *([without_mosaic(sensor)] if merged > 0 else []),
    ]


def _has_memory(outputs: FilmOptions, motion: FilmMotionOptions) -> bool:
    """Return whether images also count bits from before their windows."""
    window = outputs.window
    step = window if outputs.step is None else outputs.step
    return motion.motion and remembers(
        motion.memory, window, step, causal=motion.causal, upsample=motion.factor
    )


def _samples(
    job: Reconstruction,
    outputs: FilmOptions,
    motion: FilmMotionOptions,
    spans: Sequence[slice],
    threads: int | None,
) -> list[Image]:
    """Return the estimates of a few windows, each as the first image of a film.

    Sums without motion would be darker than the images where the scene is bright.
    """
    found: list[Image] = []
    for span in representatives(spans):
        part = dataclasses.replace(job.captured, data=job.captured.data[span])
        alone = dataclasses.replace(job, captured=part), outputs, motion
        with hide_warnings():  # the images of the film repeat them
            found += _images(*alone, [slice(0, outputs.window)], FilmSummary(False), threads)
    return found


def _images(
    job: Reconstruction,
    outputs: FilmOptions,
    motion: FilmMotionOptions,
    spans: Sequence[slice],
    summary: FilmSummary,
    threads: int | None,
) -> Iterator[Image]:
    """Yield the estimates of all windows."""
    data = job.captured.data
    if not motion.motion:
        for span in spans:
            image, info = _estimate(job, data[span], threads)
            summary.found.append(info.found_settings())
            yield image
        return
    estimates = None
    if motion.recurrent:
        network = pretrained_film().with_precision(job.request.precision or F32)
        estimates = FilmEstimates(network, threads=threads)
    for part in merge_windows(
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
        summary.add_motion(part)
        if estimates is not None:
            yield estimates.add(part)
            continue
        request = job.request.with_threads(threads)
        if isinstance(part.data, Merged):
            request = without_demosaicing(request)
        image, info = reconstruct(part.data, return_info=True, **request.arguments())
        summary.found.append(info.found_settings())
        yield image


def _sensor_of_all(job: Reconstruction, window: int) -> Sensor:
    """Return the sensor of all frames, rather than those of a window."""
    sensor = job.captured.sensor
    return repeat_exposures(sensor, sensor.frames // window * len(job.captured.data))


def _estimate(job: Reconstruction, part: Capture, threads: int | None) -> tuple[Image, Info]:
    """Return the estimate of a window without alignment, and how it was made."""
    sensor = job.captured.sensor
    if isinstance(part, Bits):
        pixels: Any = part
    else:
        pixels = part.sum() if sensor.bit_depth == 1 else part.readings(sensor)
    made: tuple[Image, Info] = reconstruct(
        pixels,
        sensor,
        channel_axis=last_channel_axis(pixels),
        return_info=True,
        **job.request.with_threads(threads).arguments(),
    )
    return made
