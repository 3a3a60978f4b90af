"""A network as a PyTorch module, which starts from a `jotlight.Network` and returns one."""

import os
from typing import Any, Self

import torch
from torch import Tensor, nn

from jotlight.networks.conditioning import conditioning_weights, count_sets
from jotlight.networks.graph import size_divisor
from jotlight.networks.inference.served_sensors import choose_sensor
from jotlight.networks.layer import Layer, have_equal_parameters
from jotlight.networks.layer_checks import refuse_rotations
from jotlight.networks.loading import require_network
from jotlight.networks.network import Network as EngineNetwork
from jotlight.networks.planes_network import ColorNetwork, FilmNetwork
from jotlight.networks.stages import with_stage
from jotlight.sensing.likelihood.reference import reference_jot
from jotlight.sensing.sensor import Sensor
from jotlight.torch.data_checks import as_floats, check_data, refuse_tracing
from jotlight.torch.estimates import (
    equivalent_counts,
    improve_coarse,
    improve_dim,
    intensity_from_complement,
    intensity_from_probability,
    is_bright,
    probability_of,
)
from jotlight.torch.filter_bank import convolve, correlate, knots_of, layer_specs
from jotlight.torch.padding import mirror_pad
from jotlight.torch.parameters import layer_parameters, with_parameters
from jotlight.torch.splines import accept_parameters_alone, check_knots, spline

_CHANGED = "parameters changed in PyTorch, and not measured since"
"""The stage in the history of a network that a loop of the user's own trained."""


class Network(nn.Module):
    """A network whose parameters PyTorch can train.

    It returns intensities in [0, S], as :class:`jotlight.Network` does, and they are
    differentiable. It computes in float32, also for a network whose precision is "bf16", and
    :meth:`to_network` returns a network of the same precision.

    Parameters
    ----------
    source : jotlight.Network or path
        The network to start from, or the `.safetensors` file that holds it. :meth:`to_network`
        returns it unchanged before any training.
    device : torch.device, str, or int, optional
        Device of the parameters, as in ``torch.nn.Module.to``. Default: the CPU.

    Raises
    ------
    OSError, TypeError, ValueError
        When the file does not exist or is not a network file, or the source is not a network.

    Examples
    --------
    >>> import jotlight as jl
    >>> sensor = jl.Sensor(oversampling=4)
    >>> network = jl.torch.Network(jl.pretrained(sensor))
    >>> network(torch.full((1, 1, 20, 30), 8.0)).shape
    torch.Size([1, 1, 20, 30])
    """

    load_network = staticmethod(EngineNetwork.load)
    """Function that reads the network of the engine from a file; a subclass can replace it."""

    def __init__(
        self,
        source: EngineNetwork | str | os.PathLike[str],
        *,
        device: torch.device | str | int | None = None,
    ) -> None:
        super().__init__()
        network = self.load_network(source) if isinstance(source, str | os.PathLike) else source
        kinds = EngineNetwork | ColorNetwork | FilmNetwork
        call = "jotlight.torch.Network(jotlight.pretrained(sensor))"
        require_network("source", network, kinds, call)
        refuse_rotations(network.rotations, "PyTorch modules")
        self.origin = network
        self.filter_dtype = torch.float32
        """Data type of the products in filter banks, for training."""
        layers = network.layers
        # The forward pass must not read NumPy arrays: torch.compile takes them for tensors, which
        # fails in its inference mode.
        self.layer_specs = layer_specs(layers)
        self._size_divisor, self._sets = size_divisor(layers), count_sets(layers)
        self._trials_range = network.trials_range
        self._is_tied, self._dark_counts = network.tied, reference_jot(network.sensor).dark_counts
        self._pixel_side = 1 if network.tied else network.sensor.oversampling
        self.filters, self.coefficients = layer_parameters(layers)
        self.register_load_state_dict_post_hook(accept_parameters_alone)
        self.to(device)

    @classmethod
    def load(
        cls, path: str | os.PathLike[str], *, device: torch.device | str | int | None = None
    ) -> Self:
        """Return the network in a `.safetensors` file, on a device. It is ``Network(path)``.

        The parameters and errors are those of the class.
        """
        return cls(path, device=device)

    def __getattr__(self, name: str) -> Any:
        if hasattr(EngineNetwork, name):
            text = f"{type(self).__name__!r} object has no attribute {name!r}; "
            raise AttributeError(f"{text}write module.to_network().{name}", name=name, obj=self)
        return super().__getattr__(name)

    def get_extra_state(self) -> Tensor:
        """Return the knots of all layers, which `state_dict` holds beside the parameters."""
        return knots_of(self.layer_specs)

    def set_extra_state(self, state: Tensor) -> None:
        """Raise ValueError for a state of a network with other knots, in `load_state_dict`."""
        check_knots(state, self.get_extra_state(), "the network whose state it is")

    def forward(self, data: Tensor, sensor: Sensor | None = None) -> Tensor:
        """Return intensities in [0, S], shape (N, 1, H, W), as the engine's network does.

        In dim scenes, the engine's network combines several trials into one, and sums the bits of
        squares of pixels. So does this one if no gradients are recorded, but not under
        torch.compile or torch.onnx.export.

        Parameters
        ----------
        data : Tensor
            Counts L (N, 1, H, W) for a tied network, or bits (N, T, H·K̂, W·K̂) for a network with
            one weight per jot. Numbers need not be whole.
        sensor : Sensor, optional
            Sensor of the data, without maps of its jots. Default: the one for which
            :func:`jotlight.pretrained` was called, else the network's.

        Raises
        ------
        TypeError, ValueError
            When the data are not a tensor or have another shape, when the network does not serve
            the sensor, when the sensor has maps, or when there is no sensor for a K-conditioned
            network. When counts are not from 0 to K, or bits not from 0 to 1. Data that need a
            gradient, and code under torch.compile, are not checked.

        RuntimeError
            Under torch.jit.trace.

        Warns
        -----
        JotlightWarning
            When the data look like means in place of counts.
        """
        refuse_tracing()
        sensor = self._sensor_of(data, sensor)
        data = as_floats(data)
        if self._trials_range is not None:
            found = self._estimate(data, sensor)
            # Training passes no errors through combined trials and squares. A graph must not depend
            # on the values of the data.
            is_graph = torch.compiler.is_compiling() or torch.onnx.is_in_onnx_export()
            if torch.is_grad_enabled() or is_graph:
                return found
            found = improve_dim(self.run_layers, found, data, sensor, self._trials_range)
            return improve_coarse(self.forward, found, data, sensor)
        if reference_jot(sensor).dark_counts != self._dark_counts:
            data = equivalent_counts(data, sensor, self._dark_counts)
        return self.run_layers(data).clamp(0, sensor.max_intensity)

    def _estimate(self, data: Tensor, sensor: Sensor) -> Tensor:
        """Return the intensities of a K-conditioned network, without combined trials."""
        assert self._trials_range, "a K-conditioned network"
        if str(len(self.filters) - 1) in self.coefficients and is_bright(sensor):
            zeros = sensor.trials - data
            zeros = probability_of(self._run_zeros, zeros, sensor.trials, self._trials_range)
            return intensity_from_complement(zeros, sensor)
        probability = probability_of(self.run_layers, data, sensor.trials, self._trials_range)
        return intensity_from_probability(probability, sensor)

    def run_layers(self, data: Tensor, trials: int | None = None) -> Tensor:
        """Return the output of the last layer, shape (N, 1, H, W).

        It is the intensity, not clipped to [0, S], or the probability P(b = 1) for a K-conditioned
        network.

        Parameters
        ----------
        data : Tensor
            Counts or bits, as for :meth:`forward`.
        trials : int, optional
            K, for K-conditioned networks alone.

        Raises
        ------
        TypeError, ValueError
            When K is missing for a K-conditioned network, present for another one, or a sensor.
        """
        filters, coefficients = self._interpolate(trials)
        sums = self._filter_all(data, filters, coefficients)
        return self.activate(-1, sums, coefficients[-1])

    def _run_zeros(self, zeros: Tensor, trials: int) -> Tensor:
        """Return P(b = 0) for counts of zeros, as the engine does for bright sensors."""
        filters, coefficients = self._interpolate(trials, is_zeros=True)
        sums = self._filter_all(trials - zeros, filters, coefficients)
        return self.activate(-1, sums, coefficients[-1])

    def last_sums(self, data: Tensor, trials: int | None = None) -> Tensor:
        """Return the input of the last spline, shape (N, 1, H, W).

        The parameters and errors are those of :meth:`run_layers`.
        """
        return self._filter_all(data, *self._interpolate(trials))

    def activate(self, index: int, sums: Tensor, coefficients: Tensor | None) -> Tensor:
        """Return φ(sums) for a layer; a subclass can override it with another nonlinearity.

        Parameters
        ----------
        index : int
            Index of the layer.
        sums : Tensor, shape (N, C, H, W)
            Filtered channels, with those of the skip connection.
        coefficients : Tensor, shape (C, N_w), or None
            None: the layer has no splines.
        """
        if coefficients is None:
            return sums
        spec = self.layer_specs[index]
        return spline(sums, coefficients, spec.start, spec.spacing)

    def to_network(self) -> EngineNetwork:
        """Return a network of the engine with a copy of the parameters, for example to save it.

        If they are not those that the module started with, the last of the `stages` in its
        `history` says so. The runs before it state the values of other parameters.
        """
        layers = with_parameters(self.origin.layers, self.filters, self.coefficients)
        network = self.rebuild(layers).with_precision(self.origin.precision)
        if not have_equal_parameters(layers, self.origin.layers):
            network.history = with_stage(network.history, _CHANGED)
        return network

    def rebuild(self, layers: list[Layer]) -> EngineNetwork:
        """Return a network of the engine with other layers; a subclass can override it."""
        origin = self.origin
        range_ = origin.trials_range
        network = EngineNetwork(layers, origin.sensor, origin.history, trials_range=range_)
        network.default_sensor = origin.default_sensor
        return network

    def _sensor_of(self, data: Tensor, sensor: Sensor | None) -> Sensor:
        """Return the sensor of the data, after checks."""
        origin = self.origin
        sensor = choose_sensor(
            sensor or origin.default_sensor, origin.sensor, self._trials_range, tied=self._is_tied
        )
        check_data(data, sensor, self._pixel_side, is_bits=not self._is_tied)
        return sensor

    def _filter_all(
        self, data: Tensor, filters: list[Tensor], coefficients: list[Tensor | None]
    ) -> Tensor:
        """Return the input of the last spline."""
        sums = self.first_sums(data.to(filters[0].dtype), filters[0])
        height, width = sums.shape[-2:]
        divisor = self._size_divisor
        sums = mirror_pad(sums, (0, -height % divisor), (0, -width % divisor))
        outputs: list[Tensor] = []
        for index, spec in enumerate(self.layer_specs):
            if index:
                outputs.append(self.activate(index - 1, sums, coefficients[index - 1]))
                sums = convolve(outputs[spec.input], filters[index], spec, self.filter_dtype)
            if spec.skip is not None:
                sums = sums + outputs[spec.skip]
        return sums[..., :height, :width]

    def first_sums(self, data: Tensor, filters: Tensor) -> Tensor:
        """Return the input of the first layer's splines, (N, C, H, W); a subclass can override it.

        Parameters
        ----------
        data : Tensor
            Counts or bits, as for :meth:`forward`.
        filters : Tensor, shape (C, T, K̂, K̂) or (C, 1, 1, 1)
            Filters of the first layer.
        """
        return correlate(data, filters, self._pixel_side, self.filter_dtype)

    def _interpolate(
        self, trials: int | None, *, is_zeros: bool = False
    ) -> tuple[list[Tensor], list[Tensor | None]]:
        """Return the filters and coefficients of all layers, for K = `trials` if conditioned.

        With `is_zeros`, the last spline is one minus that of the network.
        """
        if isinstance(trials, Sensor):
            raise TypeError(
                "trials: expected K, the number of trials per pixel, got a sensor; run_layers does "
                "not take one: pass sensor.trials for a K-conditioned network, or call the module"
            )
        if (self._trials_range is None) != (trials is None):
            raise ValueError(
                "trials: expected K for a K-conditioned network, and None for any other network, "
                f"got {trials}"
            )
        filters: list[Tensor] = list(self.filters)
        coefficients = [self.coefficients.get(str(index), None) for index in range(len(filters))]
        if is_zeros and (last := coefficients[-1]) is not None:
            coefficients[-1] = 1 - last
        if self._trials_range is None or trials is None:
            return filters, coefficients
        weights_tensor = _weights(trials, self._trials_range, self._sets).to(filters[0])

        def interpolate(sets: Tensor, dimensions: int) -> Tensor:
            if sets.dim() == dimensions:
                return sets
            weighted: Tensor = torch.tensordot(weights_tensor, sets, 1)
            return weighted

        filters = [interpolate(sets, 4) for sets in filters]
        filters[0] = filters[0] / trials
        return filters, [None if sets is None else interpolate(sets, 2) for sets in coefficients]


# torch.compile cannot read the function of the engine, so it calls it once for each K.
@torch.compiler.assume_constant_result
def _weights(trials: int, trials_range: tuple[int, int], sets: int) -> Tensor:
    return torch.from_numpy(conditioning_weights(trials, trials_range, sets))
