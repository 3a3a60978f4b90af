"""`jotlight reconstruct --window`: a film of sliding windows of frames."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.cli.console import out, progress
from jotlight.cli.output_options import UNITS, OutputOptions
from jotlight.estimators.brightness import BRIGHTNESS_QUANTILE
from jotlight.images.io import image_writer
from jotlight.images.video import video_writer, is_floats, windows
from jotlight.sensing.bits import Bits
from jotlight.sensing.sensor import Sensor


def check_film(wanted: OutputOptions, fps: float) -> None:
    """Raise ValueError for what cannot be asked of a film."""
    floats = is_floats(wanted.picture)
    for name in ("preview", "uncertainty"):
        if getattr(wanted, name) is not None:
            raise ValueError(f"{name}: is of one picture, not of the many windows of a film")
    if wanted.units != "intensity" and not floats:
        raise ValueError(f"units: are for floats, .npy, and {wanted.picture} is to look at")
    image_writer("a.npy" if wanted.picture.suffix else "a.png", depth=wanted.depth)
    if not 0 < fps < 1e4:
        raise ValueError(f"fps: expected pictures per second above 0, got {fps}")


def film(
    bits: Bits,
    sensor: Sensor,
    run: Callable[[Bits, Sensor], npt.NDArray[np.float32]],
    wanted: OutputOptions,
    *,
    window: int,
    step: int | None,
    fps: float,
    title: str,
) -> tuple[float, float]:
    """Reconstruct every window, one in memory at a time; `sensor` is that of a window.

    Gives the largest intensity of all, and how bright the brightest window is.
    """
    spans = windows(bits, window, step)
    floats = is_floats(wanted.picture)
    scale = wanted.scale(sensor)
    least, most, brightest = np.inf, 0.0, 0.0
    start = time.perf_counter()

    with progress(len(spans)) as begin:
        tone = None
        if not floats:
            begin("choosing the tone curve", 0)
            parts = some_windows(bits, window, step)
            tone = wanted.film_tone([run(part, sensor) for part in parts])
        with video_writer(
            wanted.picture, len(spans), tone=tone, fps=fps, depth=wanted.depth
        ) as add:
            for number, span in enumerate(spans):
                begin(f"window {number + 1} of {len(spans)}")
                picture = run(_part(bits, span), sensor)
                least, most = min(least, float(picture.min())), max(most, float(picture.max()))
                brightest = max(brightest, float(np.quantile(picture, BRIGHTNESS_QUANTILE)))
                add(picture * scale)
    size = " x ".join(map(str, picture.shape))
    how = UNITS[wanted.units] if tone is None else f"{tone.curve} curve, white at {tone.white:.3g}"
    left = len(bits) - spans[-1].stop
    seconds = time.perf_counter() - start
    out.print(
        f"{wanted.picture}: {len(spans)} picture{'s' * (len(spans) > 1)} of {size} from {window} "
        f"frame{'s' * (window > 1)} each, values "
        f"{scale * least:.3g} to {scale * most:.3g} ({how}), by {title} in {seconds:.3g} s"
        + (f"; {left} at the end in no window" if left else ""),
        soft_wrap=True,
        markup=False,
    )
    return most, brightest


def some_windows(bits: Bits, window: int, step: int | None) -> list[Bits]:
    """The first, the middle and the last window, which stand for all."""
    spans = windows(bits, window, step)
    return [_part(bits, spans[place]) for place in sorted({0, len(spans) // 2, len(spans) - 1})]


def _part(bits: Bits, span: slice) -> Bits:
    """A window's bits without the sensor they carry, which is not that of a window."""
    part = bits[span]
    return Bits(part.packed, part.width)


def refuse_existing_folder(output: Path) -> None:
    """Raise FileExistsError early when the folder of a film is there already."""
    if output.suffix == "" and output.exists():
        raise FileExistsError(f"cannot write {output}: it is there already; give another name")
