"""One reconstruction: the estimate of an image, its files, and its report."""

import dataclasses
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from jotlight.array_types import Image
from jotlight.cli.captures.color_choice import (
    refuse_demosaicing,
    takes_capture,
    without_demosaicing,
)
from jotlight.cli.options.motion_options import ImageMotionOptions, describe
from jotlight.cli.options.output_options import ImageOutputOptions, describe_tone
from jotlight.cli.reconstruction.inputs import Reconstruction
from jotlight.cli.reconstruction.records import Records, origin_of
from jotlight.cli.reports.advice import range_advice
from jotlight.cli.terminal.console import caution, live_iterations, progress, report, shape_text
from jotlight.errors import counted, warn
from jotlight.estimators.brightness import BRIGHTNESS_QUANTILE, UNITS
from jotlight.estimators.iterative.convergence import ConvergenceHistories
from jotlight.estimators.uncertainty import Uncertainty
from jotlight.evaluation.color.color_data import takes_channels
from jotlight.evaluation.contradictions.clipping import with_clipping_of
from jotlight.evaluation.methods import COLOR_NETWORK, is_iterative
from jotlight.evaluation.reconstruct import reconstruct
from jotlight.evaluation.records.info import Info
from jotlight.evaluation.uncertainty import check_errors_known, uncertainty
from jotlight.files import atomic_write_together
from jotlight.formats.frames.checked_reading import with_checksum
from jotlight.images.tone import Tone
from jotlight.sensing.bits.channels import last_channel_axis
from jotlight.sensing.data.pixel_counts import Data, gray_images
from jotlight.sensing.merged import Merged
from jotlight.sensing.parameters.reading_groups import without_mosaic
from jotlight.sensing.sensor import Sensor

_MANY = 0.01
"""Fraction of unlikely pixels that is reported."""


def _sensor_of(job: Reconstruction, data: Data) -> Sensor:
    """Return the sensor of the data of an estimate."""
    return data.sensor if isinstance(data, Merged) else job.captured.sensor


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
                check_errors_known(job.request.method, captured.sensor)
            aligned = motion.facts_of(path)
        if merged is None:
            job = dataclasses.replace(job, captured=job.captured.with_sum_provenance())
        data = captured.summed() if merged is None else merged
        sensor = job.captured.sensor
        sensors = [sensor if merged is None else without_mosaic(sensor)]
        origin = job.captured.provenance
        metadata = outputs.metadata(captured.sensor, job.choice.method, origin)
        if motion.motion:
            metadata |= origin_of(job, sensors, checksum(), aligned)
            motion.write(files[len(paths) : len(all_paths)], merged, path, metadata)
            found = describe(merged, path)
        start = time.perf_counter()
        with with_clipping_of(job.choice):
            estimate, ending, settings = _estimate(job, data, threads)
        seconds = time.perf_counter() - start
        metadata |= origin_of(job, sensors, checksum(), aligned)
        metadata |= {"found": settings} if settings else {}
        known = None
        if outputs.uncertainty is not None:
            known = _uncertainty(job, data, estimate, outputs, threads)
            _warn_about_unlikely(known, job)
        own = files[: len(paths)]
        scale = outputs.scale(captured.sensor)
        tones = outputs.write(own, estimate, known, scale, white=job.white, metadata=metadata)
        records.write(files[len(all_paths) :], files, job, metadata)
    made = f"{job.title}{ending} in {seconds:.3g} s"
    _report_outputs(outputs, estimate, scale, tones, made)
    report(*found)
    report_assumptions(
        job, Brightness(float(estimate.max()), float(np.quantile(estimate, BRIGHTNESS_QUANTILE)))
    )


def _report_outputs(
    outputs: ImageOutputOptions,
    estimate: Image,
    scale: np.float32,
    tones: Sequence[Tone],
    origin: str,
) -> None:
    """Report the files of an estimate, its range in their units, and how it was made."""
    units = "intensities" if outputs.units == "intensity" else UNITS[outputs.units]
    display = [f" ({describe_tone(tone)})" for tone in tones]
    preview = "" if outputs.preview is None else display.pop()
    report(
        f"{outputs.output}: {shape_text(estimate.shape)}, {units} "
        f"{scale * estimate.min():.3g} to {scale * estimate.max():.3g}{''.join(display)}, "
        f"by {origin}"
    )
    if outputs.preview is not None:
        report(f"{outputs.preview}: image for display{preview}")
    if outputs.uncertainty is not None:
        report(f"{outputs.uncertainty}: confidence intervals of {outputs.coverage:g}")


def _with_colors(job: Reconstruction, merged: Merged | None) -> Reconstruction:
    """Return the reconstruction with the choice for the data after an alignment, if it has colors.

    `merged` is None for a scene that stands still behind a mosaic.
    """
    if merged is not None:
        refuse_demosaicing(job.request)
    request = job.request
    if not job.choice.is_requested:
        request = dataclasses.replace(request, method=None)
    if merged is None:
        takes = takes_capture(job.captured)
    else:
        request, takes = without_demosaicing(request), takes_channels(gray_images(merged))
    choice = request.choose(job.captured.sensor, takes_colors=takes)
    if not choice.is_color:
        return job
    own = {name: getattr(job.choice, name) for name in ("max_intensity", "notes")}
    return dataclasses.replace(job, choice=dataclasses.replace(choice, **own), request=request)


def _estimate(
    job: Reconstruction, data: Data, threads: int | None
) -> tuple[npt.NDArray[np.float32], str, dict[str, Any]]:
    """Return the estimate of an image, how the iterations ended or what was blended, and settings.

    The settings are those that the method found from the data.
    """
    title, request = job.choice.title, job.request.with_threads(threads)
    if isinstance(data, Merged):
        request = without_demosaicing(request)

    def run(**others: Any) -> tuple[npt.NDArray[np.float32], Info]:
        return reconstruct(
            data,
            _sensor_of(job, data),
            channel_axis=last_channel_axis(data),
            return_info=True,
            **request.arguments(),
            **others,
        )

    if is_iterative(request.method):
        with live_iterations(title) as callback:
            estimate, info = run(callback=callback)
        assert info.history is not None, "the progress of an iterative method"
        ending = f" ({_describe_convergence(info.history)})"
        return estimate, ending, info.found_settings()
    with progress(None) as begin:
        begin(title)
        estimate, info = run()
    after = info.title.removeprefix(title) if info.title.startswith(title) else ""
    if info.shares is None:
        return estimate, after, {}
    shares = [f"{share:.0%} {name}" for name, share in info.shares.items()]
    return estimate, f"{after} ({', '.join(shares)})", info.found_settings()


def _uncertainty(
    job: Reconstruction,
    data: Data,
    estimate: npt.NDArray[np.float32],
    outputs: ImageOutputOptions,
    threads: int | None,
) -> Uncertainty:
    """Return the uncertainty of the estimate of an image."""
    request = without_demosaicing(job.request) if isinstance(data, Merged) else job.request
    return uncertainty(
        data,
        _sensor_of(job, data),
        method=request.method,
        demosaicing=request.demosaicing,
        fallback=request.fallback,
        estimate=estimate,
        channel_axis=last_channel_axis(data),
        confidence_level=outputs.coverage,
        units=outputs.units,
        threads=threads,
    )


def _warn_about_unlikely(known: Uncertainty, job: Reconstruction) -> None:
    """Warn if the bits contradict the estimate of a network that could fall back."""
    request, unlikely = job.request, known.unlikely.mean()
    can_fall_back = job.choice.is_network and request.method != COLOR_NETWORK
    if unlikely > _MANY and can_fall_back and not request.fallback:
        warn(
            f"{unlikely:.0%} of the pixels look unlike photographs: their bits speak against the "
            "estimate; fallback=True (--fallback) blends it with methods that trust the bits more"
        )


def _describe_convergence(histories: ConvergenceHistories) -> str:
    """Return how the iterations ended: those of the channel that took longest."""
    each = histories if isinstance(histories, list) else [histories]
    iterations = max(history.iterations for history in each)
    text = counted(iterations, "iteration")
    if not all(history.converged for history in each):
        text += ", NOT converged"
    if (weight := float(np.mean([np.mean(history.weight) for history in each]))) > 0:
        text += f", weight {weight:.3g}"
    return text


def assumptions(job: Reconstruction) -> list[str]:
    """Return what was assumed about the file, the sensor, and the method, one line each."""
    captured, calibration = job.captured, job.calibration
    *about_file, about_sensor = captured.notes()
    applied = [] if calibration is None else calibration.notes(captured.sensor, captured.provenance)
    return [*about_file, *applied, about_sensor, *job.choice.notes]


def report_assumptions(job: Reconstruction, brightness: Brightness) -> None:
    """Print what was assumed, and what could be better."""
    label = f"by {job.choice.method}"
    report(*assumptions(job))
    remark = range_advice(job.choice, brightness.maximum, brightness.quantile)
    if remark is not None:
        caution(label, remark)
