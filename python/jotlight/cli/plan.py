"""`jotlight plan`: how many frames are enough."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from jotlight.calibration import Calibration
from jotlight.cli import sensor_options
from jotlight.cli.console import out
from jotlight.estimators.planning import Plan
from jotlight.estimators.planning import plan as expect
from jotlight.files import atomic_write, refuse_overwrite
from jotlight.sensing.sensor import Sensor

_ROWS = 13
"""Of the table, each for twice the frames of the one before."""


@sensor_options.takes_sensor()
def plan(
    light: Annotated[
        str,
        typer.Argument(
            help="Photons per jot and frame (per second with --frame-rate): LEAST:MOST of the "
            "scene, such as 0.01:1, or one number."
        ),
    ],
    *,
    frame_rate: Annotated[
        float | None, typer.Option(help="Frames per second; the light then is per second.")
    ] = None,
    target: Annotated[
        float | None, typer.Option(help="A PSNR in dB: tells how many frames are enough.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="A figure: .png, .pdf, .svg or .jpg.")] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Threshold and dark counts of the median jot, from `jotlight calibrate`.",
            rich_help_panel="Sensor",
        ),
    ] = None,
    given: dict[str, Any],
    inputs: list[Path],
) -> None:
    """Tell how good maximum likelihood will be, by the number of frames.

    --frames is the last row of the table. PSNR is that of a scene whose light is spread evenly from
    the least to the most, with the most for its peak. SNR is the light over the error of the
    estimate; in brackets the Cramér-Rao bound, the best of any unbiased estimate.
    """
    if frame_rate is not None and not 0 < frame_rate < float("inf"):
        raise ValueError(f"frame-rate: expected frames per second above 0, got {frame_rate}")
    least, most = _range(light)
    if plot is not None:
        from jotlight.plots import check_figure

        check_figure(plot)
        refuse_overwrite(plot, [calibration, *inputs])
    per_frame = (least / (frame_rate or 1), most / (frame_rate or 1))
    numbers = {name: value for name, value in given.items() if name != "max_intensity"}
    if calibration is None:
        sensor = Sensor(**numbers)
    else:
        # Its response is relative, and the light is that of a jot like the median one.
        sensor = Calibration.load(calibration).sensor(**{"efficiency": 1.0, **numbers})
    last = given.get("frames", 2 ** (_ROWS - 1))
    expected = expect(
        sensor,
        per_frame,
        frames=_numbers(last),
        target_psnr=target,
        max_intensity=given.get("max_intensity"),
    )
    out.print(_table(expected, frame_rate))
    for line in _words(expected, frame_rate):
        out.print(line, soft_wrap=True, markup=False)
    if plot is not None:
        from jotlight.plots import expectation

        with atomic_write(plot) as temporary:
            expectation(expected).savefig(temporary, dpi=150)
        out.print(f"Figure: [bold]{plot}[/]", soft_wrap=True)


def _range(text: str) -> tuple[float, float]:
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not 0 < numbers[0] <= numbers[-1] < float("inf"):
        raise ValueError(
            f"light: expected LEAST:MOST in photons, above 0, such as 0.01:1, got {text!r}"
        )
    return numbers[0], numbers[-1]


def _numbers(last: int) -> list[int]:
    """The powers of two up to a number of frames, and that number."""
    if last < 1:
        raise ValueError(f"frames: expected 1 or more, got {last}")
    powers = [2**n for n in range(last.bit_length()) if 2**n < last]
    return [*powers, last][-_ROWS:]


def _table(expected: Plan, frame_rate: float | None) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("frames", justify="right")
    if frame_rate is not None:
        table.add_column("seconds", justify="right")
    table.add_column("PSNR", justify="right")
    number = len(expected.light)
    places = sorted({0, number // 2, number - 1})
    scale = frame_rate or 1
    for place in places:
        table.add_column(f"SNR at {expected.light[place] * scale:.3g}", justify="right")
    table.add_column("saturates", justify="right")
    for row, frames in enumerate(expected.frames):
        time = [] if frame_rate is None else [f"{frames / frame_rate:.3g}"]
        snr = [
            f"{expected.snr[row, place]:.1f} ({expected.snr_bound[row, place]:.1f})"
            for place in places
        ]
        table.add_row(
            str(frames),
            *time,
            f"{expected.psnr[row]:.1f}",
            *snr,
            f"{expected.saturation_light[row] * scale:.3g}",
        )
    return table


def _words(expected: Plan, frame_rate: float | None) -> list[str]:
    unit = "photons per jot and " + ("frame" if frame_rate is None else "second")
    scale = frame_rate or 1
    words = [
        f"In dB, light in {unit}. A bit tells most at {expected.optimal_light * scale:.3g}; where "
        "saturation begins, 1 % of the pixels have every bit at 1.",
        "For maximum likelihood, pixel by pixel: methods that look at neighbours need fewer "
        "frames, how many depends on the scene.",
    ]
    if expected.target_psnr is None:
        return words
    if expected.required_frames is None:
        return [
            *words,
            f"A PSNR of {expected.target_psnr:g} dB is not reached with 2**31 bits a pixel.",
        ]
    seconds = "" if frame_rate is None else f" ({expected.required_frames / frame_rate:.3g} s)"
    plural = "" if expected.required_frames == 1 else "s"
    verb = "is" if expected.required_frames == 1 else "are"
    return [
        *words,
        f"{expected.required_frames} frame{plural}{seconds} {verb} enough for a PSNR of "
        f"{expected.target_psnr:g} dB.",
    ]
