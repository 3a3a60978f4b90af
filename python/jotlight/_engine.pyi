from collections.abc import Sequence
from typing import Any, TypeAlias, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "BRIGHT",
    "DEBUG_BUILD",
    "RATIO_OF_PASS",
    "Combined",
    "FilteredTemplate",
    "Layer",
    "Network",
    "__version__",
    "accept_agreeing",
    "activate",
    "activate_backward",
    "add_accepted",
    "add_block_counts",
    "add_coarse",
    "add_counts",
    "add_counts_of_blocks",
    "add_object_gain",
    "add_shifted_values",
    "anscombe",
    "blur",
    "brightness",
    "changed_remainders",
    "chi_squared",
    "choose_cpu_level",
    "color_lines",
    "conditioning_weights",
    "cost_of_curve",
    "count_shifted",
    "cpu_level",
    "cpu_levels",
    "detection_probability",
    "differences",
    "differences_adjoint",
    "diffuse",
    "disagreement",
    "displacement_equations",
    "draw_counts",
    "draw_readings",
    "equivalent_counts",
    "expose",
    "fit_affine",
    "fit_blocks",
    "forward",
    "gradient",
    "has_few_photons",
    "inner_products",
    "inverse_anscombe_algebraic",
    "inverse_anscombe_exact",
    "inverse_detection_probability",
    "joint_maximum",
    "joint_solution",
    "kernel_taps",
    "level_weights",
    "likelihood_admm_update",
    "likelihood_gradient_and_curvature",
    "likelihood_information",
    "likelihood_proximal",
    "local_trials",
    "log_likelihood",
    "look_up_counts",
    "mark_covered",
    "match_dark_regions",
    "may_be_dim",
    "may_have_dark_regions",
    "mle_from_counts",
    "mle_from_jots",
    "mle_from_probability",
    "multiply_adds",
    "normal_equations",
    "peak_of_shifted_scores",
    "probability",
    "rate",
    "read_words",
    "readings_distribution",
    "readings_gradient_and_curvature",
    "readings_information",
    "readings_log_likelihood",
    "readings_log_probability",
    "readings_moments",
    "relative_brightness",
    "reverse_bytes",
    "set_positions",
    "shortest_outlines",
    "shrink",
    "smooth_curve",
    "solve_field",
    "spread_adjoint",
    "spread_forward",
    "spread_normal",
    "squared_errors",
    "sum_counts",
    "total_variation",
    "total_variation_admm_update",
    "transpose_bits",
    "trials_per_combined",
    "undo_remainders",
    "velocity_scores",
]

__version__: str
DEBUG_BUILD: bool
# The rate at the largest intensity above which networks estimate P(b = 0).
BRIGHT: float
# The largest ratio of K to that of the network for one more pass of the network.
RATIO_OF_PASS: float

_Floats: TypeAlias = npt.NDArray[np.floating]
_Image: TypeAlias = npt.NDArray[np.float32] | npt.NDArray[np.float64]
# (stride, upsampling, input, skip). `input` is the index of the layer whose output this layer
# filters, or None for the previous layer. `skip` is the index of the layer whose output it adds, or
# None.
_Wiring: TypeAlias = tuple[int, int, int | None, int | None]
# (filters, spline coefficients, first knot, knot spacing, wiring)
_Layer: TypeAlias = tuple[_Floats, _Floats | None, float, float, _Wiring]
# Threshold, light (expected photons per jot and frame) at intensity 1, and maximum intensity.
_PixelResponse: TypeAlias = tuple[int, float, float]
# K, response of a pixel, efficiency and dark counts of the reference jot.
_SensorModel: TypeAlias = tuple[int, _PixelResponse, tuple[float, float]]
# The local trials of an image.
_Trials: TypeAlias = int | npt.NDArray[np.float32]
_Span: TypeAlias = tuple[int, int]
# Whole numbers of bits, or the real numbers of an equivalent sensor.
_Counts: TypeAlias = npt.NDArray[np.int32] | npt.NDArray[np.float32]
_ValueOrArray: TypeAlias = float | npt.NDArray[np.float64]
# Efficiency and dark counts.
_JotResponses: TypeAlias = tuple[_ValueOrArray, _ValueOrArray]
# Threshold, ones, trials, efficiency, and dark counts. Functions of readings measure light in
# expected photons per jot and frame.
_Readings: TypeAlias = tuple[
    int, npt.NDArray[np.int32], _ValueOrArray, _ValueOrArray, _ValueOrArray
]
# Highest reading, read noise, and threshold.
_Response: TypeAlias = tuple[int, float, int]
# Whether the numbers are histograms, numbers, efficiency, and dark counts.
_Cells: TypeAlias = tuple[bool, npt.NDArray[np.int32], _ValueOrArray, _ValueOrArray]
# The cells of a term (readings, or response, cells, and their number), the light at intensity 1,
# the cells per pixel and dimension, and the places of the cells.
_TermCells: TypeAlias = _Readings | tuple[_Response, _Cells, int]
_Term: TypeAlias = tuple[_TermCells, float, int, npt.NDArray[np.int32] | None]
# Penalty of each image, and relaxation.
_AdmmStep: TypeAlias = tuple[npt.NDArray[np.float64], float]
# Vertical kernel and horizontal kernel, each as (degree, oversampling), and gain.
_Spread: TypeAlias = tuple[tuple[int, int], tuple[int, int], float]

def add_block_counts(
    packed: list[npt.NDArray[np.uint8]],
    width: int,
    oversampling: int,
    valid: npt.NDArray[np.uint8] | None,
    counts: npt.NDArray[np.int32],
    threads: int | None,
) -> None: ...
def add_counts_of_blocks(
    packed: npt.NDArray[np.uint8],
    width: int,
    side: int,
    before: int,
    length: int,
    weight: int,
    counts: npt.NDArray[np.int32],
    threads: int | None,
) -> None: ...
def reverse_bytes(packed: npt.NDArray[np.uint8], threads: int | None) -> None: ...
def set_positions(
    positions: npt.NDArray[np.uint32],
    frame: int,
    packed: npt.NDArray[np.uint8],
    threads: int | None,
) -> int: ...
def transpose_bits(
    packed: npt.NDArray[np.uint8],
    width: int,
    transposed: npt.NDArray[np.uint8],
    threads: int | None,
) -> None: ...
def count_shifted(
    packed: npt.NDArray[np.uint8],
    width: int,
    fields: npt.NDArray[np.float32],
    tile: int | None,
    times: npt.NDArray[np.float64],
    valid: npt.NDArray[np.uint8] | None,
    ones: npt.NDArray[np.int32],
    trials: npt.NDArray[np.int32],
    remainders: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def add_shifted_values(
    values: npt.NDArray[np.float32],
    fields: npt.NDArray[np.float32],
    tile: int | None,
    times: npt.NDArray[np.float64],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...

@final
class FilteredTemplate:
    def __new__(
        cls,
        probability: npt.NDArray[np.float32],
        trials: npt.NDArray[np.int32],
        sigma: float,
        threads: int | None,
    ) -> FilteredTemplate: ...

def displacement_equations(
    template: FilteredTemplate,
    ones: _Counts,
    trials: _Counts,
    remainders: npt.NDArray[np.float32],
    frames: int,
    threads: int | None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
def chi_squared(
    ones: _Counts,
    trials: _Counts,
    probability: npt.NDArray[np.float32],
    trials_of_template: npt.NDArray[np.int32],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def add_counts(
    parts: list[npt.NDArray[np.int32]], out: npt.NDArray[np.int32], threads: int | None
) -> None: ...
def add_accepted(
    test: npt.NDArray[np.float32],
    limit: float,
    ones: npt.NDArray[np.int32],
    trials: npt.NDArray[np.int32],
    total_ones: npt.NDArray[np.int32],
    total_trials: npt.NDArray[np.int32],
    mask: npt.NDArray[np.uint8],
    threads: int | None,
) -> None: ...
def accept_agreeing(
    template: tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]],
    limits: tuple[float, float],
    blocks: list[
        tuple[list[tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]], int, npt.NDArray[np.uint8]]
    ],
    accepted: tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]],
    available: npt.NDArray[np.int32],
    threads: int | None,
) -> list[bool]: ...
def add_object_gain(
    label: int,
    ones: _Counts,
    trials: _Counts,
    predicted: npt.NDArray[np.float32],
    others: list[tuple[int, npt.NDArray[np.float32], npt.NDArray[np.float32]]],
    labels: npt.NDArray[np.uint8],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def mark_covered(
    fronts: list[tuple[int, npt.NDArray[np.float32]]],
    labels: npt.NDArray[np.uint8],
    out: npt.NDArray[np.bool_],
    threads: int | None,
) -> None: ...
def brightness(
    ones: _Counts, trials: _Counts, probability: npt.NDArray[np.float32], threads: int | None
) -> float: ...
def relative_brightness(
    ones: _Counts,
    trials: _Counts,
    other_ones: _Counts,
    other_trials: _Counts,
    threads: int | None,
) -> float: ...
def shortest_outlines(
    gain: npt.NDArray[np.float32],
    length: float,
    out: npt.NDArray[np.bool_],
    threads: int | None,
) -> None: ...
def smooth_curve(
    estimates: npt.NDArray[np.float64],
    information: npt.NDArray[np.float64],
    ratios: npt.NDArray[np.float64],
    threads: int | None,
) -> npt.NDArray[np.float64]: ...
def cost_of_curve(
    estimates: npt.NDArray[np.float64],
    information: npt.NDArray[np.float64],
    ratios: npt.NDArray[np.float64],
    weights: list[float],
) -> tuple[float, npt.NDArray[np.float64]]: ...
def blur(
    images: npt.NDArray[np.float32],
    sigma: float,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def disagreement(
    ones: _Counts,
    trials: _Counts,
    other_ones: _Counts,
    other_trials: _Counts,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def undo_remainders(
    image: npt.NDArray[np.float32],
    remainders: npt.NDArray[np.float32],
    frames: int,
    least: float,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def changed_remainders(
    remainders: npt.NDArray[np.float32], change: npt.NDArray[np.float64], frames: int
) -> npt.NDArray[np.float32]: ...
def fit_blocks(
    template: FilteredTemplate,
    share: tuple[float, float],
    blocks: list[tuple[_Counts, _Counts, npt.NDArray[np.float32], int]],
    weights: npt.NDArray[np.float64],
    basis: npt.NDArray[np.float64],
    threads: int | None,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
def fit_affine(
    information: npt.NDArray[np.float64],
    right: npt.NDArray[np.float64],
    weights: npt.NDArray[np.float64],
    basis: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
def solve_field(
    information: npt.NDArray[np.float64],
    right: npt.NDArray[np.float64],
    now: npt.NDArray[np.float64],
    predicted: npt.NDArray[np.float64],
    basis: npt.NDArray[np.float64],
    smoothness: tuple[float, float, float],
) -> npt.NDArray[np.float64]: ...
def velocity_scores(
    blocks: npt.NDArray[np.int32],
    corners: list[tuple[int, int]],
    size: tuple[int, int],
    filters: tuple[float, float],
    lags: list[int],
    line: npt.NDArray[np.float64],
    threads: int | None,
) -> npt.NDArray[np.float32]: ...
def peak_of_shifted_scores(
    scores: npt.NDArray[np.float32],
    shifts: npt.NDArray[np.int64],
    threads: int | None,
) -> list[tuple[float, tuple[int, int]]]: ...
def expose(
    sensor: dict[str, Any],
    images: _Image,
    streams: list[tuple[bytes, int]],
    frames: _Span,
    rows: _Span,
    columns: _Span,
    out: npt.NDArray[np.uint8],
    threads: int | None,
) -> None: ...
def draw_counts(
    sensor: dict[str, Any],
    frames: int,
    image: npt.NDArray[np.float32] | npt.NDArray[np.float64],
    seed: bytes,
    index: int,
    out: npt.NDArray[np.int32],
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
def inner_products(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> list[float]: ...
def kernel_taps(degree: int, oversampling: int) -> list[float]: ...
def detection_probability(threshold: int, rate: float) -> float: ...
def inverse_detection_probability(threshold: int, probability: float) -> float: ...
def look_up_counts(
    packed: npt.NDArray[np.uint8],
    width: int,
    oversampling: int,
    table: npt.NDArray[np.float32],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def mle_from_counts(
    response: _PixelResponse,
    counts: npt.NDArray[np.int32],
    trials: _ValueOrArray,
    jots: _JotResponses,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def mle_from_probability(
    response: _PixelResponse,
    probability: npt.NDArray[np.float32],
    jot: tuple[float, float],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def mle_from_jots(
    response: _PixelResponse,
    ones: npt.NDArray[np.int32],
    jots: _JotResponses,
    dead: npt.NDArray[np.bool_] | None,
    frames: int,
    oversampling: int,
    width: int,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def equivalent_counts(
    response: _PixelResponse,
    counts: npt.NDArray[np.int32],
    trials: _ValueOrArray,
    jots: _JotResponses,
    reference_trials: npt.NDArray[np.float64],
    reference: tuple[float, float],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def anscombe(
    counts: npt.NDArray[np.float32],
    trials: _ValueOrArray,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def inverse_anscombe_algebraic(
    z: npt.NDArray[np.float32],
    trials: _ValueOrArray,
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def inverse_anscombe_exact(
    z: npt.NDArray[np.float32], trials: int, out: npt.NDArray[np.float32], threads: int | None
) -> None: ...

@final
class Layer:
    def __new__(cls, layer: _Layer) -> Layer: ...
    @property
    def multiplications(self) -> float: ...

@final
class Network:
    def __new__(
        cls,
        layers: Sequence[_Layer],
        sensor: _SensorModel,
        trials_range: tuple[int, int] | None,
        reads_planes: bool,
        rotations: int,
    ) -> Network: ...
    def with_precision(self, precision: str) -> Network: ...
    @property
    def halo(self) -> int: ...
    def estimates_zeros(self, sensor: _SensorModel) -> bool: ...
    def conditioned(
        self, trials: float, zeros: bool
    ) -> list[tuple[npt.NDArray[np.float32], npt.NDArray[np.float32] | None]]: ...
    def bits(
        self,
        packed: Sequence[npt.NDArray[np.uint8]],
        width: int,
        oversampling: int,
        sensor: _SensorModel,
        out: Sequence[npt.NDArray[np.float32]],
        threads: int | None,
    ) -> None: ...
    def counts(
        self,
        counts: npt.NDArray[np.int32],
        trials: float,
        jot: tuple[float, float],
        sensor: _SensorModel,
        out: Sequence[npt.NDArray[np.float32]],
        threads: int | None,
    ) -> None: ...
    def equivalent_counts(
        self,
        counts: npt.NDArray[np.float32],
        of: Sequence[int],
        trials: Sequence[_Trials],
        sensor: _SensorModel,
        out: Sequence[npt.NDArray[np.float32]],
        threads: int | None,
    ) -> None: ...
    def masked_sums(
        self,
        packed: Sequence[npt.NDArray[np.uint8]],
        width: int,
        valid: npt.NDArray[np.uint8],
        threads: int | None,
    ) -> list[npt.NDArray[np.float32]]: ...
    def sums(
        self,
        sums: Sequence[npt.NDArray[np.float32]],
        sensor: _SensorModel,
        out: Sequence[npt.NDArray[np.float32]],
        threads: int | None,
    ) -> None: ...
    def run_counts(
        self,
        counts: Sequence[npt.NDArray[np.float32]],
        trials: int,
        zeros: bool,
        threads: int | None,
    ) -> list[npt.NDArray[np.float32]]: ...
    def denoise(
        self,
        fractions: Sequence[npt.NDArray[np.float32]],
        trials: Sequence[_Trials],
        zeros: bool,
        threads: int | None,
    ) -> list[npt.NDArray[np.float32]]: ...
    def improve(
        self, planes: npt.NDArray[np.float32], trials: float, threads: int | None
    ) -> npt.NDArray[np.float32]: ...

@final
class Combined:
    @staticmethod
    def of(
        fractions: npt.NDArray[np.float32], trials: _Trials, smallest: int
    ) -> Combined | None: ...
    @property
    def fractions(self) -> npt.NDArray[np.float32]: ...
    @property
    def trials(self) -> _Trials: ...
    @property
    def factor(self) -> float: ...
    def weights(self, probabilities: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]: ...

def may_be_dim(image: npt.NDArray[np.float32], sensor: _SensorModel, trials: float) -> bool: ...
def may_have_dark_regions(image: npt.NDArray[np.float32], sensor: _SensorModel) -> bool: ...
def trials_per_combined(
    fractions: npt.NDArray[np.float32], trials: _Trials, smallest: int
) -> float: ...
def has_few_photons(
    image: npt.NDArray[np.float32], sensor: _SensorModel, trials: float
) -> bool: ...
def sum_counts(
    counts: npt.NDArray[np.int32],
    trials: float | npt.NDArray[np.float64],
    jots: tuple[float | npt.NDArray[np.float64], float | npt.NDArray[np.float64]],
    threshold: int,
    threads: int | None,
) -> tuple[
    npt.NDArray[np.int32],
    float | npt.NDArray[np.float64],
    tuple[float | npt.NDArray[np.float64], float | npt.NDArray[np.float64]],
]: ...
def add_coarse(
    fine: npt.NDArray[np.float32],
    coarse: npt.NDArray[np.float32],
    sensor: _SensorModel,
    trials: float | npt.NDArray[np.float64],
    threads: int | None,
) -> npt.NDArray[np.float32]: ...
def match_dark_regions(
    probabilities: npt.NDArray[np.float32],
    fractions: npt.NDArray[np.float32],
    trials: _Trials,
    threshold: int,
    threads: int | None,
) -> npt.NDArray[np.float32]: ...
def color_lines(
    colors: npt.NDArray[np.float32],
    out: npt.NDArray[np.float32],
    threads: int | None,
) -> None: ...
def conditioning_weights(
    trials: float, trials_range: tuple[float, float], sets: int
) -> npt.NDArray[np.float64]: ...
def level_weights(
    maps: Sequence[npt.NDArray[np.float32]],
) -> list[list[tuple[int, npt.NDArray[np.float32]]]]: ...
def local_trials(maps: Sequence[npt.NDArray[np.float64]], threads: int | None) -> list[_Trials]: ...
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
def joint_maximum(
    terms: list[_Term],
    shape: tuple[int, int],
    highest: float,
    offset: float,
    intensity: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def joint_solution(
    terms: list[_Term],
    shape: tuple[int, int],
    total: npt.NDArray[np.float64],
    highest: float,
    offset: float,
    intensity: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def diffuse(
    values: npt.NDArray[np.float64],
    is_known: npt.NDArray[np.bool_],
    out: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def draw_readings(
    sensor: dict[str, Any],
    response: _Response,
    images: _Image,
    streams: list[tuple[bytes, int]],
    frames: _Span,
    rows: _Span,
    columns: _Span,
    out: npt.NDArray[np.uint16],
    threads: int | None,
) -> None: ...
def readings_log_likelihood(
    response: _Response, cells: _Cells, light: npt.NDArray[np.float64], threads: int | None
) -> float: ...
def readings_gradient_and_curvature(
    response: _Response,
    cells: _Cells,
    light: npt.NDArray[np.float64],
    gradient: npt.NDArray[np.float64],
    curvature: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def readings_log_probability(
    response: _Response,
    readings: npt.NDArray[np.int32],
    rates: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def readings_distribution(
    response: _Response,
    rates: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def readings_information(
    response: _Response,
    rates: npt.NDArray[np.float64],
    information: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def readings_moments(
    response: _Response,
    rates: npt.NDArray[np.float64],
    moments: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def forward(
    layers: list[Layer],
    sums: list[npt.NDArray[np.float32]],
    out: list[npt.NDArray[np.float32]],
    threads: int | None,
) -> None: ...
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
def log_likelihood(
    readings: _Readings, light: npt.NDArray[np.float64], threads: int | None
) -> list[float]: ...
def likelihood_gradient_and_curvature(
    readings: _Readings,
    light: npt.NDArray[np.float64],
    gradient: npt.NDArray[np.float64],
    curvature: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def likelihood_proximal(
    readings: _Readings,
    penalty: float,
    max_light: float,
    guess: npt.NDArray[np.float64],
    point: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def spread_forward(
    spread: _Spread,
    images: npt.NDArray[np.float64],
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
    images: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def differences(
    images: npt.NDArray[np.float64], out: npt.NDArray[np.float64], threads: int | None
) -> None: ...
def differences_adjoint(
    differences: npt.NDArray[np.float64], out: npt.NDArray[np.float64], threads: int | None
) -> None: ...
def shrink(
    differences: npt.NDArray[np.float64],
    threshold: _ValueOrArray,
    isotropic: bool,
    threads: int | None,
) -> None: ...
def total_variation(
    differences: npt.NDArray[np.float64],
    weight: _ValueOrArray,
    isotropic: bool,
    threads: int | None,
) -> list[float]: ...
def likelihood_admm_update(
    readings: _Readings,
    step: _AdmmStep,
    max_light: float,
    light: npt.NDArray[np.float64],
    x: npt.NDArray[np.float64],
    dual: npt.NDArray[np.float64],
    threads: int | None,
) -> list[float]: ...
def total_variation_admm_update(
    step: _AdmmStep,
    weight: _ValueOrArray,
    isotropic: bool,
    images: npt.NDArray[np.float64],
    x: npt.NDArray[np.float64],
    dual: npt.NDArray[np.float64],
    threads: int | None,
) -> list[float]: ...
def likelihood_information(
    readings: _Readings,
    light: npt.NDArray[np.float64],
    information: npt.NDArray[np.float64],
    threads: int | None,
) -> None: ...
def cpu_levels() -> list[str]: ...
def cpu_level() -> str: ...
def choose_cpu_level(name: str | None) -> None: ...
def multiply_adds(rounds: int, threads: int | None) -> int: ...
def read_words(words: npt.NDArray[np.uint64], threads: int | None) -> int: ...
