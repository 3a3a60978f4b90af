"""Runs of `reconstruct` and `convert` over many captures, or over the windows of a capture."""

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from jotlight.chunks import windows
from jotlight.cli.capture_options import CaptureOptions, parse_frame_range
from jotlight.cli.console import caution, progress, report
from jotlight.cli.reconstruction import Inputs, Reconstruction
from jotlight.cli.records import maps_sha256
from jotlight.cli.run_options import RunOptions
from jotlight.dask.cluster import connected
from jotlight.dask.estimator import Estimator, check_countable, checked
from jotlight.dask.jobs import (
    CaptureSource,
    ConversionJob,
    ImageJob,
    Job,
    VideoJob,
    run_record,
)
from jotlight.dask.names import Part, find_captures, name_captures, name_outputs
from jotlight.dask.records import AnotherRunError
from jotlight.dask.running import (
    Cluster,
    Executor,
    Outcome,
    ThisProcess,
    format_bytes,
    run_jobs,
)
from jotlight.dask.spans import Spans
from jotlight.dask.store import VideoStore
from jotlight.errors import counted, error_message
from jotlight.files import check_outputs
from jotlight.formats.locations import is_url
from jotlight.formats.writing import choose_output_format
from jotlight.images.io import image_writer
from jotlight.networks.color_network import ColorNetwork
from jotlight.networks.network import Network
from jotlight.sensing.bits import Bits
from jotlight.sensing.lazy import frames_per_chunk
from jotlight.sensing.sensor import Sensor

_MIN_CHUNK = 1 << 27
"""Default size in bytes of the part of a capture that is computed at a time."""

_MAX_GROUPS = 1024
"""Number of parts of a large capture by default. So the scheduler has few tasks for any size."""

_MAX_SHOWN = 20
"""Number of failed captures whose errors are repeated at the end."""

_ZARR = ".zarr"


@dataclasses.dataclass(frozen=True)
class Target:
    """One capture of a run."""

    path: str
    name: str
    output: Path
    number: int


MakeJob = Callable[[Target, Bits, CaptureSource], Job]
"""A function that returns the job of a capture."""


def process(
    captures: tuple[str, ...],
    output: Path,
    capture: CaptureOptions,
    run: RunOptions,
    threads: int | None,
    make_job: MakeJob,
) -> None:
    """Make the results of all captures, and report them.

    Raises
    ------
    ValueError
        At the end, when some captures could not be processed.
    """
    if run.step is not None and run.window is None:
        raise ValueError(f"step: is for the windows of a capture; add --window {run.step}")
    if run.scheduler is not None and run.workers is not None:
        raise ValueError("expected one of --scheduler and --workers, got both")
    has_cluster = run.scheduler is not None or run.workers is not None
    if has_cluster and run.part is not None:
        raise ValueError("part: is for job arrays without dask; leave out --scheduler, --workers")
    part = None if has_cluster else Part.requested(run.part)
    paths = find_captures(captures, run.storage_options())
    names = name_captures(paths)
    outputs = name_outputs(output, names)
    check_outputs(outputs, [Path(path) for path in paths if not is_url(path)])
    if has_cluster:  # whose workers may run in other folders
        outputs = [path.absolute() for path in outputs]
    targets = [
        Target(*each, number) for number, each in enumerate(zip(paths, names, outputs, strict=True))
    ]
    chosen = [
        target for target in targets if part is None or part.has_capture(target.number, len(paths))
    ]
    with _executor(run, threads, part) as executor:
        jobs, refused = _make_jobs(chosen, capture, run, make_job)
        with progress(1) as begin:
            outcome = run_jobs(
                [job for _, job in jobs],
                executor,
                part=part,
                numbers=[target.number for target, _ in jobs],
                captures=len(paths),
                progress=begin(counted(len(chosen), "capture") if len(names) > 1 else names[0]),
                # A single error is reported at the end.
                warn=lambda text: caution("failed", text) if len(chosen) > 1 else None,
            )
    outcome.failed = {**refused, **outcome.failed}
    _report(outcome, {target.name: target for target in chosen}, part)


@contextlib.contextmanager
def _executor(run: RunOptions, threads: int | None, part: Part | None) -> Iterator[Executor]:
    if run.scheduler is None and run.workers is None:
        yield ThisProcess(mapped=part is not None, threads=threads)
        return
    with connected(run.scheduler, run.workers) as client:
        report(f"dashboard of dask: {client.dashboard_link}")
        yield Cluster(client)


def _make_jobs(
    targets: list[Target], capture: CaptureOptions, run: RunOptions, make_job: MakeJob
) -> tuple[list[tuple[Target, Job]], dict[str, str]]:
    """Return the jobs of all captures that can be opened, and the errors of the others.

    Raises
    ------
    OSError, ValueError
        The error of the first capture, when none can be opened.
    """
    options = _opening(capture, run)
    jobs, refused, first = [], {}, None
    with progress(max(1, len(targets))) as begin:
        for target in targets:
            begin(f"opening {target.name}")
            try:
                source = _source(target.path, options)
                jobs.append((target, make_job(target, source.open(), source)))
            except AnotherRunError:
                raise
            except (OSError, ValueError) as error:
                if is_url(target.path) and isinstance(error, PermissionError):
                    raise  # credentials that fail concern all captures
                first = first or error
                refused[target.name] = error_message(error)
                if len(targets) > 1:
                    caution("failed", f"{target.name}: {refused[target.name]}")
    if not jobs and first is not None:
        raise first
    return jobs, refused


def _opening(capture: CaptureOptions, run: RunOptions) -> dict[str, Any]:
    """Return the options with which the workers open the captures."""
    if capture.counts_scale is not None or capture.trials is not None:
        raise ValueError("counts-scale, trials: are for one capture of counts, not for a run")
    options: dict[str, Any] = {
        "format": capture.format,
        "width": capture.width,
        "frames": parse_frame_range(capture.frame_range),
        "rotate": capture.rotate,
        "flip": capture.flip,
        "key": capture.key,
        "counts": capture.counts,
        "unpacked": capture.unpacked,
        "isolate": capture.isolate,
        "storage_options": run.storage_options(),
    }
    return {name: value for name, value in options.items() if value is not None}


def _source(path: str, options: dict[str, Any]) -> CaptureSource:
    """Return a capture as the workers open it."""
    if is_url(path):
        return CaptureSource.of(path, options)
    kept = {name: value for name, value in options.items() if name != "storage_options"}
    return CaptureSource.of(str(Path(path).absolute()), kept)


def reconstruction_job(
    target: Target,
    bits: Bits,
    source: CaptureSource,
    inputs: Inputs,
    run: RunOptions,
    depth: int,
    sensors: dict[Sensor, Sensor],
) -> Job:
    """Return the job that reconstructs a capture: a video if there are windows, else an image."""
    prepared = inputs.prepare_opened(bits, target.output, window=run.window, may_be_color=True)
    estimator = _estimator(prepared, inputs, sensors)
    facts = _method_facts(estimator, prepared, inputs)
    if run.window is not None:
        return _video_job(target, bits, source, run, estimator, facts)
    if target.output.suffix.lower() == _ZARR:
        raise ValueError(f"{target.output}: a .zarr holds images of windows; pass --window")
    image_writer(target.output, depth=depth)
    side = estimator.sensor.oversampling
    return ImageJob(
        target.name,
        source,
        len(bits),
        side,
        estimator,
        target.output,
        run_record(target.name, bits, source, **facts),
        4 * math.prod(_result_shape(bits, 1, estimator)),
        depth,
    )


def conversion_job(
    target: Target, bits: Bits, source: CaptureSource, run: RunOptions, to: str | None
) -> Job:
    """Return the job that converts a capture: to counts of windows, or to another format."""
    if run.window is not None:
        return _video_job(target, bits, source, run, None, {"method": "counts"})
    name = choose_output_format(target.output, to)
    record = run_record(target.name, bits, source, to=name)
    return ConversionJob(target.name, source, target.output, name, record, bits.packed.nbytes)


def _video_job(
    target: Target,
    bits: Bits,
    source: CaptureSource,
    run: RunOptions,
    estimator: Estimator | None,
    facts: dict[str, Any],
) -> VideoJob:
    assert run.window is not None, "a video"
    if target.output.suffix.lower() != _ZARR:
        raise ValueError(
            f"output: expected a name in {_ZARR} for images of windows, got {target.output}; "
            "`jotlight film` writes .mp4, .gif, .npy, and .tif"
        )
    step = run.step or run.window
    spans = Spans(run.window, step, len(windows(len(bits), run.window, run.step)))
    side = 1 if estimator is None else estimator.sensor.oversampling
    shape = _result_shape(bits, spans.number, estimator)
    dtype = "int32" if estimator is None else "float32"
    record = run_record(
        target.name,
        bits,
        source,
        window=run.window,
        step=step,
        values=dtype,
        **facts,
    )
    frame_bytes = bits.packed.nbytes // len(bits)
    if run.chunks is None:
        frames = max(_MIN_CHUNK, bits.packed.nbytes // _MAX_GROUPS) // frame_bytes
    else:
        frames = frames_per_chunk(bits.packed.shape, run.chunks)
    store = VideoStore(target.output, record, shape, dtype, max(1, frames // step))
    store = store.resumed()
    return VideoJob(target.name, source, spans, side, estimator, store)


def _result_shape(bits: Bits, number: int, estimator: Estimator | None) -> tuple[int, ...]:
    """Return the shape of a number of images: estimates, or counts of jots without a method."""
    side = 1 if estimator is None else estimator.sensor.oversampling
    _, height, width, *channels = bits.shape
    counts = number, height // side, width // side, *channels
    return counts if estimator is None else estimator.estimate_shape(counts)


def _estimator(job: Reconstruction, inputs: Inputs, sensors: dict[Sensor, Sensor]) -> Estimator:
    """Return the method as the workers run it. Captures of equal sensors share one object."""
    sensor = sensors.setdefault(job.captured.sensor, job.captured.sensor)
    check_countable(sensor)
    network = _own_network(job, inputs)
    if sensor.kernel != "box" and job.choice.quality is None and network is None:
        raise ValueError(
            f"kernel: expected box in a run over windows or captures, got {sensor.kernel}, for "
            "which counts are not enough; reconstruct one capture at a time without --window"
        )
    choice = job.choice
    settings = dict(job.settings)
    fallback = bool(settings.pop("fallback", False))
    named = settings.pop("demosaicing", None), settings.pop("precision", None)
    options = tuple(sorted(settings.items()))
    chosen = sensor, choice.method, choice.quality
    return checked(Estimator(*chosen, network, options, 1, fallback, *named))


def _own_network(job: Reconstruction, inputs: Inputs) -> Network | None:
    """Return the network of the user, or None."""
    if isinstance(job.method, ColorNetwork):
        raise ValueError(
            f"{inputs.method.model}: a color network runs on one capture at a time, without "
            "--window; leave out --model for the shipped one"
        )
    return None if inputs.method.model is None or isinstance(job.method, str) else job.method


def _method_facts(estimator: Estimator, job: Reconstruction, inputs: Inputs) -> dict[str, Any]:
    sensor, calibration = estimator.sensor, job.calibration
    return {
        "method": estimator.method,
        "options": job.settings,
        "weights_sha256": estimator.weights(inputs.method.model),
        "sensor": sensor.scalars(),
        "maps_sha256": maps_sha256(sensor),
        "calibration": calibration and {"file": calibration.name, "sha256": calibration.sha256},
    }


def _report(outcome: Outcome, targets: dict[str, Target], part: Part | None) -> None:
    made = len(outcome.made) + len(outcome.partial)
    share = "" if part is None else f" (part {part.number} of {part.total})"
    lines = [f"{made} made{share}"]
    if outcome.existed:
        lines.append(f"{len(outcome.existed)} complete before")
    if outcome.failed:
        lines.append(f"{len(outcome.failed)} failed")
    if len(targets) == 1 and outcome.made:
        result = targets[outcome.made[0]].output
        size = sum(file.stat().st_size for file in [result, *result.rglob("*")] if file.is_file())
        report(f"{result}: {format_bytes(size)}")
    report(f"{counted(len(targets), 'capture')}: {', '.join(lines)}")
    if outcome.partial:
        report("when all parts have ended, `jotlight gather` completes the results")
    if outcome.failed:
        shown = list(outcome.failed.items())[:_MAX_SHOWN]
        more = len(outcome.failed) - len(shown)
        text = "; ".join(f"{name}: {error}" for name, error in shown)
        share = f"{len(outcome.failed)} of {len(targets)} captures failed: "
        raise ValueError(
            ("" if len(targets) == 1 else share) + text + (f"; and {more} more" if more else "")
        )
