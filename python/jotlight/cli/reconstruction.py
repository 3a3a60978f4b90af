"""One reconstruction: its data, its method, and the files to write."""

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np

from jotlight.cli.applied_calibration import AppliedCalibration, recorded
from jotlight.cli.captured import Captured
from jotlight.cli.console import live_iterations, progress, report
from jotlight.cli.output_options import UNITS, OutputOptions
from jotlight.estimators.brightness import BRIGHTNESS_QUANTILE
from jotlight.estimators.problem import ConvergenceHistories
from jotlight.evaluation.methods import METHODS, Choice, Run


@dataclasses.dataclass(frozen=True)
class Reconstruction:
    """All that determines an estimate and its files."""

    path: Path
    captured: Captured
    choice: Choice
    run: Run
    settings: dict[str, Any]
    """Keyword arguments of the method."""
    outputs: OutputOptions
    calibration: AppliedCalibration | None

    @property
    def record_arguments(self) -> tuple[Any, ...]:
        """Arguments of the function that :func:`recorded` yields."""
        captured = self.captured
        return captured.sensor, self.choice.method, self.path.name, captured.provenance


@dataclasses.dataclass(frozen=True)
class Brightness:
    """Largest value of an estimate, and its brightness without the brightest 0.1 %."""

    maximum: float
    quantile: float


def reconstruct_image(job: Reconstruction, threads: int | None) -> Brightness:
    """Write and report the estimate of one image and return its brightness."""
    captured, outputs = job.captured, job.outputs
    ending = ""
    with outputs.temporary_files() as files, recorded(job.calibration) as record:
        start = time.perf_counter()
        run, title = job.run, job.choice.title
        if job.choice.method in METHODS and METHODS[job.choice.method].iterative:
            with live_iterations(title) as callback:
                estimate, histories = run(
                    captured.data,
                    captured.sensor,
                    threads=threads,
                    callback=callback,
                    return_history=True,
                    **job.settings,
                )
            ending = f" ({_describe_convergence(histories)})"
        else:
            with progress(None) as begin:
                begin(title)
                estimate = run(captured.data, captured.sensor, threads=threads, **job.settings)
        seconds = time.perf_counter() - start
        metadata = outputs.metadata(captured.sensor, title, captured.provenance)
        outputs.write(
            files, estimate, captured, white=job.choice.white, metadata=metadata, threads=threads
        )
        record(*job.record_arguments)
    scale = outputs.scale(captured.sensor)
    units = "intensities" if outputs.units == "intensity" else UNITS[outputs.units]
    report(
        f"{outputs.output}: {' x '.join(map(str, estimate.shape))}, {units} "
        f"{scale * estimate.min():.3g} to {scale * estimate.max():.3g}, by {title}{ending} in "
        f"{seconds:.3g} s"
    )
    if outputs.preview is not None:
        report(f"{outputs.preview}: image for display")
    if outputs.uncertainty is not None:
        report(f"{outputs.uncertainty}: confidence intervals of {outputs.level:g}")
    return Brightness(float(estimate.max()), float(np.quantile(estimate, BRIGHTNESS_QUANTILE)))


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
