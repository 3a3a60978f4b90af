from typing import Any, TypeAlias, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "DEBUG_BUILD",
    "Layer",
    "__version__",
    "activate",
    "activate_backward",
    "add_block_counts",
    "algebraic_inverse",
    "choose_cpu_level",
    "cpu_level",
    "cpu_levels",
    "differences",
    "differences_adjoint",
    "equivalent_counts",
    "exact_inverse",
    "expose",
    "forward",
    "forward_bits",
    "forward_counts",
    "gradient",
    "input_rows",
    "kernel_taps",
    "likelihood_information",
    "likelihood_proximal",
    "likelihood_slopes",
    "likelihood_split",
    "log_likelihood",
    "masked_sums",
    "mle_from_counts",
    "mle_from_jots",
    "mle_from_probability",
    "multiply_adds",
    "normal_equations",
    "probability",
    "rate",
    "read_words",
    "shrink",
    "spread_adjoint",
    "spread_forward",
    "spread_normal",
    "squared_errors",
    "stabilise",
    "threshold_probability",
    "threshold_rate",
    "total_variation",
    "variation_split",
]

__version__: str
DEBUG_BUILD: bool

_Floats: TypeAlias = npt.NDArray[np.floating]
_Image: TypeAlias = npt.NDArray[np.float32] | npt.NDArray[np.float64]
# (stride, upsampling, input, skip). `input` is the index of the layer that this one reads, or None
# for the previous one. `skip` is the index of the layer whose output it adds, or None.
_Wiring: TypeAlias = tuple[int, int, int | None, int | None]
# (filters, spline coefficients, first knot, knot spacing, wiring)
_Layer: TypeAlias = tuple[_Floats, _Floats | None, float, float, _Wiring]
_Response: TypeAlias = tuple[int, float, float]
_Span: TypeAlias = tuple[int, int]
_Floats64: TypeAlias = float | npt.NDArray[np.float64]
_Jots: TypeAlias = tuple[_Floats64, _Floats64]
_Seen: TypeAlias = tuple[
    int, npt.NDArray[np.int32], int | npt.NDArray[np.int32], _Floats64, _Floats64
]
_Step: TypeAlias = tuple[float, float]
_Spread: TypeAlias = tuple[tuple[int, int], tuple[int, int], float]

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
    jots: _Jots,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def mle_from_probability(
    sensor: _Response,
    probability: npt.NDArray[np.float32],
    reference: tuple[float, float],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def mle_from_jots(
    sensor: _Response,
    ones: npt.NDArray[np.int32],
    jots: _Jots,
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
    jots: _Jots,
    bits: int,
    reference: tuple[float, float],
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

@final
class Layer:
    def __new__(cls, layer: _Layer) -> Layer: ...

def masked_sums(
    layer: Layer,
    packed: npt.NDArray[np.uint8],
    width: int,
    valid: npt.NDArray[np.uint8],
    threads: int | None,
) -> npt.NDArray[np.float32]: ...
def squared_errors(
    layers: list[_Layer], batch: dict[str, Any], threads: int | None
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]: ...
def gradient(
    layers: list[_Layer], batch: dict[str, Any], threads: int | None
) -> tuple[tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]], npt.NDArray[np.float64]]: ...
def normal_equations(
    layers: list[_Layer], batch: dict[str, Any], threads: int | None
) -> tuple[
    tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]],
    npt.NDArray[np.float64],
    npt.NDArray[np.float64],
]: ...
def forward(
    layers: list[Layer], sums: npt.NDArray[np.float32], threads: int | None
) -> npt.NDArray[np.float32]: ...
def input_rows(layers: list[Layer], height: int, rows: _Span) -> _Span: ...
def forward_bits(
    layers: list[Layer], packed: npt.NDArray[np.uint8], width: int, threads: int | None
) -> npt.NDArray[np.float32]: ...
def forward_counts(
    layers: list[Layer],
    counts: npt.NDArray[np.int32],
    sums: npt.NDArray[np.float32],
    threads: int | None,
) -> npt.NDArray[np.float32]: ...
def activate(
    planes: tuple[_Floats, _Floats], start: float, spacing: float, threads: int | None
) -> _Floats: ...
def activate_backward(
    planes: tuple[_Floats, _Floats],
    gradient: _Floats,
    start: float,
    spacing: float,
    threads: int | None,
) -> tuple[_Floats, npt.NDArray[np.float64]]: ...
def log_likelihood(seen: _Seen, light: npt.NDArray[np.float64], threads: int | None) -> float: ...
def likelihood_slopes(
    seen: _Seen,
    light: npt.NDArray[np.float64],
    gradient: npt.NDArray[np.float64],
    curvature: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def likelihood_proximal(
    seen: _Seen,
    penalty: float,
    most: float,
    guess: npt.NDArray[np.float64],
    point: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def spread_forward(
    spread: _Spread,
    image: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def spread_adjoint(
    spread: _Spread,
    jots: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def spread_normal(
    spread: _Spread,
    weights: npt.NDArray[np.float64],
    image: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def differences(
    image: npt.NDArray[np.float64], out: npt.NDArray[np.float64], threads: int | None
) -> None: ...
def differences_adjoint(
    planes: npt.NDArray[np.float64], out: npt.NDArray[np.float64], threads: int | None
) -> None: ...
def shrink(
    planes: npt.NDArray[np.float64], threshold: _Floats64, isotropic: bool, threads: int | None
) -> None: ...
def total_variation(
    planes: npt.NDArray[np.float64], weight: _Floats64, isotropic: bool, threads: int | None
) -> float: ...
def likelihood_split(
    seen: _Seen,
    step: _Step,
    most: float,
    light: npt.NDArray[np.float64],
    x: npt.NDArray[np.float64],
    dual: npt.NDArray[np.float64],
    threads: int | None,
) -> float: ...
def variation_split(
    step: _Step,
    weight: _Floats64,
    isotropic: bool,
    image: npt.NDArray[np.float64],
    x: npt.NDArray[np.float64],
    dual: npt.NDArray[np.float64],
    threads: int | None,
) -> float: ...
def likelihood_information(
    seen: _Seen,
    light: npt.NDArray[np.float64],
    information: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def cpu_levels() -> list[str]: ...
def cpu_level() -> str: ...
def choose_cpu_level(name: str | None) -> None: ...
def multiply_adds(rounds: int, threads: int | None) -> int: ...
def read_words(words: npt.NDArray[np.uint64], threads: int | None) -> int: ...
