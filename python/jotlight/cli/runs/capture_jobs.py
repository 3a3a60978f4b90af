"""The job of each capture of a run: a video, an image, or a copy in another format."""

import dataclasses
import math
from pathlib import Path
from typing import Any

from jotlight.chunks import windows
from jotlight.cli.captures.captured import provenance_notes
from jotlight.cli.options.output_options import ImageOutputOptions
from jotlight.cli.options.run_options import RunOptions
from jotlight.cli.reconstruction.inputs import Inputs, Reconstruction
from jotlight.cli.reconstruction.reconstruction import assumptions
from jotlight.evaluation.records.records import maps_sha256
from jotlight.formats.writing import choose_output_format
from jotlight.images.io import image_writer
from jotlight.networks.planes_network import ColorNetwork
from jotlight.runs.capture_source import CaptureSource
from jotlight.runs.estimator import Estimator, check_countable, checked
from jotlight.runs.jobs import (
    ConversionJob,
    ImageJob,
    Job,
    VideoJob,
    run_record,
)
from jotlight.runs.spans import Spans
from jotlight.runs.store import VideoStore
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.bits.lazy import frames_per_chunk
from jotlight.sensing.sensor import Sensor

_MIN_CHUNK = 1 << 27
"""Default size in bytes of the part of a capture that is computed at a time."""

_MAX_GROUPS = 1024
"""Number of parts of a large capture by default. So the scheduler has few tasks for any size."""

_ZARR = ".zarr"


@dataclasses.dataclass(frozen=True)
class Target:
    """One capture of a run."""

    path: str
    name: str
    output: Path
    number: int


def check_video_name(output: Path) -> None:
    """Raise ValueError unless the name of an output, or a pattern of names, is that of a video."""
    if output.suffix.lower() != _ZARR:
        raise ValueError(
            f"output: expected a name that ends in {_ZARR} for images of windows, got {output}; "
            "`jotlight film` writes .mp4, .gif, .npy, and .tif"
        )


def check_image_name(output: Path, depth: int) -> None:
    """Raise ValueError unless the name of an output, or the pattern of names, is that of an image.

    The image must also be able to have the depth.
    """
    if output.suffix.lower() == _ZARR:
        raise ValueError(f"{output}: a .zarr holds images of windows; pass --window")
    image_writer(output, depth=depth)


def reconstruction_job(
    target: Target,
    bits: Bits,
    source: CaptureSource,
    inputs: Inputs,
    run: RunOptions,
    outputs: ImageOutputOptions,
    sensors: dict[Sensor, Sensor],
) -> tuple[Job, list[str]]:
    """Return the job that reconstructs a capture: a video if there are windows, else an image.

    Also return what it assumes, one line each.
    """
    prepared = inputs.prepare_opened(
        bits, target.output, window=run.window, step=run.step, may_be_color=True
    )
    estimator = _estimator(prepared, inputs, sensors)
    facts = _method_facts(estimator, prepared, inputs)
    if run.window is not None:
        return _video_job(target, bits, source, run, estimator, facts), assumptions(prepared)
    side = estimator.sensor.oversampling
    # Results of the same run have the same requested curve and white.
    shown = {"curve": outputs.curve, "white": outputs.white}
    facts |= {name: value for name, value in shown.items() if value is not None}
    job = ImageJob(
        name=target.name,
        capture=source,
        frames=len(bits),
        oversampling=side,
        estimator=estimator,
        output=target.output,
        run=run_record(target.name, bits, source, **facts),
        nbytes=4 * math.prod(_result_shape(bits, 1, estimator)),
        depth=outputs.depth,
        curve=outputs.curve,
        white=outputs.stated_white(prepared.white),
    )
    return job, assumptions(prepared)


def conversion_job(
    target: Target, bits: Bits, source: CaptureSource, run: RunOptions, to: str | None
) -> tuple[Job, list[str]]:
    """Return the job that converts a capture: to counts of windows, or to another format.

    Also return what was assumed about the file, one line each.
    """
    notes = provenance_notes(bits.provenance)
    if run.window is not None:
        return _video_job(target, bits, source, run, None, {"method": "counts"}), notes
    name = choose_output_format(target.output, to)
    record = run_record(target.name, bits, source, to=name)
    size = bits.packed.nbytes
    return ConversionJob(target.name, source, target.output, name, record, size), notes


def _video_job(
    target: Target,
    bits: Bits,
    source: CaptureSource,
    run: RunOptions,
    estimator: Estimator | None,
    facts: dict[str, Any],
) -> VideoJob:
    assert run.window is not None, "a video"
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
    _refuse_color_network(job, inputs)
    return checked(Estimator(sensor, job.request.with_threads(1), job.choice))


def _refuse_color_network(job: Reconstruction, inputs: Inputs) -> None:
    """Raise ValueError if the network of the user is a color network."""
    if isinstance(job.request.method, ColorNetwork):
        raise ValueError(
            f"{inputs.method.model}: a color network reconstructs each capture by itself, as "
            "a whole; leave out --model for the pretrained one"
        )


def _method_facts(estimator: Estimator, job: Reconstruction, inputs: Inputs) -> dict[str, Any]:
    sensor, calibration = estimator.sensor, job.calibration
    return {
        "method": estimator.choice.method,
        "options": job.request.settings(),
        "model": inputs.method.model and inputs.method.model.name,
        "weights_sha256": estimator.weights(inputs.method.model),
        "sensor": sensor.scalars(),
        "maps_sha256": maps_sha256(sensor),
        "calibration": calibration and {"file": calibration.name, "sha256": calibration.sha256},
    }
