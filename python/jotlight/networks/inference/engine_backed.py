"""The network of the engine behind a network of layers."""

import copy
import dataclasses
import operator
from typing import Any, ClassVar, Final, Self

import jotlight._engine as engine
from jotlight.networks.layer import Layer
from jotlight.networks.precision import DEEP, F32, check_precision
from jotlight.sensing.likelihood.reference import Jot, reference_jot
from jotlight.sensing.parameters.response import PixelResponse
from jotlight.sensing.sensor import Sensor

SensorModel = tuple[int, PixelResponse, Jot]
"""What the engine's network must know about a sensor: K, the response of a pixel, and its jot."""

_KEPT: Final = "_engine_network"
"""Name of the attribute with the engine's network, and with what it was made from."""


def sensor_model(sensor: Sensor) -> SensorModel:
    """Return what the engine's network must know about a sensor.

    Examples
    --------
    >>> trials, response, jot = sensor_model(jl.Sensor(frames=16))
    >>> trials, response
    (16, PixelResponse(threshold=1, light_per_intensity=1.0, max_intensity=1.0))
    >>> jot
    Jot(efficiency=1.0, dark_counts=0.0)
    """
    return sensor.trials, sensor.pixel_response(), reference_jot(sensor)


class EngineBacked:
    """A network that the engine evaluates, with the layers for every K."""

    layers: tuple[Layer, ...]
    sensor: Sensor
    trials_range: tuple[int, int] | None
    rotations: int
    history: dict[str, Any]
    precision: str = F32
    """Precision of the products, "f32" or "bf16". A file does not store it."""
    planes: ClassVar[int] = 0
    """Number of planes that the network reads, or 0 if it reads counts or bits."""

    @property
    def engine_network(self) -> engine.Network:
        """The network in the engine, which keeps the layers for the last few K.

        Raises
        ------
        ValueError
            When data exist for which a value in the network could overflow.
        """
        # No lock: a process that is forked meanwhile would wait for it forever. Two threads may
        # both create the network.
        source = self._source()
        kept = self.__dict__.get(_KEPT)
        if kept is None or not all(map(operator.is_, kept[0], source)):
            layers = [layer.to_engine(layer.filters, layer.coefficients) for layer in self.layers]
            model = sensor_model(self.sensor)
            network = engine.Network(
                layers, model, self.trials_range, self.planes > 0, self.rotations
            )
            self.__dict__[_KEPT] = kept = source, network.with_precision(self.precision)
        found: engine.Network = kept[1]
        return found

    def _source(self) -> tuple[object, ...]:
        """Return what the network in the engine is made from."""
        return self.layers, self.rotations, self.sensor, self.precision

    def with_precision(self, precision: str) -> Self:
        """Return the network with its products in a precision, "f32" or "bf16".

        In bfloat16, the filters of layers that read several planes, and these planes, are rounded
        to 8 bits of precision. Sums, splines, and the layers that read the data, or a single plane,
        remain in float32. The PSNR of photographs changes by 0.0006 dB or less on average. This is
        faster only on processors with AMX. Others emulate the rounding, in the time of "f32".

        Raises
        ------
        ValueError
            For an unknown precision, and for "bf16" if no layer reads several planes of a layer
            other than the first one, as in the network of two layers.

        Examples
        --------
        >>> jl.pretrained(jl.Sensor(frames=16)).with_precision("bf16").precision
        'bf16'
        """
        check_precision(precision)
        try:
            network = self.engine_network.with_precision(precision)
        except ValueError as error:
            raise ValueError(f"{error}; {DEEP}") from None
        changed = copy.copy(self)
        changed.precision = precision
        changed.__dict__[_KEPT] = changed._source(), network
        return changed

    def sharing_engine(self) -> Self:
        """Return a copy with attributes of its own, and with the same network of the engine."""
        copied = copy.copy(self)
        copied.history = copy.deepcopy(self.history)
        copied.__dict__[_KEPT] = self._source(), self.engine_network
        return copied

    @property
    def halo(self) -> int:
        """Radius of the receptive field in pixels.

        Except in a border of this width, the layers of a network return the same for a part of an
        image as for the whole, up to rounding. The part must begin at a multiple of the product of
        the strides, such as 4 for "medium", and its sides must be multiples, too. The estimate of a
        K-conditioned network may differ by more, because the mean and the brightest pixels of an
        image decide how its dark regions are estimated.
        """
        return self.engine_network.halo

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for `pickle` and `copy`, which reject the engine's network."""
        return {name: value for name, value in self.__dict__.items() if name != _KEPT}


class GrayNetwork(EngineBacked):
    """A network for gray images, which reads counts or bits."""

    @property
    def tied(self) -> bool:
        """Whether the first layer has one weight for all bits of a pixel and so accepts counts."""
        return self.layers[0].shape[1:] == (1, 1, 1)

    def conditioned_layers(self, trials: int, *, zeros: bool = False) -> tuple[Layer, ...]:
        """Return the layers of a K-conditioned network with the parameters for K = `trials`.

        They map counts to P(b = 1), or to P(b = 0) if `zeros`. The results can lie slightly outside
        of [0, 1].
        """
        assert self.trials_range, "a K-conditioned network"
        parameters = self.engine_network.conditioned(trials, zeros)
        return tuple(
            dataclasses.replace(layer, filters=filters, coefficients=coefficients)
            for layer, (filters, coefficients) in zip(self.layers, parameters, strict=True)
        )

    def estimates_zeros(self, sensor: Sensor) -> bool:
        """Return whether a K-conditioned network estimates P(b = 0) for a sensor.

        Near saturation, P(b = 1) is close to 1, and float32 holds only a few digits of
        1 - P(b = 1), on which the intensity depends. So for bright sensors, the network estimates
        P(b = 0) from the zeros. Its last spline, which maps to P(b = 1), is replaced by its
        complement.

        Examples
        --------
        >>> network = jl.Network.conditional("small", rng=0)
        >>> network.estimates_zeros(jl.Sensor()), network.estimates_zeros(jl.Sensor(gain=25.0))
        (False, True)
        """
        return self.engine_network.estimates_zeros(sensor_model(sensor))
