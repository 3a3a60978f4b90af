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

import jotlight._engine as engine
from jotlight.chunks import frame_chunks, pixel_chunks
from jotlight.estimators.inpaint import inpaint_dead_pixels
from jotlight.estimators.inverse_response import (
    equivalent_counts,
    intensity_from_probability,
)
from jotlight.networks.architectures import (
    ARCHITECTURES,
    Architecture,
    build_conditional,
    build_residual,
    build_two_layer,
)
from jotlight.networks.conditioning import conditioning_weights, count_sets
from jotlight.networks.graph import flops_per_pixel, halo_radius, size_divisor
from jotlight.networks.layer import Layer
from jotlight.sensing.bits import Bits, check_fits
from jotlight.sensing.pixel_counts import PixelCounts, carried_sensor, count_pixels, map_channels
from jotlight.sensing.reference import reference_jot
from jotlight.sensing.sensor import Sensor
from jotlight.tensors import read_tensors, write_tensors

_FORMAT = "jotlight network"
_VERSION = "3"
_WORK = 1 << 35
"""Operations of the engine between two looks at Ctrl-C."""
_AT_ONCE = 1 << 21
"""Pixels whose intensities are found at a time."""


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
        *,
        trials_range: tuple[int, int] | None = None,
    ) -> None:
        self.layers = tuple(layers)
        self.sensor = sensor
        self.trials_range = trials_range
        self.history = dict(history or {})
        # The layers for the K that was told last: films have one.
        self._last: tuple[int, tuple[Layer, ...], tuple[Layer, ...]] | None = None
        if not self.layers:
            raise ValueError("layers: expected at least one, got none")
        block = (sensor.frames, sensor.oversampling, sensor.oversampling)
        first = self.layers[0].shape[1:]
        if first not in ((1, 1, 1), block):
            raise ValueError(
                f"layers: expected filters of shape (C, {', '.join(map(str, block))}) in the first "
                f"layer, or (C, 1, 1, 1) when it is tied, got {self.layers[0].filters.shape}"
            )
        size_divisor(self.layers)
        if trials_range is None and any(layer.set_counts for layer in self.layers):
            raise ValueError(
                "trials_range: expected a range of bits per pixel for layers with sets of parameters, got "
                "none"
            )
        if trials_range is not None:
            count_sets(self.layers)
            if not (self.tied and 1 <= trials_range[0] < trials_range[1]):
                raise ValueError(
                    "trials_range: expected the least and the most bits per pixel of a tied network, got "
                    f"{trials_range}"
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
        layers = build_two_layer(sensor, sigma, tied, taps, coefficients, nu)
        return cls(layers, sensor, {"start": f"initial parameters of the paper, sigma = {sigma}"})

    @classmethod
    def residual(
        cls, sensor: Sensor, architecture: str = "small", *, rng: int | None = None
    ) -> Self:
        """A build_residual member of the family at its start, x0 = P⁻¹(G * L/K): a classical estimate.

        Its filters are random, but for the last, which are 0; training with
        :mod:`jotlight.torch` makes it better.

        Parameters
        ----------
        sensor : Sensor
            The sensor; maps enter by their medians.
        architecture : {"small", "medium", "large"}
            How many layers and channels: :data:`jotlight.networks.architectures.ARCHITECTURES`.
        rng : int, optional
            The seed of the filters. Default: a new one.
        """

        def intensity(share: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
            clipped = share.clip(0, 1).astype(np.float32)
            return intensity_from_probability(clipped, sensor, None).astype(np.float64)

        bits, most = sensor.bits_per_pixel, float(sensor.max_intensity)
        layers = build_residual(
            _architecture(architecture), bits, intensity, most, np.random.default_rng(rng)
        )
        return cls(
            layers, sensor, {"start": f"{architecture}, starts at the smoothed, inverted counts"}
        )

    @classmethod
    def conditional(
        cls,
        architecture: str = "medium",
        *,
        trials_range: tuple[int, int] = (1, 256),
        rng: int | None = None,
    ) -> Self:
        """A build_residual member at its start, for any K of a range and any exposure: it is told K.

        Parameters
        ----------
        architecture : {"small", "medium", "large"}
            How many layers and channels: :data:`jotlight.networks.architectures.ARCHITECTURES`.
        trials_range : (int, int)
            The least and the most bits per pixel.
        rng : int, optional
            The seed of the filters. Default: a new one.
        """
        layers = build_conditional(
            _architecture(architecture), trials_range, np.random.default_rng(rng)
        )
        history = {
            "start": f"{architecture}, conditional on K; starts at the smoothed, stabilized counts"
        }
        return cls(layers, Sensor(), history, trials_range=trials_range)

    @property
    def tied(self) -> bool:
        """Whether the first layer has one weight for the whole block, and so takes counts too."""
        return self.layers[0].shape[1:] == (1, 1, 1)

    @property
    def halo(self) -> int:
        """Pixels around a pixel that its estimate depends on.

        Inside of a border of this width a tile has the pixels of the whole, but for rounding.
        """
        return halo_radius(self.layers)

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
            sensor = carried_sensor(data) or self.sensor
        self.check_sensor(sensor)
        if self.trials_range is not None:
            picture = self.conditioned_on(sensor).reconstruct(data, sensor, threads=threads)
            # In its own place, since memory may not hold it twice.
            for rows in pixel_chunks(len(picture), max(1, _AT_ONCE * len(picture) // picture.size)):
                picture[rows] = intensity_from_probability(picture[rows], sensor, threads)
            return picture

        def one_channel(data: Bits | npt.NDArray[np.int32]) -> npt.NDArray[np.float32]:
            if not self.tied:
                return self._of_jots(data, sensor, threads)
            # The network's own dark counts; its efficiency is that of the data, as was checked.
            reference = reference_jot(sensor)[0], reference_jot(self.sensor)[1]
            pixels = math.prod(data.shape[-2:]) // sensor.oversampling**2
            if not sensor.maps() and sensor.bits_per_pixel < pixels:
                return self._of_few(data, sensor, reference, threads)
            seen = count_pixels(data, sensor, threads)
            sums = self._weights[:, None] * equivalent_counts(seen, reference, threads)
            return self._of_sums(sums, threads)

        return map_channels(one_channel, data)

    def conditioned_on(self, sensor: Sensor) -> "Network":
        """The network that was told the sensor's K; its picture is the share of bits that fire."""
        assert self.trials_range is not None, "a network that is told K"
        bits, last = sensor.bits_per_pixel, self._last
        if last is None or last[0] != bits or last[1] is not self.layers:
            weights = conditioning_weights(bits, self.trials_range, count_sets(self.layers))
            first, *others = (layer.interpolate(weights) for layer in self.layers)
            first = dataclasses.replace(first, filters=first.filters / np.float32(bits))
            self._last = last = bits, self.layers, (first, *others)
        return Network(last[2], sensor)

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
        seen = PixelCounts(sensor, every, sensor.bits_per_pixel, *jot, varies_within_pixels=False)
        sums = self._weights * equivalent_counts(seen, reference, threads)
        side = sensor.oversampling
        if isinstance(data, Bits):
            check_fits(data, sensor)
            shape = tuple(size // side for size in data.shape[1:3])
        else:
            data = count_pixels(data, sensor, threads).counts
            shape = data.shape

        def of_rows(rows: slice) -> npt.NDArray[np.float32]:
            if isinstance(data, Bits):
                part = Bits(data.packed[:, rows.start * side : rows.stop * side], data.width)
                counts = part.counts(side, threads=threads)
            else:
                counts = data[rows]
            return engine.forward_counts(self._layers, counts, sums, threads)

        return self._in_parts(shape, of_rows)

    @property
    def _layers(self) -> list[engine.Layer]:
        return [layer.engine_layer for layer in self.layers]

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
                lambda rows: engine.forward_bits(self._layers, jots(rows), data.width, threads),
            )
        valid = np.packbits(~mask, axis=1)
        sums = np.empty((len(filters), height, width), np.float32)
        for _, part in frame_chunks(1, height, width * filters.size):
            rows = slice(part.start, part.stop)
            sums[:, rows] = engine.masked_sums(
                self.layers[0].engine_layer,
                jots(rows),
                data.width,
                valid[rows.start * side : rows.stop * side],
                threads,
            )
        # Blind in one plane, blind in all.
        blind = np.isnan(sums[0])
        if blind.any():
            sums = np.stack([inpaint_dead_pixels(plane, blind) for plane in sums])
        return self._of_sums(sums, threads)

    def _of_sums(
        self, sums: npt.NDArray[np.float32], threads: int | None
    ) -> npt.NDArray[np.float32]:
        """The picture from p, (C, H, W)."""
        return self._in_parts(
            sums.shape[1:], lambda rows: engine.forward(self._layers, sums[:, rows], threads)
        )

    def _in_parts(
        self, shape: tuple[int, ...], of_rows: Callable[[slice], npt.NDArray[np.float32]]
    ) -> npt.NDArray[np.float32]:
        """The picture, some rows at a time, each with the rows around it that it is made of."""
        height, width = shape
        top, bottom = engine.input_rows(self._layers, height, (height // 2, height // 2 + 1))
        rows = max(8 * (bottom - top), int(_WORK / (flops_per_pixel(self.layers) * width)))
        if rows >= height:
            return of_rows(slice(0, height))
        picture = np.empty((height, width), np.float32)
        for start in range(0, height, rows):
            stop = min(start + rows, height)
            top, bottom = engine.input_rows(self._layers, height, (start, stop))
            part = of_rows(slice(top, bottom))
            picture[start:stop] = part[start - top : stop - top]
        return picture

    def check_sensor(self, sensor: Sensor) -> None:
        """A tied network serves jots in space and frames in time alike."""
        mine, its = self.sensor, sensor
        if (
            self.trials_range is not None
            and not self.trials_range[0] <= its.bits_per_pixel <= self.trials_range[1]
        ):
            raise ValueError(
                f"sensor: the network is for {self.trials_range[0]} to {self.trials_range[1]} bits per pixel, got "
                f"{its.bits_per_pixel}"
            )
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
        if self.trials_range is not None:
            return
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
            if layer.coefficients is not None:
                tensors[f"layers.{index}.coefficients"] = layer.coefficients
        for name, map_ in self.sensor.maps().items():
            tensors[f"sensor.{name}"] = np.ascontiguousarray(map_)
        metadata = {
            "format": _FORMAT,
            "version": _VERSION,
            "layers": json.dumps([layer.metadata() for layer in self.layers]),
            "sensor": json.dumps(self.sensor.scalars()),
            "trials_range": json.dumps(self.trials_range),
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
            layers = [
                Layer(
                    tensors[f"layers.{index}.filters"],
                    tensors[f"layers.{index}.coefficients"] if "start" in numbers else None,
                    **numbers,
                )
                for index, numbers in enumerate(json.loads(metadata["layers"]))
            ]
            maps = {
                name.removeprefix("sensor."): tensor
                for name, tensor in tensors.items()
                if name.startswith("sensor.")
            }
            sensor = Sensor.from_parts(json.loads(metadata["sensor"]), maps)
            trials_range = json.loads(metadata["trials_range"])
            if trials_range is not None:
                low, high = map(operator.index, trials_range)
                trials_range = low, high
            return cls(layers, sensor, json.loads(metadata["history"]), trials_range=trials_range)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise ValueError(f"{path}: damaged network file: {error}") from error

    def __repr__(self) -> str:
        channels = " -> ".join(str(layer.channels) for layer in self.layers)
        parameters = sum(layer.parameter_count for layer in self.layers)
        whose = repr(self.sensor)
        if self.trials_range is not None:
            whose = f"{self.trials_range[0]} to {self.trials_range[1]} bits per pixel"
        return f"<Network: channels {channels}, {parameters} parameters, for {whose}>"


def _architecture(name: str) -> Architecture:
    if name not in ARCHITECTURES:
        raise ValueError(f"architecture: expected one of {', '.join(ARCHITECTURES)}, got {name!r}")
    return ARCHITECTURES[name]


def _detections(sensor: Sensor) -> tuple[int, float, float]:
    """q, detections per jot and frame at intensity 1, and S."""
    threshold, light, most = sensor.pixel_response()
    return threshold, reference_jot(sensor)[0] * light, most
