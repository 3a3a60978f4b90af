"""`jotlight reconstruct --window`: a film of sliding windows of frames."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from jotlight.bits import Bits
from jotlight.cli.console import out, progress
from jotlight.cli.output import UNITS, Wanted
from jotlight.film import film_writer, is_floats, windows
from jotlight.pictures import picture_writer
from jotlight.sensor import Sensor

_LOOKED_AT = 3
"""Windows from whose pictures the tone curve is chosen."""


def check_film(wanted: Wanted, fps: float) -> None:
    """Raise ValueError for what cannot be asked of a film."""
    floats = is_floats(wanted.picture)
    for name in ("preview", "uncertainty"):
        if getattr(wanted, name) is not None:
            raise ValueError(f"{name}: is of one picture, not of the many windows of a film")
    if wanted.units != "intensity" and not floats:
        raise ValueError(f"units: are for floats, .npy, and {wanted.picture} is to look at")
    picture_writer("a.npy" if wanted.picture.suffix else "a.png", depth=wanted.depth)
    if not 0 < fps < 1e4:
        raise ValueError(f"fps: expected pictures per second above 0, got {fps}")


def film(
    bits: Bits,
    sensor: Sensor,
    run: Callable[[Bits, Sensor], npt.NDArray[np.float32]],
    wanted: Wanted,
    *,
    window: int,
    step: int | None,
    fps: float,
    title: str,
) -> float:
    """Reconstruct every window, one in memory at a time; `sensor` is that of a window.

    Gives the largest intensity of all.
    """
    spans = windows(bits, window, step)
    floats = is_floats(wanted.picture)
    scale = wanted.scale(sensor)
    least, most = np.inf, 0.0
    start = time.perf_counter()

    def picture_of(span: slice) -> npt.NDArray[np.float32]:
        part = bits[span]
        return run(Bits(part.packed, part.width), sensor)

    with progress(len(spans)) as begin:
        tone = None
        if not floats:
            begin("choosing the tone curve", 0)
            some = sorted({0, len(spans) // 2, len(spans) - 1})[:_LOOKED_AT]
            tone = wanted.film_tone([picture_of(spans[place]) for place in some])
        with film_writer(wanted.picture, len(spans), tone=tone, fps=fps, depth=wanted.depth) as add:
            for number, span in enumerate(spans):
                begin(f"window {number + 1} of {len(spans)}")
                picture = picture_of(span)
                least, most = min(least, float(picture.min())), max(most, float(picture.max()))
                add(picture * scale)
    size = " x ".join(map(str, picture.shape))
    how = UNITS[wanted.units] if tone is None else f"{tone.curve} curve, white at {tone.white:.3g}"
    left = len(bits) - spans[-1].stop
    seconds = time.perf_counter() - start
    out.print(
        f"{wanted.picture}: {len(spans)} pictures of {size} from {window} frames each, values "
        f"{scale * least:.3g} to {scale * most:.3g} ({how}), by {title} in {seconds:.3g} s"
        + (f"; the last {left} frames fill no window" if left else ""),
        soft_wrap=True,
        markup=False,
    )
    return most


def spare_folder(output: Path) -> None:
    """Raise FileExistsError early when the folder of a film is there already."""
    if output.suffix == "" and output.exists():
        raise FileExistsError(f"cannot write {output}: it is there already; give another name")
