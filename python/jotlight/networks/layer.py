"""What networks are made of: filter banks, each followed by pointwise cubic B-splines."""

import dataclasses
import functools
import math
import operator
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, Self

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine


@dataclasses.dataclass(frozen=True, eq=False)
class Layer:
    """A filter bank, followed by one pointwise cubic B-spline per output channel.

    Its planes are φ(D(h * u) + v): u the planes that it reads, D from depth to space, v kept
    planes.

    Parameters
    ----------
    filters : ndarray of float32, shape (C, C_in, height, width) or (M, C, C_in, height, width)
        The first layer reads bits with stride K̂: its shape is (C, T, K̂, K̂), or (C, 1, 1, 1) when
        it is tied, one weight for the whole block. Later layers convolve; past the rim, planes are
        mirrored. M sets are of a network that is told K: see :meth:`at`.
    coefficients : ndarray of float32, shape (C / upsampling², N_w), or with M sets, optional
        N_w of at least 4. None leaves the sums as they are.
    start, spacing : float
        The spline φ(z) = Σ_k w_k β3((z - start)/spacing - (k - 1)) lives on
        [start, start + (N_w - 3) spacing] and is constant outside of it.
    stride : int
        Rows and columns of what is read from one output to the next. Filters are at least as large.
    upsampling : int
        From depth to space: so many rows and columns in place of one, taken from the channels.
    input : int, optional
        The layer whose planes it reads, by its number from 0. Default: the one before.
    skip : int, optional
        The layer whose planes are added to its own before the spline: a kept connection.
    trainable : {"all", "filters", "nothing"}
        What training with PyTorch changes. A spline that is known exactly is better left alone.

    Raises
    ------
    ValueError
        When shapes or numbers do not fit.
    """

    filters: npt.NDArray[np.float32]
    coefficients: npt.NDArray[np.float32] | None
    start: float = 0.0
    spacing: float = 1.0
    stride: int = 1
    upsampling: int = 1
    input: int | None = None
    skip: int | None = None
    trainable: str = "all"

    def __post_init__(self) -> None:
        for name, dimensions in (("filters", 4), ("coefficients", 2)):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _checked(name, value, dimensions))
        for name in ("stride", "upsampling"):
            number = operator.index(getattr(self, name))
            if not 1 <= number <= _STEPS:
                raise ValueError(f"{name}: expected 1 to {_STEPS}, got {number}")
        if self.trainable not in TRAINABLE:
            raise ValueError(
                f"trainable: expected one of {', '.join(TRAINABLE)}, got {self.trainable!r}"
            )
        outputs, _, *taps = self.shape
        if min(taps) < self.stride:
            raise ValueError(
                f"filters: expected at least as many rows and columns as the stride of "
                f"{self.stride}, got shape {self.shape}"
            )
        if outputs % self.upsampling**2:
            raise ValueError(
                f"filters: expected a multiple of {self.upsampling**2} of them, for an upsampling "
                f"of {self.upsampling}, got {outputs}"
            )
        if self.coefficients is not None and (
            self.coefficients.shape[-2] != self.channels or self.coefficients.shape[-1] < 4
        ):
            raise ValueError(
                f"coefficients: expected {self.channels} rows, one per channel, of at least 4, "
                f"got shape {self.coefficients.shape}"
            )
        single = np.finfo(np.float32)
        least, most = float(single.tiny), float(single.max)
        if not (abs(self.start) <= most and least <= self.spacing <= most):
            raise ValueError(
                "start and spacing: expected finite numbers in the range of float32, the spacing "
                f"above 0, got {self.start} and {self.spacing}"
            )

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """C, C_in, height and width of the filters."""
        outputs, inputs, height, width = self.filters.shape[-4:]
        return outputs, inputs, height, width

    @property
    def channels(self) -> int:
        """The planes that it gives."""
        return self.shape[0] // self.upsampling**2

    @property
    def spline_coefficients(self) -> npt.NDArray[np.float32]:
        """The coefficients of a layer that has splines."""
        assert self.coefficients is not None, "a layer with splines"
        return self.coefficients

    @property
    def sets(self) -> set[int]:
        """M of the arrays that have so many sets."""
        found = {len(self.filters)} if self.filters.ndim == 5 else set()
        if self.coefficients is not None and self.coefficients.ndim == 3:
            found.add(len(self.coefficients))
        return found

    def interpolate(self, shares: npt.NDArray[np.floating]) -> Self:
        """Give the layer that is so many shares of each of its M sets."""
        filters, coefficients = self.filters, self.coefficients
        if filters.ndim == 5:
            filters = np.tensordot(shares, filters, 1).astype(np.float32)
        if coefficients is not None and coefficients.ndim == 3:
            coefficients = np.tensordot(shares, coefficients, 1).astype(np.float32)
        return dataclasses.replace(self, filters=filters, coefficients=coefficients)

    def numbers(self) -> dict[str, Any]:
        """Give what JSON can hold of it: all but the arrays."""
        left_out = {"filters", "coefficients"}
        if self.coefficients is None:
            left_out |= {"start", "spacing"}
        names = [field.name for field in dataclasses.fields(self) if field.name not in left_out]
        return {name: getattr(self, name) for name in names}

    def for_engine(
        self, filters: npt.NDArray[np.floating], coefficients: npt.NDArray[np.floating] | None
    ) -> Any:
        """Give the layer as the engine takes it, with these numbers."""
        wiring = self.stride, self.upsampling, self.input, self.skip
        return filters, coefficients, self.start, self.spacing, wiring

    @functools.cached_property
    def prepared(self) -> engine.Layer:
        """The layer in the engine, which brings its filters into order once."""
        return engine.Layer(self.for_engine(self.filters, self.coefficients))

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave out what the engine made, for `pickle` and `copy`."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return functools.partial(type(self), **fields), ()

    @property
    def parameters(self) -> int:
        """Taps and coefficients."""
        return self.filters.size + (0 if self.coefficients is None else self.coefficients.size)

    @property
    def before(self) -> tuple[int, int]:
        """Rows and columns before the first that belongs to an output alone, which it reads too."""
        _, _, height, width = self.shape
        return (height - self.stride) // 2, (width - self.stride) // 2


TRAINABLE = "all", "filters", "nothing"

_STEPS = 16
"""The largest stride and upsampling."""
_LARGEST_STEP = 256
"""Rows of a picture that one row of planes stands for, at most."""


def conditioning_weights(
    bits: float, between: tuple[float, float], number: int
) -> npt.NDArray[np.float64]:
    """Give how much of each of so many sets of parameters a network has that is told K = `bits`.

    The shares are the values of cubic B-splines at log2 K, over the range of K.

    Examples
    --------
    >>> conditioning_weights(16, (1, 256), 5).round(3).tolist()
    [0.0, 0.167, 0.667, 0.167, 0.0]
    """
    low, high = (math.log2(x) for x in between)
    place = (math.log2(bits) - low) / (high - low) * (number - 3)
    first = min(max(math.floor(place), 0), number - 4)
    through = place - first
    cubics = [(((d * through + c) * through + b) * through + a) / 6 for a, b, c, d in _CUBICS]
    return np.array([0.0] * first + cubics + [0.0] * (number - 4 - first))


# No array: torch.compile would take it for a tensor.
_CUBICS = (1, -3, 3, -1), (4, 0, -6, 3), (1, 3, 3, -3), (0, 0, 0, 1)
"""Six times the four cubic B-splines past a knot, in powers of the distance past it."""


def _checked(name: str, value: Any, dimensions: int) -> npt.NDArray[np.float32]:
    array = np.asarray(value)
    if array.dtype.kind != "f" or array.ndim - dimensions not in (0, 1) or array.size == 0:
        raise ValueError(
            f"{name}: expected floats of {dimensions} dimensions, got {array.dtype} "
            f"of shape {array.shape}"
        )
    with np.errstate(over="ignore"):
        array = np.array(array, np.float32, order="C")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite numbers in the range of float32")
    array.flags.writeable = False
    return array


def sources(layers: Sequence[Layer]) -> list[int]:
    """Give the number of the layer that each reads; -1 for the first, which reads the data."""
    return [
        index - 1 if layer.input is None else operator.index(layer.input)
        for index, layer in enumerate(layers)
    ]


def scales(layers: Sequence[Layer]) -> list[Fraction]:
    """Give the pixels along a row of the picture for each that a layer's planes have.

    Raises
    ------
    ValueError
        When a layer reads or adds planes that do not fit.
    """
    found: list[Fraction] = []
    for index, (layer, source) in enumerate(zip(layers, sources(layers), strict=True)):
        if index == 0:
            if source != -1 or layer.skip is not None or layer.stride * layer.upsampling != 1:
                raise ValueError(
                    "layers: expected the first one to read the data, and to have no stride, "
                    "upsampling or kept planes"
                )
            found.append(Fraction(1))
            continue
        for what, number in (("input", source), ("skip", layer.skip)):
            if number is not None and not 0 <= number < index:
                raise ValueError(
                    f"layers: expected layer {index} to take planes of 0 to {index - 1}, got "
                    f"{what} {number}"
                )
        if layer.shape[1] != layers[source].channels:
            raise ValueError(
                f"layers: expected {layers[source].channels} input channels in layer {index}, "
                f"got filters of shape {layer.shape}"
            )
        found.append(found[source] * layer.stride / layer.upsampling)
        if layer.skip is not None and (layers[layer.skip].channels, found[layer.skip]) != (
            layer.channels,
            found[-1],
        ):
            raise ValueError(
                f"layers: expected layer {index} to add planes like its own, of {layer.channels} "
                f"channels, got those of layer {layer.skip}"
            )
    taken = {*sources(layers), *(layer.skip for layer in layers)}
    for index in range(len(layers) - 1):
        if index not in taken:
            raise ValueError(
                f"layers: expected the planes of layer {index} to be read or added, got no layer "
                "that does"
            )
    if layers[-1].channels != 1 or found[-1] != 1:
        raise ValueError(
            f"layers: expected one output channel of the last layer, in the picture's own size, "
            f"got {layers[-1].channels}"
        )
    return found


def size_divisor(layers: Sequence[Layer]) -> int:
    """Give what rows and columns of a picture have to be a multiple of.

    Raises
    ------
    ValueError
        When that is more than 256, or a pixel has more than 256 rows in some planes.
    """
    every = scales(layers)
    # What filters with a stride give has whole rows, before any are made of its depth.
    step = math.lcm(
        *((scale * layer.upsampling).numerator for layer, scale in zip(layers, every, strict=True))
    )
    largest = max(step, *(scale.denominator for scale in every))
    if largest > _LARGEST_STEP:
        raise ValueError(
            f"layers: expected strides and upsamplings of at most {_LARGEST_STEP} together, got "
            f"{largest}"
        )
    return step


def is_sequential(layers: Sequence[Layer]) -> bool:
    """Whether each layer filters and bends what the one before gave, and no more."""
    plain = all(
        layer.stride == layer.upsampling == 1
        and layer.skip is None
        and layer.coefficients is not None
        and not layer.sets
        for layer in layers
    )
    return plain and sources(layers) == list(range(-1, len(layers) - 1))


def flops_per_pixel(layers: Sequence[Layer]) -> float:
    """Give the operations per pixel of a picture: 2 for each tap, 10 for each value of a spline.

    Examples
    --------
    >>> tap, spline = np.ones((1, 1, 1, 1), np.float32), np.ones((1, 4), np.float32)
    >>> flops_per_pixel([Layer(tap, spline), Layer(np.ones((1, 1, 3, 3), np.float32), None)])  # 2 + 10 + 18
    30.0
    """
    work = Fraction(0)
    for layer, scale in zip(layers, scales(layers), strict=True):
        # From depth to space comes after the filters.
        work += 2 * math.prod(layer.shape) / (scale * layer.upsampling) ** 2
        if layer.coefficients is not None:
            work += 10 * layer.channels / scale**2
    return float(work)


def count_sets(layers: Sequence[Layer]) -> int:
    """Give M of layers that have sets of parameters, and the least that there can be for others.

    Raises
    ------
    ValueError
        When they have different numbers.
    """
    found: set[int] = set().union(*(layer.sets for layer in layers))
    if len(found) > 1 or min(found, default=4) < 4:
        raise ValueError(
            f"layers: expected the same number of sets of parameters in all, 4 or more, got {found}"
        )
    return max(found, default=4)


def halo_radius(layers: Sequence[Layer]) -> int:
    """Give the pixels around a pixel that its estimate depends on, in whole steps."""
    step = size_divisor(layers)
    # Of each layer's planes, what the pixels of one step of the picture depend on.
    ranges: list[tuple[Fraction, Fraction] | None] = [None] * len(layers)
    ranges[-1] = Fraction(0), Fraction(step)
    for index, layer in reversed(list(enumerate(layers))):
        found = ranges[index]
        if index == 0 or found is None:
            continue
        first, last = (
            math.floor(found[0] / layer.upsampling),
            math.ceil(found[1] / layer.upsampling),
        )
        aligned = Fraction(first * layer.upsampling), Fraction(last * layer.upsampling)
        reads = []
        for size, before in zip(layer.shape[2:], layer.before, strict=True):
            start = first * layer.stride - before
            reads.append((Fraction(start), Fraction((last - 1) * layer.stride - before + size)))
        source = sources(layers)[index]
        ranges[source] = _hull(ranges[source], *reads)
        if layer.skip is not None:
            ranges[layer.skip] = _hull(ranges[layer.skip], aligned)
    assert ranges[0] is not None, "every layer is used"
    around = max(-ranges[0][0], ranges[0][1] - step)
    return step * math.ceil(around / step)


def _hull(
    *ranges: tuple[Fraction, Fraction] | None,
) -> tuple[Fraction, Fraction]:
    known = [x for x in ranges if x is not None]
    return min(x[0] for x in known), max(x[1] for x in known)
