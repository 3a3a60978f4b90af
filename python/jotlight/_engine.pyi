from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = [
    "DEBUG_BUILD",
    "__version__",
    "add_block_counts",
    "algebraic_inverse",
    "block_sums",
    "equivalent_counts",
    "errors",
    "exact_inverse",
    "expose",
    "forward",
    "gradient",
    "kernel_taps",
    "mle_from_counts",
    "mle_from_jots",
    "mle_from_probability",
    "normal_equations",
    "probability",
    "rate",
    "stabilise",
    "threshold_probability",
    "threshold_rate",
]

__version__: str
DEBUG_BUILD: bool

_Floats: TypeAlias = npt.NDArray[np.floating]
_Image: TypeAlias = npt.NDArray[np.float32] | npt.NDArray[np.float64]
_Layer: TypeAlias = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], float, float]
_AnyLayer: TypeAlias = tuple[_Floats, _Floats, float, float]
_Response: TypeAlias = tuple[int, float, float]
_Span: TypeAlias = tuple[int, int]

def add_block_counts(
    packed: npt.NDArray[np.uint8],
    width: int,
    side: int,
    valid: npt.NDArray[np.uint8] | None,
    counts: npt.NDArray[np.int32],
    threads: int | None,
) -> None: ...
def expose(
    sensor: dict[str, Any],
    image: _Image,
    seed: bytes,
    channel: int,
    frames: _Span,
    rows: _Span,
    columns: _Span,
    out: npt.NDArray[np.uint8],
    threads: int | None,
) -> None: ...
def rate(
    sensor: dict[str, Any],
    image: _Image,
    first: int,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def probability(
    sensor: dict[str, Any],
    image: _Image,
    first: int,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def kernel_taps(degree: int, oversampling: int) -> list[float]: ...
def threshold_probability(threshold: int, rate: float) -> float: ...
def threshold_rate(threshold: int, probability: float) -> float: ...
def mle_from_counts(
    sensor: _Response,
    counts: npt.NDArray[np.int32],
    trials: int | npt.NDArray[np.int32],
    dark: float | npt.NDArray[np.float64],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def mle_from_probability(
    sensor: _Response,
    probability: npt.NDArray[np.float32],
    dark: float,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def mle_from_jots(
    sensor: _Response,
    ones: npt.NDArray[np.int32],
    dark: npt.NDArray[np.float32],
    dead: npt.NDArray[np.bool_] | None,
    frames: int,
    side: int,
    width: int,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def equivalent_counts(
    sensor: _Response,
    counts: npt.NDArray[np.int32],
    trials: int | npt.NDArray[np.int32],
    dark: float | npt.NDArray[np.float64],
    bits: int,
    reference: float,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def stabilise(
    counts: npt.NDArray[np.float32], bits: int, out: npt.NDArray[np.float32], threads: int | None
) -> None: ...
def algebraic_inverse(
    z: npt.NDArray[np.float32], bits: int, out: npt.NDArray[np.float32], threads: int | None
) -> None: ...
def exact_inverse(
    z: npt.NDArray[np.float32], bits: int, out: npt.NDArray[np.float32], threads: int | None
) -> None: ...
def block_sums(
    layer: _Layer,
    packed: npt.NDArray[np.uint8],
    width: int,
    valid: npt.NDArray[np.uint8] | None,
    threads: int | None,
) -> npt.NDArray[np.float32]: ...
def errors(
    layers: list[_AnyLayer], batch: dict[str, Any], threads: int | None
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]: ...
def gradient(
    layers: list[_AnyLayer], batch: dict[str, Any], threads: int | None
) -> tuple[tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]], npt.NDArray[np.float64]]: ...
def normal_equations(
    layers: list[_AnyLayer], batch: dict[str, Any], threads: int | None
) -> tuple[
    tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
]: ...
def forward(
    layers: list[_Layer], sums: npt.NDArray[np.float32], threads: int | None
) -> npt.NDArray[np.float32]: ...
