"""Drawing bits."""

from collections.abc import Iterator

import numpy as np

import jotlight as jl
from suite.case import Case, Rival

SETTINGS = {
    "sampling": {"oversampling": 4},
    "sampling-q2": {"oversampling": 4, "threshold": 2},
    "sampling-q5": {"oversampling": 4, "threshold": 5},
    "sampling-100": {"oversampling": 10},
    "sampling-frames": {"frames": 16},
    "sampling-cubic": {"oversampling": 4, "kernel": "cubic"},
    "sampling-cubic-frames": {"oversampling": 4, "frames": 4, "kernel": "cubic"},
    "sampling-one": {},
}
SLOTS = 13
"""Of a jot: half a word of ChaCha with 8 rounds, 25 operations, and a comparison of 16 bits."""


def cases(quick: bool) -> Iterator[Case]:
    names = list(SETTINGS)[:1] if quick else list(SETTINGS)
    for name in names:
        yield case(name, jl.Sensor(**SETTINGS[name]))


def case(name: str, sensor: jl.Sensor) -> Case:
    side = 2048 // sensor.oversampling
    image = np.random.default_rng(0).uniform(0, 1, (side, side)).astype(np.float32)
    rate = sensor.rate(image)
    rates = np.broadcast_to(rate, (sensor.frames, *rate.shape))
    jots = sensor.bits_per_pixel * image.size
    out = np.empty_like(sensor.expose(image, 0).packed)
    rng = np.random.default_rng(1)

    def ours(threads: int) -> np.ndarray:
        return sensor.expose(image, 0, out=out, threads=threads).packed

    def theirs() -> np.ndarray:
        return rng.poisson(rates) >= sensor.threshold

    def difference(packed: np.ndarray, drawn: np.ndarray) -> float:
        """Ones of both, in standard errors of NumPy's."""
        share = drawn.mean()
        mine = np.bitwise_count(packed).sum(dtype=np.int64) / jots
        return float(abs(mine - share) / np.sqrt(share / drawn.size))

    return Case(
        name=name,
        title=f"Drawing bits, `{sensor!r}`",
        words=f"{jots:,} jots, intensities uniform in [0, 1]; NumPy is given s.",
        items=jots,
        unit="jots",
        ours=ours,
        rivals=[Rival("NumPy, poisson(s) >= q", lambda _: theirs)],
        difference=difference,
        agreement="difference of the shares of ones, in standard errors",
        tolerance=6,
        slots=SLOTS * jots,
        bytes=jots / 8,
        counted="bits written; for each jot half a word of ChaCha with 8 rounds, which takes 25 "
        "operations, and a comparison",
    )
