"""What networks are made of: filter banks, each followed by pointwise cubic B-splines."""

import dataclasses
import functools
import operator
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
    def set_counts(self) -> set[int]:
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

    def metadata(self) -> dict[str, Any]:
        """Give what JSON can hold of it: all but the arrays."""
        left_out = {"filters", "coefficients"}
        if self.coefficients is None:
            left_out |= {"start", "spacing"}
        names = [field.name for field in dataclasses.fields(self) if field.name not in left_out]
        return {name: getattr(self, name) for name in names}

    def to_engine(
        self, filters: npt.NDArray[np.floating], coefficients: npt.NDArray[np.floating] | None
    ) -> Any:
        """Give the layer as the engine takes it, with these numbers."""
        wiring = self.stride, self.upsampling, self.input, self.skip
        return filters, coefficients, self.start, self.spacing, wiring

    @functools.cached_property
    def engine_layer(self) -> engine.Layer:
        """The layer in the engine, which brings its filters into order once."""
        return engine.Layer(self.to_engine(self.filters, self.coefficients))

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave out what the engine made, for `pickle` and `copy`."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return functools.partial(type(self), **fields), ()

    @property
    def parameter_count(self) -> int:
        """Taps and coefficients."""
        return self.filters.size + (0 if self.coefficients is None else self.coefficients.size)

    @property
    def padding(self) -> tuple[int, int]:
        """Rows and columns before the first that belongs to an output alone, which it reads too."""
        _, _, height, width = self.shape
        return (height - self.stride) // 2, (width - self.stride) // 2


TRAINABLE = "all", "filters", "nothing"

_STEPS = 16
"""The largest stride and upsampling."""


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
