"""``jotlight plan``: the number of frames that a quality takes."""

import dataclasses
import re
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.table import Table

from jotlight.calibration import Calibration
from jotlight.cli.options.sensor_options import PlannedSensorOptions
from jotlight.cli.terminal.console import out, report
from jotlight.errors import counted, plural
from jotlight.estimators.planning.planned_motion import MAX_SUM, MIN_FRAMES, MotionPlan
from jotlight.estimators.planning.planning import Plan
from jotlight.estimators.planning.planning import plan as predict
from jotlight.files import check_outputs
from jotlight.formats.images.maps import is_map
from jotlight.motion.cost import motion_cost
from jotlight.sensing.sensor import Sensor

_ROWS = 13
"""Maximum number of rows. Each row has twice the frames of the row above."""


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """What to predict."""

    frame_rate: Annotated[
        float | None,
        Parameter(
            help="Frames per second. The light is then per second. Default: it is per frame."
        ),
    ] = None
    target_psnr: Annotated[
        float | None,
        Parameter(help="A PSNR in dB. A line states how many frames reach it. Default: none."),
    ] = None
    size: Annotated[
        str,
        Parameter(help="Height and width in jots, for --speed, and for the cost of --motion."),
    ] = "256x512"
    speed: Annotated[
        float | None,
        Parameter(
            help="Speed of the scene in pixels per frame (per second with --frame-rate). The last "
            "lines state how many frames help. Default: none."
        ),
    ] = None
    plot: Annotated[
        Path | None, Parameter(help="A figure, .png, .pdf, .svg, or .jpg. Default: none.")
    ] = None

    def check(self, sensor: PlannedSensorOptions) -> None:
        """Raise ValueError or OSError for options that do not belong together."""
        rate = self.frame_rate
        if rate is not None and not 0 < rate < float("inf"):
            raise ValueError(f"frame-rate: expected frames per second above 0, got {rate}")
        if sensor.exposure_time is not None:
            raise ValueError("exposure-time: for light per second, state --frame-rate instead")
        for name in ("gain", "threshold"):
            text = getattr(sensor, name)
            if text is not None and ("," in text or is_map(text)):
                raise ValueError(
                    f"{name}: expected one number for all readings, got {text}; in Python, "
                    "jotlight.plan_brackets finds exposures that differ"
                )
        # A gain changes only what --max-intensity means.
        if sensor.gain is not None and sensor.max_intensity is None:
            raise ValueError(
                "gain: has no effect, because the light is in photons per jot; leave it out"
            )
        if self.plot is not None:
            from jotlight.plots import check_figure

            check_figure(self.plot)
            check_outputs([self.plot], [sensor.calibration, *sensor.map_files()])


def plan(
    light: Annotated[
        str,
        Parameter(
            help="Photons per jot and frame (per second with --frame-rate): MIN:MAX of the scene, "
            "such as 0.01:1, or one number. With a calibration, but without --efficiency, those "
            "that the median jot detects."
        ),
    ],
    /,
    *,
    options: PlanOptions = PlanOptions(),
    sensor: PlannedSensorOptions = PlannedSensorOptions(),
) -> None:
    """Predict the quality of maximum likelihood for numbers of frames, and the cost of --motion.

    The rows of the table are numbers of frames, up to --frames. The light of the scene is uniformly
    distributed between the minimum and the maximum, which is the peak of the PSNR. SNR is the light
    divided by the error of the estimate. The number in parentheses is the Cramér-Rao bound, the
    highest SNR of any unbiased estimate. With --speed, the last lines are for a typical photograph
    after denoising, and not for single pixels.
    """
    options.check(sensor)
    minimum, maximum = _light_range(light)
    height, width = _size(options.size)
    # The predictions are about frames.
    rate = options.frame_rate or 1
    planned, max_frames = _planned_sensor(sensor)
    predicted = predict(
        planned,
        (minimum / rate, maximum / rate),
        frames=_frame_numbers(max_frames),
        target_psnr=options.target_psnr,
        max_intensity=sensor.max_intensity,
        speed=None if options.speed is None else options.speed / rate,
        size=(max(1, height // planned.oversampling), max(1, width // planned.oversampling)),
    )
    out.print(_table(predicted, options.frame_rate))
    report(
        *_explanation(predicted, planned, options.frame_rate),
        _motion_line(max_frames, (height, width)),
    )
    if predicted.motion is not None:
        report(*_motion_lines(predicted.motion))
    if options.plot is not None:
        from jotlight.plots import save_figure

        save_figure(predicted.plot(), options.plot, dpi=150)
        report(f"Figure: {options.plot}")


def _planned_sensor(options: PlannedSensorOptions) -> tuple[Sensor, int]:
    """Return the sensor, and the largest number of frames."""
    parameters = options.to_kwargs()
    parameters.pop("max_intensity", None)
    max_frames = parameters.get("frames", 2 ** (_ROWS - 1))
    if options.calibration is None:
        return Sensor(**parameters), max_frames
    # A plan is for the light behind the filters.
    calibration = Calibration.load(options.calibration)
    return calibration.sensor(**{"mosaic": None, **parameters}), max_frames


def _light_range(text: str) -> tuple[float, float]:
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not 0 < numbers[0] <= numbers[-1] < float("inf"):
        raise ValueError(
            "light: expected photons from the darkest to the brightest point as MIN:MAX, such as "
            f"0.01:1, or one number, above 0, got {text!r}"
        )
    return numbers[0], numbers[-1]


def _size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text.strip(), re.ASCII)
    if match is None or min(int(match[1]), int(match[2])) < 1:
        raise ValueError(f"size: expected HEIGHTxWIDTH in jots, such as 256x512, got {text!r}")
    return int(match[1]), int(match[2])


def _motion_line(frames: int, size: tuple[int, int]) -> str:
    """Return what aligning the frames costs."""
    cost = motion_cost(frames, size)
    return (
        f"If the scene moves, --motion takes about {cost.seconds:.2g} s on one thread and "
        f"{cost.memory / 1e6:.0f} MB for {counted(frames, 'frame')} of "
        f"{size[0]} x {size[1]} jots, and {cost.further_seconds:.2g} s for each further image of a "
        "film. That is for a scene that moves as a whole; parts that move differently take longer."
    )


def _motion_lines(motion: MotionPlan) -> list[str]:
    """Return how many frames help if the scene moves."""
    per_frame = f"At {motion.speed:.3g} pixels per frame"
    if motion.speed == 0:
        return ["At rest, all frames help."]
    if motion.best_sum == MAX_SUM < motion.frames_in_view:
        best = f"{MAX_SUM:,} or more frames is best."
    else:
        best = f"{_count(motion.best_sum)} is best; longer sums are worse, because of blur."
    lines = [f"{per_frame}, without alignment, the sum of {best}"]
    error = f"the displacements have an error of {motion.registration_error:.2g} pixels"
    in_view = f"beyond {_count(motion.frames_in_view)} nothing of the image is in view"
    if motion.frames_in_view < MIN_FRAMES:
        return [
            *lines,
            f"The scene is too fast for --motion, which needs {MIN_FRAMES} frames or "
            f"more: {in_view}.",
        ]
    if motion.best_aligned is None:
        return [*lines, f"There is too little light for --motion at this speed: {error}."]
    if motion.best_aligned == motion.frames_in_view:
        return [*lines, f"With --motion, all frames help that show the image: {in_view}; {error}."]
    return [
        *lines,
        f"With --motion, up to {_count(motion.best_aligned)} help; twice as many gain less than "
        f"0.1 dB, and {in_view}; {error}.",
    ]


def _count(frames: int) -> str:
    return f"{frames:,} {plural(frames, 'frame')}"


def _frame_numbers(max_frames: int) -> list[int]:
    """Return the largest powers of two below a number of frames, and that number."""
    if max_frames < 1:
        raise ValueError(f"frames: expected 1 or more, got {max_frames}")
    powers = [2**n for n in range(max_frames.bit_length()) if 2**n < max_frames]
    return [*powers, max_frames][-_ROWS:]


def _table(predicted: Plan, frame_rate: float | None) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("frames", justify="right")
    if frame_rate is not None:
        table.add_column("seconds", justify="right")
    table.add_column("PSNR", justify="right")
    number = len(predicted.light)
    columns = sorted({0, number // 2, number - 1})
    scale = frame_rate or 1
    for column in columns:
        table.add_column(f"SNR at {predicted.light[column] * scale:.3g}", justify="right")
    table.add_column("saturates", justify="right")
    for row, frames in enumerate(predicted.frames):
        time = [] if frame_rate is None else [f"{frames / frame_rate:.3g}"]
        snr = [
            f"{predicted.snr[row, column]:.1f} ({predicted.snr_bound[row, column]:.1f})"
            for column in columns
        ]
        saturation = f"{predicted.saturation_light[row] * scale:.3g}"
        table.add_row(str(frames), *time, f"{predicted.psnr[row]:.1f}", *snr, saturation)
    return table


def _explanation(predicted: Plan, sensor: Sensor, frame_rate: float | None) -> list[str]:
    unit = "photons per jot and " + ("frame" if frame_rate is None else "second")
    scale, largest = frame_rate or 1, 2**sensor.bit_depth - 1
    noun, rest = ("bit", "") if largest == 1 else ("reading", ", the largest number")
    lines = [
        f"In dB, light in {unit}. A {noun} carries most information at "
        f"{predicted.optimal_light * scale:.3g}. At the light in the column 'saturates', 1 % of "
        f"the pixels have every {noun} at {largest}{rest}.",
        "The table is for maximum likelihood, pixel by pixel. Methods that use neighboring pixels "
        "need fewer frames. How many depends on the scene.",
    ]
    target, frames = predicted.target_psnr, predicted.required_frames
    if target is None:
        return lines
    if frames is None:
        return [*lines, f"2**31 trials per pixel do not reach a PSNR of {target:g} dB."]
    seconds = "" if frame_rate is None else f" ({frames / frame_rate:.3g} s)"
    noun, verb = ("frame", "is") if frames == 1 else ("frames", "are")
    enough = f"{frames} {noun}{seconds} of a scene that stands still {verb} enough"
    return [*lines, f"{enough} for a PSNR of {target:g} dB."]
