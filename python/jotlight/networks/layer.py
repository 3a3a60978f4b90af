"""One layer of a network: a filter bank, followed by pointwise cubic B-splines."""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.arrays import frozen
from jotlight.checks import to_array
from jotlight.kept import kept_property
from jotlight.parameter_names import check_choice

TRAINABLE = "all", "filters", "nothing"
"""Values of `Layer.trainable`: the parameters that training with PyTorch changes."""

_MAX_STRIDE = 16
"""Largest stride and largest upsampling factor of a layer."""

_MAX_COEFFICIENTS = 1 << 16
"""Maximum number of coefficients of a spline.

Up to this number, float32 resolves positions between all knots.
"""


@dataclasses.dataclass(frozen=True, eq=False)
class Layer:
    """A filter bank, followed by one pointwise cubic B-spline per output channel.

    The layer computes φ(D(h * u) + v). Its filters h convolve the channels u of its input layer, D
    rearranges depth to space, a skip connection adds the channels v of another layer, and the
    splines φ act on each value. The layers of the paper, equations (8) to (11), have neither D nor
    v.

    Parameters
    ----------
    filters : ndarray of float32, shape (C, C_in, height, width) or (M, C, C_in, height, width)
        Taps of the filters. The first layer weighs the bits of a pixel: its shape is
        (C, T, K̂, K̂), or (C, 1, 1, 1) if it is tied, with one weight for all bits of a pixel. Later
        layers convolve with mirrored padding. A leading axis holds M sets of parameters for a
        K-conditioned network, which interpolates between them.
    coefficients : ndarray of float32, shape (C / upsampling², N_w) or (M, C / upsampling², N_w)
        Spline coefficients, 4 to 65,536 per channel. None: the layer has no splines.
    start, spacing : float
        First knot, and distance between knots. The spline φ(z) = Σ_k w_k β3((z - start)/spacing -
        (k - 1)) covers [start, start + (N_w - 3) spacing] and is constant outside.
    stride : int
        Distance of neighboring outputs in rows and columns, 1 to 16. Filters have at least as many
        rows and columns.
    upsampling : int
        Factor r of the depth-to-space step, 1 to 16: r² channels become one channel with r times
        the rows and columns.
    input : int, optional
        Index of the layer whose output this layer filters. Default: the previous layer.
    skip : int, optional
        Index of the layer whose output is added before the splines. Default: no skip connection.
    trainable : {"all", "filters", "nothing"}
        Parameters that training with PyTorch changes.

    Raises
    ------
    ValueError
        When a shape or a number is invalid.

    Examples
    --------
    >>> mean = jl.Layer(np.full((1, 1, 3, 3), 1 / 9), None)
    >>> mean.shape, mean.parameter_count
    ((1, 1, 3, 3), 9)
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
                object.__setattr__(self, name, _read_only_float32(name, value, dimensions))
        for name in ("stride", "upsampling"):
            number = operator.index(getattr(self, name))
            if not 1 <= number <= _MAX_STRIDE:
                raise ValueError(f"{name}: expected 1 to {_MAX_STRIDE}, got {number}")
        check_choice("trainable", self.trainable, TRAINABLE)
        self._check_shapes()
        float32 = np.finfo(np.float32)
        smallest, largest = float(float32.tiny), float(float32.max)
        if not (abs(self.start) <= largest and smallest <= self.spacing <= largest):
            raise ValueError(
                "start and spacing: expected finite numbers in the range of float32, and a spacing "
                f"above 0, got {self.start} and {self.spacing}"
            )

    def _check_shapes(self) -> None:
        outputs, _, *taps = self.shape
        if min(taps) < self.stride:
            raise ValueError(
                f"filters: expected at least as many rows and columns as the stride of "
                f"{self.stride}, got shape {self.shape}"
            )
        if outputs % self.upsampling**2:
            raise ValueError(
                f"filters: expected a multiple of {self.upsampling**2} filters for an upsampling "
                f"of {self.upsampling}, got {outputs}"
            )
        if self.coefficients is None:
            return
        rows, number = self.coefficients.shape[-2:]
        if rows != self.channels or not 4 <= number <= _MAX_COEFFICIENTS:
            raise ValueError(
                f"coefficients: expected {self.channels} rows, one per channel, of 4 to "
                f"{_MAX_COEFFICIENTS} coefficients, got shape {self.coefficients.shape}"
            )

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Shape (C, C_in, height, width) of one set of filters."""
        outputs, inputs, height, width = self.filters.shape[-4:]
        return outputs, inputs, height, width

    @property
    def channels(self) -> int:
        """Number of output channels, after the depth-to-space step."""
        return self.shape[0] // self.upsampling**2

    @property
    def spline_coefficients(self) -> npt.NDArray[np.float32]:
        """Coefficients of a layer that has splines."""
        assert self.coefficients is not None, "a layer with splines"
        return self.coefficients

    @property
    def set_counts(self) -> set[int]:
        """Numbers M of sets, without duplicates, of the arrays with a leading axis of M sets."""
        found = {len(self.filters)} if self.filters.ndim == 5 else set()
        if self.coefficients is not None and self.coefficients.ndim == 3:
            found.add(len(self.coefficients))
        return found

    def __repr__(self) -> str:
        splines = (
            "no splines" if self.coefficients is None else f"splines {self.coefficients.shape}"
        )
        return f"<Layer: filters {self.filters.shape}, {splines}, {self.trainable} trainable>"

    @property
    def parameter_count(self) -> int:
        """Number of taps and coefficients, over all sets."""
        return self.filters.size + (0 if self.coefficients is None else self.coefficients.size)

    @property
    def padding(self) -> tuple[int, int]:
        """Rows above, and columns left of, its stride × stride block that a filter reads."""
        _, _, height, width = self.shape
        return (height - self.stride) // 2, (width - self.stride) // 2

    def metadata(self) -> dict[str, Any]:
        """Return all fields except the arrays, as values that JSON can hold."""
        left_out = {"filters", "coefficients"}
        if self.coefficients is None:
            left_out |= {"start", "spacing"}
        names = [field.name for field in dataclasses.fields(self) if field.name not in left_out]
        return {name: getattr(self, name) for name in names}

    def to_engine(
        self, filters: npt.NDArray[np.floating], coefficients: npt.NDArray[np.floating] | None
    ) -> Any:
        """Return the engine's description of this layer with the given taps and coefficients."""
        wiring = self.stride, self.upsampling, self.input, self.skip
        return filters, coefficients, self.start, self.spacing, wiring

    @kept_property
    def engine_layer(self) -> engine.Layer:
        """The layer in the engine, which reorders the filters once for fast inference."""
        return engine.Layer(self.to_engine(self.filters, self.coefficients))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the layer for `pickle` and `copy`, without the engine's part that they reject."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return functools.partial(type(self), **fields), ()


def have_equal_parameters(layers: Sequence[Layer], others: Sequence[Layer]) -> bool:
    """Return whether layers that are connected alike have the same filters and splines.

    Examples
    --------
    >>> layers = jl.Network.initial(jl.Sensor()).layers
    >>> changed = dataclasses.replace(layers[0], filters=2 * layers[0].filters)
    >>> have_equal_parameters(layers, layers), have_equal_parameters([changed, layers[1]], layers)
    (True, False)
    """
    return all(
        np.array_equal(layer.filters, other.filters)
        and (
            layer.coefficients is None
            or np.array_equal(layer.coefficients, other.spline_coefficients)
        )
        for layer, other in zip(layers, others, strict=True)
    )


def _read_only_float32(name: str, value: Any, dimensions: int) -> npt.NDArray[np.float32]:
    """Return a read-only float32 copy, after checks of dtype, dimensions, and range."""
    array = to_array(name, value)
    if array.dtype.kind != "f" or array.ndim - dimensions not in (0, 1) or array.size == 0:
        raise ValueError(
            f"{name}: expected floats of {dimensions} dimensions, got {array.dtype} "
            f"of shape {array.shape}"
        )
    with np.errstate(over="ignore"):
        array = frozen(array, np.float32)
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite numbers in the range of float32")
    return array
