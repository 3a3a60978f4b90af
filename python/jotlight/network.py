"""The learned method: linear filters and cubic B-splines, started at the classical pipeline."""

import dataclasses
import json
import math
import operator
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from jotlight import _engine, vst
from jotlight.bits import Bits, check_fits
from jotlight.channels import by_channel
from jotlight.fill import fill_blind
from jotlight.mle import equivalent_counts, from_probability, reference_jot
from jotlight.observation import Observation, observe
from jotlight.sensor import Sensor
from jotlight.slabs import slabs_of
from jotlight.tensors import read_tensors, write_tensors

_FORMAT = "jotlight network"
_VERSION = "1"
_TAPS = 1 << 31
"""Products of a tap and a pixel that the engine forms between two looks at Ctrl-C."""


@dataclasses.dataclass(frozen=True, eq=False)
class Layer:
    """A filter bank followed by one pointwise cubic B-spline per output channel.

    Parameters
    ----------
    filters : ndarray of float32, shape (C_out, C_in, height, width)
        The first layer reads bits with stride K̂: its shape is (C_out, T, K̂, K̂), or
        (C_out, 1, 1, 1) when it is tied, one weight for the whole block. Later layers convolve
        with stride 1.
    coefficients : ndarray of float32, shape (C_out, N_w)
        N_w of at least 4.
    start, spacing : float
        The spline φ(z) = Σ_k w_k β3((z - start)/spacing - (k - 1)) lives on
        [start, start + (N_w - 3) spacing] and is constant outside of it.

    Raises
    ------
    ValueError
        When shapes or numbers do not fit.
    """

    filters: npt.NDArray[np.float32]
    coefficients: npt.NDArray[np.float32]
    start: float
    spacing: float

    def __post_init__(self) -> None:
        for name, dimensions in (("filters", 4), ("coefficients", 2)):
            array = np.asarray(getattr(self, name))
            if array.dtype.kind != "f" or array.ndim != dimensions or array.size == 0:
                raise ValueError(
                    f"{name}: expected floats of {dimensions} dimensions, got {array.dtype} "
                    f"of shape {array.shape}"
                )
            with np.errstate(over="ignore"):
                array = np.require(array, np.float32, ["C", "A"])
            if not np.isfinite(array).all():
                raise ValueError(f"{name}: expected finite numbers in the range of float32")
            object.__setattr__(self, name, array)
        if len(self.coefficients) != len(self.filters) or self.coefficients.shape[1] < 4:
            raise ValueError(
                f"coefficients: expected {len(self.filters)} rows, one per filter, of at least 4, "
                f"got shape {self.coefficients.shape}"
            )
        single = np.finfo(np.float32)
        least, most = float(single.tiny), float(single.max)
        if not (abs(self.start) <= most and least <= self.spacing <= most):
            raise ValueError(
                "start and spacing: expected finite numbers in the range of float32, the spacing "
                f"above 0, got {self.start} and {self.spacing}"
            )


class Network:
    """A reconstruction network for one sensor: equations (8) to (11), and any number of layers.

    Parameters
    ----------
    layers : sequence of Layer
        Each one's input channels are the output channels of the one before; the last has one.
    sensor : Sensor
        What the network is for.
    history : mapping, optional
        How it came to be; anything that JSON can hold.

    Raises
    ------
    ValueError
        When the layers do not fit each other or the sensor.

    Examples
    --------
    >>> sensor = Sensor(oversampling=4)
    >>> bits = sensor.expose(np.full((20, 30), 0.5), rng=0)
    >>> Network.initial(sensor).reconstruct(bits).shape
    (20, 30)
    """

    def __init__(
        self,
        layers: Sequence[Layer],
        sensor: Sensor,
        history: Mapping[str, Any] | None = None,
    ) -> None:
        self.layers = tuple(layers)
        self.sensor = sensor
        self.history = dict(history or {})
        if not self.layers:
            raise ValueError("layers: expected at least one, got none")
        block = (sensor.frames, sensor.oversampling, sensor.oversampling)
        first = self.layers[0].filters.shape[1:]
        if first not in ((1, 1, 1), block):
            raise ValueError(
                f"layers: expected filters of shape (C, {', '.join(map(str, block))}) in the first "
                f"layer, or (C, 1, 1, 1) when it is tied, got {self.layers[0].filters.shape}"
            )
        for index, (before, layer) in enumerate(zip(self.layers, self.layers[1:], strict=False), 1):
            if layer.filters.shape[1] != before.filters.shape[0]:
                raise ValueError(
                    f"layers: expected {before.filters.shape[0]} input channels in layer {index}, "
                    f"got filters of shape {layer.filters.shape}"
                )
        if len(self.layers[-1].filters) != 1:
            raise ValueError(
                f"layers: expected one output channel of the last layer, "
                f"got {len(self.layers[-1].filters)}"
            )

    @classmethod
    def initial(
        cls,
        sensor: Sensor,
        *,
        sigma: float = 0.7,
        tied: bool = True,
        taps: int = 15,
        coefficients: int = 150,
        nu: float = 0.5,
    ) -> Self:
        """The paper's two-layer network at its initial parameters (section 3.2).

        It is the non-iterative method with a Gaussian as denoiser and the algebraic inverse:
        h1 = 1 (20), φ1 = T (6), h2 a Gaussian, and φ2 = (K/α)(P⁻¹(q, T⁻¹(z)/K) - d)/η clipped to
        [0, S].

        Parameters
        ----------
        sensor : Sensor
            The sensor; a map of dark counts enters by its median.
        sigma : float
            Standard deviation of h2 in pixels; the paper takes 0.25 to 1.
        tied : bool
            Whether one weight serves the whole block of h1. With the box kernel the bits of a pixel
            are exchangeable, so nothing is lost, and counts can be reconstructed too.
        taps : int
            Height and width of h2, odd.
        coefficients : int
            N_w, the coefficients of each spline.
        nu : float
            ν: room for learning. φ2 is laid out for every r that filters with taps of both signs
            can give, as long as their negative taps sum to -ν at most; outside of what a Gaussian
            gives it starts constant.

        Notes
        -----
        The spline coefficients are least-squares fits; those of φ2 are kept from falling and
        clipped to [0, S], so that every output lies there.
        """
        if not (math.isfinite(sigma) and sigma > 0):
            raise ValueError(f"sigma: expected a number above 0, got {sigma}")
        taps, coefficients = operator.index(taps), operator.index(coefficients)
        if taps < 1 or taps % 2 == 0:
            raise ValueError(f"taps: expected an odd number, got {taps}")
        if coefficients < 5:
            raise ValueError(f"coefficients: expected at least 5, got {coefficients}")
        if not (math.isfinite(nu) and nu >= 0):
            raise ValueError(f"nu: expected a number of 0 or more, got {nu}")
        bits = sensor.bits_per_pixel

        from scipy.optimize import isotonic_regression

        low, high = vst.stabilise([0, bits], bits).astype(float)

        def intensity(z: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
            counts = vst.invert(z.clip(low, high), bits, inverse="algebraic")
            return from_probability(counts / np.float32(bits), sensor, None).astype(np.float64)

        block = (1, 1, 1) if tied else (sensor.frames, sensor.oversampling, sensor.oversampling)
        first = _fitted(
            lambda counts: vst.stabilise(counts, bits).astype(np.float64), 0.0, bits, coefficients
        )
        # A spline stays in the hull of its coefficients, so u lies there, and r not far from there.
        least, most = float(first[0].min()), float(first[0].max())
        room = nu * (most - least)
        second = _fitted(intensity, least - room, most + room, coefficients)
        # At the ends of [0, S] the fit swings a little; more light never gives less.
        rising = isotonic_regression(second[0][0]).x[None].astype(np.float32)
        second = (rising.clip(0, sensor.max_intensity), *second[1:])
        line = np.exp(-0.5 * (np.arange(taps) - taps // 2) ** 2 / sigma**2)
        gaussian = np.outer(line, line) / line.sum() ** 2
        # Far below the rounding of the sum; smaller still, processors would take ages over them.
        gaussian[gaussian < 1e-12] = 0
        return cls(
            [
                Layer(np.ones((1, *block), np.float32), *first),
                Layer(gaussian[None, None].astype(np.float32), *second),
            ],
            sensor,
            {"start": f"initial parameters of the paper, sigma = {sigma}"},
        )

    @property
    def tied(self) -> bool:
        """Whether the first layer has one weight for the whole block, and so takes counts too."""
        return self.layers[0].filters.shape[1:] == (1, 1, 1)

    @property
    def halo(self) -> int:
        """Pixels around a pixel that its estimate depends on.

        A tile with a border of this width has exactly the pixels of the whole inside of the border.
        """
        return sum(max(layer.filters.shape[2:]) // 2 for layer in self.layers[1:])

    def reconstruct(
        self,
        data: Bits | npt.ArrayLike,
        sensor: Sensor | None = None,
        *,
        threads: int | None = None,
    ) -> npt.NDArray[np.float32]:
        """Run the network.

        Parameters
        ----------
        data : Bits or array_like of int
            Bits, or for a tied network also an image of counts L of shape (H, W) or (H, W, C).
        sensor : Sensor, optional
            The sensor of these data, which may have dead jots and dark counts of its own. Default:
            the one that the bits carry, or else the network's.
        threads : int, optional
            Threads to use. Default: all.

        Returns
        -------
        ndarray of float32, shape (H, W) or (H, W, C)

        Raises
        ------
        TypeError, ValueError
            When the data, their sensor and the network do not fit.

        Warns
        -----
        JotlightWarning
            When pixels without a valid jot were filled from their neighbours.
        """
        if sensor is None:
            sensor = (data.sensor if isinstance(data, Bits) else None) or self.sensor
        self._check_sensor(sensor)

        def one_channel(data: Bits | npt.NDArray[np.int32]) -> npt.NDArray[np.float32]:
            if not self.tied:
                return self._of_jots(data, sensor, threads)
            # The network's own dark counts; its efficiency is that of the data, as was checked.
            reference = reference_jot(sensor)[0], reference_jot(self.sensor)[1]
            pixels = math.prod(data.shape[-2:]) // sensor.oversampling**2
            if not sensor.maps() and sensor.bits_per_pixel < pixels:
                return self._of_few(data, sensor, reference, threads)
            seen = observe(data, sensor, threads)
            sums = self._weights[:, None] * equivalent_counts(seen, reference, threads)
            return self._of_sums(sums, threads)

        return by_channel(one_channel, data)

    @property
    def _weights(self) -> npt.NDArray[np.float32]:
        """The one weight of each filter of a tied first layer, (C, 1)."""
        return self.layers[0].filters.reshape(-1, 1)

    def _of_few(
        self,
        data: Bits | npt.NDArray[np.int32],
        sensor: Sensor,
        reference: tuple[float, float],
        threads: int | None,
    ) -> npt.NDArray[np.float32]:
        """The picture of a tied network where p is a function of the count alone."""
        every = np.arange(sensor.bits_per_pixel + 1, dtype=np.int32)
        jot = reference_jot(sensor)
        seen = Observation(sensor, every, sensor.bits_per_pixel, *jot, jots_differ=False)
        sums = self._weights * equivalent_counts(seen, reference, threads)
        side = sensor.oversampling
        if isinstance(data, Bits):
            check_fits(data, sensor)
            shape = tuple(size // side for size in data.shape[1:3])
        else:
            data = observe(data, sensor, threads).counts
            shape = data.shape

        def of_rows(rows: slice) -> npt.NDArray[np.float32]:
            if isinstance(data, Bits):
                part = Bits(data.packed[:, rows.start * side : rows.stop * side], data.width)
                counts = part.counts(side, threads=threads)
            else:
                counts = data[rows]
            return _engine.forward_counts(self._layers, counts, sums, threads)

        return self._in_parts(shape, of_rows)

    @property
    def _layers(self) -> list[Any]:
        return [(x.filters, x.coefficients, x.start, x.spacing) for x in self.layers]

    def _of_jots(
        self, data: Bits | npt.NDArray[np.int32], sensor: Sensor, threads: int | None
    ) -> npt.NDArray[np.float32]:
        """The picture of a network that weighs the jots of a pixel singly."""
        if not isinstance(data, Bits):
            raise TypeError(
                "data: expected Bits, since this network weighs the jots of a pixel singly; "
                "a tied network takes counts"
            )
        check_fits(data, sensor)
        reference = reference_jot(sensor)[0], reference_jot(self.sensor)[1]
        own = sensor.efficiency, sensor.dark_counts
        if any(np.any(a != b) for a, b in zip(own, reference, strict=True)):
            raise ValueError(
                "sensor: expected the dark counts that the network is for, and these and the "
                "efficiency to be one number for all jots; a tied network takes others"
            )
        mask, side, filters = sensor.mask, sensor.oversampling, self.layers[0].filters
        height, width = (size // side for size in data.shape[1:3])

        def jots(rows: slice) -> npt.NDArray[np.uint8]:
            return data.packed[:, rows.start * side : rows.stop * side]

        if mask is None or not mask.any():
            return self._in_parts(
                (height, width),
                lambda rows: _engine.forward_bits(self._layers, jots(rows), data.width, threads),
            )
        valid = np.packbits(~mask, axis=1)
        sums = np.empty((len(filters), height, width), np.float32)
        for _, part in slabs_of(1, height, width * filters.size):
            rows = slice(part.start, part.stop)
            sums[:, rows] = _engine.masked_sums(
                self._layers[0],
                jots(rows),
                data.width,
                valid[rows.start * side : rows.stop * side],
                threads,
            )
        # Blind in one plane, blind in all.
        blind = np.isnan(sums[0])
        if blind.any():
            sums = np.stack([fill_blind(plane, blind) for plane in sums])
        return self._of_sums(sums, threads)

    def _of_sums(
        self, sums: npt.NDArray[np.float32], threads: int | None
    ) -> npt.NDArray[np.float32]:
        """The picture from p, (C, H, W)."""
        return self._in_parts(
            sums.shape[1:], lambda rows: _engine.forward(self._layers, sums[:, rows], threads)
        )

    def _in_parts(
        self, shape: tuple[int, ...], of_rows: Callable[[slice], npt.NDArray[np.float32]]
    ) -> npt.NDArray[np.float32]:
        """The picture, some rows at a time: each part has a border of the halo's width."""
        height, width = shape
        taps = sum(layer.filters.size for layer in self.layers)
        rows = max(4 * self.halo, _TAPS // (taps * width), 1)
        if rows >= height:
            return of_rows(slice(0, height))
        picture = np.empty((height, width), np.float32)
        for start in range(0, height, rows):
            top, stop = max(0, start - self.halo), min(start + rows, height)
            part = of_rows(slice(top, min(stop + self.halo, height)))
            picture[start:stop] = part[start - top : stop - top]
        return picture

    def _check_sensor(self, sensor: Sensor) -> None:
        """A tied network serves jots in space and frames in time alike."""
        mine, its = self.sensor, sensor
        if not self.tied and (mine.oversampling, mine.frames) != (its.oversampling, its.frames):
            raise ValueError(
                f"sensor: the network is for {mine.frames} frames of {mine.oversampling} x "
                f"{mine.oversampling} jots per pixel, got {its.frames} frames of "
                f"{its.oversampling} x {its.oversampling}"
            )
        if mine.kernel != its.kernel:
            raise ValueError(
                f"sensor: the network is for the {mine.kernel} kernel, got {its.kernel}"
            )
        pairs = zip(_detections(mine), _detections(its), strict=True)
        if mine.bits_per_pixel != its.bits_per_pixel or not all(
            math.isclose(a, b, rel_tol=1e-9) for a, b in pairs
        ):
            raise ValueError(
                "sensor: the network needs data with its own bits per pixel, threshold, "
                f"efficiency * gain / bits and max_intensity: it is for {mine!r}, got {its!r}"
            )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to a `.safetensors` file, with its sensor and history as metadata."""
        tensors: dict[str, npt.NDArray[Any]] = {}
        for index, layer in enumerate(self.layers):
            tensors[f"layers.{index}.filters"] = layer.filters
            tensors[f"layers.{index}.coefficients"] = layer.coefficients
        for name, map_ in self.sensor.maps().items():
            tensors[f"sensor.{name}"] = np.ascontiguousarray(map_)
        splines = [{"start": x.start, "spacing": x.spacing} for x in self.layers]
        metadata = {
            "format": _FORMAT,
            "version": _VERSION,
            "splines": json.dumps(splines),
            "sensor": json.dumps(self.sensor.numbers()),
            "history": json.dumps(self.history),
        }
        write_tensors(path, tensors, metadata)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a network that :meth:`save` wrote.

        Raises
        ------
        OSError
            When there is no such file.
        ValueError
            When it is not such a file. Nothing in it is run.
        """
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"there is no network file {path}")
        tensors, metadata = read_tensors(path, _FORMAT, _VERSION)
        try:
            splines = json.loads(metadata["splines"])
            layers = [
                Layer(
                    tensors[f"layers.{index}.filters"],
                    tensors[f"layers.{index}.coefficients"],
                    float(spline["start"]),
                    float(spline["spacing"]),
                )
                for index, spline in enumerate(splines)
            ]
            maps = {
                name.removeprefix("sensor."): tensor
                for name, tensor in tensors.items()
                if name.startswith("sensor.")
            }
            sensor = Sensor.from_parts(json.loads(metadata["sensor"]), maps)
            return cls(layers, sensor, json.loads(metadata["history"]))
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise ValueError(f"{path}: damaged network file: {error}") from error

    def __repr__(self) -> str:
        channels = " -> ".join(str(len(layer.filters)) for layer in self.layers)
        parameters = sum(x.filters.size + x.coefficients.size for x in self.layers)
        return f"<Network: channels {channels}, {parameters} parameters, for {self.sensor!r}>"


def _detections(sensor: Sensor) -> tuple[int, float, float]:
    """q, detections per jot and frame at intensity 1, and S."""
    threshold, light, most = sensor._response()
    return threshold, reference_jot(sensor)[0] * light, most


def _fitted(
    function: Callable[[npt.NDArray[np.float64]], npt.NDArray[np.float64]],
    low: float,
    high: float,
    number: int,
) -> tuple[npt.NDArray[np.float32], float, float]:
    """Coefficients (1, number), start and spacing of the least-squares spline on [low, high]."""
    from scipy.interpolate import make_lsq_spline

    spacing = (high - low) / (number - 3)
    knots = low + spacing * (np.arange(number + 4) - 3)
    # Eight samples to an interval, kept inside where rounding might put the last one out.
    samples = np.linspace(low, high, 8 * (number - 3) + 1).clip(knots[3], knots[-4])
    spline = make_lsq_spline(samples, function(samples), knots, k=3)
    return spline.c[None].astype(np.float32), float(low), float(spacing)
