"""Drawing the bits of a sensor."""

from collections.abc import Iterator

import numpy as np

import jotlight as jl
from suite.case import Case, Rival

SETTINGS = {
    "exposure": {"oversampling": 4},
    "exposure-q2": {"oversampling": 4, "threshold": 2},
    "exposure-q5": {"oversampling": 4, "threshold": 5},
    "exposure-100": {"oversampling": 10},
    "exposure-frames": {"frames": 16},
    "exposure-cubic": {"oversampling": 4, "kernel": "cubic"},
    "exposure-cubic-frames": {"oversampling": 4, "frames": 4, "kernel": "cubic"},
    "exposure-one": {},
}
OPERATIONS = 7
"""Operations per jot: a byte of ChaCha with 8 rounds (6 operations), and a comparison."""

NUMPY = "NumPy, poisson(s) >= q"


def cases(quick: bool) -> Iterator[Case]:
    names = list(SETTINGS)[:1] if quick else list(SETTINGS)
    for name in names:
        yield case(name, jl.Sensor(**SETTINGS[name]))


def case(name: str, sensor: jl.Sensor) -> Case:
    side = 2048 // sensor.oversampling
    image = np.random.default_rng(0).uniform(0, 1, (side, side)).astype(np.float32)
    rate = sensor.rate(image)
    rates = np.broadcast_to(rate, (sensor.frames, *rate.shape))
    jots = sensor.trials * image.size
    out = np.empty_like(sensor.expose(image, 0).packed)
    rng = np.random.default_rng(1)

    def draw(threads: int) -> np.ndarray:
        return sensor.expose(image, 0, out=out, threads=threads).packed

    def draw_with_numpy() -> np.ndarray:
        return rng.poisson(rates) >= sensor.threshold

    def difference(packed: np.ndarray, drawn: np.ndarray) -> float:
        """Return the difference of the shares of ones in standard errors of NumPy's."""
        share = drawn.mean()
        mine = np.bitwise_count(packed).sum(dtype=np.int64) / jots
        return float(abs(mine - share) / np.sqrt(share / drawn.size))

    return Case(
        name=name,
        title=f"Drawing bits, `{sensor!r}`",
        description=f"{jots:,} jots, intensities uniform in [0, 1]. NumPy takes s as its input.",
        items=jots,
        unit="jots",
        run=draw,
        rivals=[Rival(NUMPY, lambda _: draw_with_numpy)],
        difference=difference,
        agreement="difference of the shares of ones, in standard errors",
        tolerance=6,
        operations=OPERATIONS * jots,
        bytes=jots / 8,
        operations_note="bits are written; each jot takes a byte of ChaCha with 8 rounds, which is "
        "6 operations, and a comparison",
    )
