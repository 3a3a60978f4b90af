"""Adapters for deepinv: the sensor as physics and likelihood, networks as models (extra `deepinv`).

The library is https://deepinv.github.io.
"""

import math
import os
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jotlight.errors import needs_module
from jotlight.estimators.mle import mle
from jotlight.networks.network import Network
from jotlight.sensing.bits.bits import Bits
from jotlight.sensing.likelihood.likelihood import Likelihood
from jotlight.sensing.sensor import Sensor
from jotlight.torch.data_checks import as_floats
from jotlight.torch.network import Network as TorchNetwork
from jotlight.torch.sensing import Sensing

with needs_module("deepinv.models", "these adapters need deepinv: pip install 'jotlight[deepinv]'"):
    from deepinv.models import Denoiser, Reconstructor
    from deepinv.optim import DataFidelity
    from deepinv.physics import Physics


_ROUNDING = 1e-4
"""Distance of whole numbers from integers, in floats that were computed."""


class SensorPhysics(Physics):  # type: ignore[misc, unused-ignore]
    """A sensor as a forward model: data y with the expectation A(c).

    Parameters
    ----------
    sensor : Sensor
        A sensor of any kernel, with or without maps of its jots.
    output : {"counts", "bits"}
        Kind of data y: counts (N, 1, H, W), or bits (N, T, H·K̂, W·K̂).
    generator : torch.Generator, optional
        Source of randomness. Default: PyTorch's own.

    Notes
    -----
    A(c) = Σ P(q, s), equation (3), over the bits of a pixel is not linear. ``A_vjp`` is its exact
    vector-Jacobian product. Solvers start at ``A_adjoint(y)``, so it is the estimate of
    :meth:`A_dagger`.

    Examples
    --------
    >>> physics = SensorPhysics(jl.Sensor(oversampling=4))
    >>> counts = physics(torch.full((1, 1, 20, 30), 0.5))
    >>> physics.A_dagger(counts).shape
    torch.Size([1, 1, 20, 30])
    """

    def __init__(
        self,
        sensor: Sensor,
        *,
        output: str = "counts",
        generator: torch.Generator | None = None,
    ) -> None:
        super().__init__()
        self.sensing = Sensing(sensor, output=output)
        self.expectation = Sensing(sensor, output=output, gradient="expectation")
        self.generator = generator

    def A(self, x: Tensor, **_: Any) -> Tensor:  # noqa: N802
        """Return the expected counts or bits for intensities x, (N, 1, H, W)."""
        expected: Tensor = self.expectation(x)
        return expected

    def forward(self, x: Tensor, **_: Any) -> Tensor:
        """Return random counts or bits, with straight-through gradients."""
        sample: Tensor = self.sensing(x, self.generator)
        return sample

    def A_dagger(self, y: Tensor, x_init: Tensor | None = None) -> Tensor:  # noqa: N802
        """Return the maximum-likelihood estimate of each pixel for the box kernel, in [0, S].

        It is not differentiable.

        Raises
        ------
        ValueError
            When y has another shape, or numbers that are not whole.
        """
        data, is_bits = _whole_numbers(y), self.sensing.output == "bits"
        if y.ndim != 4 or (not is_bits and y.shape[1] != 1):
            shape = "bits (N, T, H, W)" if is_bits else "counts (N, 1, H, W)"
            raise ValueError(f"y: expected {shape}, got shape {tuple(y.shape)}")
        if is_bits:
            estimates = [mle(Bits.from_array(bits), self._box_sensor) for bits in data]
        else:
            estimates = [mle(counts[0], self._box_sensor) for counts in data]
        return torch.from_numpy(np.stack(estimates)[:, None]).to(as_floats(y))

    def A_adjoint(self, y: Tensor, **_: Any) -> Tensor:  # noqa: N802
        """Return the starting point of solvers, the estimate of :meth:`A_dagger`."""
        return self.A_dagger(y)

    @property
    def _box_sensor(self) -> Sensor:
        """The sensor with the box kernel, for which the estimate has a closed form."""
        return self.sensing.sensor.replace(kernel="box")


class BitLikelihood(DataFidelity):  # type: ignore[misc, unused-ignore]
    """The data fidelity -ℓ(c) of bits or counts: equation (4).

    For counts, the engine computes the proximal map to rounding error, and the map is
    differentiable in the point and in γ. For bits, deepinv computes it by gradient descent.

    Examples
    --------
    >>> physics, fidelity = SensorPhysics(jl.Sensor(frames=16)), BitLikelihood()
    >>> counts = torch.tensor([[[[4.0, 12.0]]]])
    >>> round(fidelity(torch.full((1, 1, 1, 2), 0.5), counts, physics).item(), 3)
    22.924
    >>> fidelity.prox(torch.full((1, 1, 1, 2), 0.5), counts, physics, gamma=1e6).numpy().round(4)
    array([[[[0.2877, 1.    ]]]], dtype=float32)
    """

    def fn(self, x: Tensor, y: Tensor, physics: SensorPhysics, *_: Any, **__: Any) -> Tensor:
        """Return -ℓ of each image, (N,), in nats."""
        return -physics.sensing.log_likelihood(y, x)

    def grad(self, x: Tensor, y: Tensor, physics: SensorPhysics, *_: Any, **__: Any) -> Tensor:
        """Return -∇ℓ(c), (N, 1, H, W)."""
        # Tensors of the inference mode have no gradients, but their copies do.
        with torch.inference_mode(False), torch.enable_grad():
            x, y = (each.clone() if each.is_inference() else each for each in (x, y))
            point = x if x.requires_grad else x.detach().requires_grad_()
            value = self.fn(point, y, physics).sum()
            (gradient,) = torch.autograd.grad(value, point, create_graph=x.requires_grad)
        return gradient

    def prox(
        self,
        x: Tensor,
        y: Tensor,
        physics: SensorPhysics,
        *args: Any,
        gamma: float | Tensor = 1.0,
        **options: Any,
    ) -> Tensor:
        """Return the c in [0, S] that minimizes -γ ℓ(c) + ½ ‖c - x‖², (N, 1, H, W).

        Parameters
        ----------
        x : Tensor, shape (N, 1, H, W)
            The point.
        y : Tensor
            Counts or bits, as the physics returns them.
        physics : SensorPhysics
            The sensor.
        gamma : float or Tensor
            γ, above 0: one number.
        *args, **options
            Options of deepinv's gradient descent, for bits.

        Raises
        ------
        ValueError
            When y is not an output of the physics, or has counts that are not whole. For counts of
            a sensor whose jots receive different light: their likelihood takes bits.
        """
        sensor = physics.sensing.sensor
        if physics.sensing.output == "bits":
            found: Tensor = super().prox(x, y, physics, *args, gamma=gamma, **options)
            return found.clamp(0, sensor.max_intensity)
        physics.sensing.check_data(y, x)
        x, y = torch.broadcast_tensors(x, y)
        # The variable of the engine is the light s = α c / K.
        scale = sensor.light_per_intensity
        penalty = 1 / (torch.as_tensor(gamma).detach().item() * scale**2)
        likelihood = Likelihood(
            _whole_numbers(y),
            sensor.trials,
            threshold=sensor.threshold,
            efficiency=sensor.efficiency,
            dark_counts=sensor.dark_counts,
        )
        point = scale * x.detach().double().cpu().numpy()
        max_light = scale * sensor.max_intensity
        light = likelihood.proximal(point, penalty, max_light=max_light)
        c = torch.from_numpy(light / scale).to(x)
        if not (x.requires_grad or (isinstance(gamma, Tensor) and gamma.requires_grad)):
            return c
        # A Newton step at the solution does not change it, but carries its derivatives.
        slope, curvature = (
            torch.from_numpy(a).to(x) for a in likelihood.gradient_and_curvature(light)
        )
        is_inside = torch.from_numpy((light > 0) & (light < max_light)).to(x.device)
        residual = c - x - gamma * scale * slope
        step = residual / (1 + gamma * scale**2 * curvature)
        return torch.where(is_inside, c - (step - step.detach()), c)


def _whole_numbers(y: Tensor) -> npt.NDArray[np.int32]:
    """Return counts or bits as integers, after a check."""
    values = as_floats(y).detach().cpu().numpy()
    whole: npt.NDArray[np.floating] = np.rint(values)
    is_whole = abs(values - whole) <= _ROUNDING
    if not is_whole.all():
        raise ValueError(
            f"y: expected whole numbers, got {values[~is_whole][0]:g}; pass counts or bits, such "
            "as physics(x), in place of their expectation physics.A(x)"
        )
    return whole.astype(np.int32)


class NetworkReconstructor(Reconstructor):  # type: ignore[misc, unused-ignore]
    """A network as a model of deepinv, from counts or bits to estimates.

    Parameters
    ----------
    network : jotlight.Network, jotlight.torch.Network, or path
        A network for the sensor of the physics, or a K-conditioned network. The parameters of a
        module are shared.

    Examples
    --------
    >>> sensor = jl.Sensor(oversampling=4)
    >>> model = NetworkReconstructor(jl.Network.initial(sensor))
    >>> physics = SensorPhysics(sensor)
    >>> model(physics(torch.full((1, 1, 20, 30), 0.5)), physics).shape
    torch.Size([1, 1, 20, 30])
    """

    def __init__(self, network: Network | TorchNetwork | str | os.PathLike[str]) -> None:
        super().__init__()
        self.module = network if isinstance(network, TorchNetwork) else TorchNetwork(network)

    def forward(self, y: Tensor, physics: SensorPhysics, **_: Any) -> Tensor:
        """Return intensities (N, 1, H, W) in [0, S].

        Raises
        ------
        TypeError
            When the physics is not a :class:`SensorPhysics`.
        """
        if not isinstance(physics, SensorPhysics):
            raise TypeError(
                f"physics: expected SensorPhysics(sensor), got {type(physics).__name__}"
            )
        data, sensor = y, physics.sensing.sensor
        if physics.sensing.output == "bits" and self.module.origin.tied:
            side, (height, width) = sensor.oversampling, y.shape[2:]
            jots = as_floats(y).reshape(len(y), -1, height // side, side, width // side, side)
            data = jots.sum(dim=(1, 3, 5))[:, None]
        estimate: Tensor = self.module(data, sensor)
        return estimate


class NetworkDenoiser(Denoiser):  # type: ignore[misc, unused-ignore]
    """A K-conditioned network as a denoiser of white Gaussian noise, for plug-and-play priors.

    Such a network works on z = arcsin √(L/K). The noise of z is nearly normal with standard
    deviation 1/(2 √K), whatever the light. The denoiser takes an image x in [0, 1] with noise of
    standard deviation σ for 2 z/π, with K = 1/(π σ)².

    Parameters
    ----------
    network : jotlight.Network, jotlight.torch.Network, or path
        A K-conditioned network. A σ outside of its range of K becomes the nearest one inside. The
        parameters of a module are shared.

    Raises
    ------
    ValueError
        For a network that is not K-conditioned.

    Examples
    --------
    >>> denoiser = NetworkDenoiser(jl.Network.conditional("small", rng=0))
    >>> denoiser(torch.rand(2, 1, 20, 30), 0.1).shape
    torch.Size([2, 1, 20, 30])
    """

    def __init__(self, network: Network | TorchNetwork | str | os.PathLike[str]) -> None:
        super().__init__()
        self.module = network if isinstance(network, TorchNetwork) else TorchNetwork(network)
        origin = self.module.origin
        if origin.trials_range is None:
            raise ValueError(f"network: expected a K-conditioned network, got {origin!r}")
        self.trials_range = origin.trials_range

    def forward(self, x: Tensor, sigma: float | Tensor, **_: Any) -> Tensor:
        """Return denoised images.

        Parameters
        ----------
        x : Tensor, shape (N, C, H, W)
            Noisy images of intensities in [0, 1]. Each channel is an image of its own.
        sigma : float or Tensor, shape (N,)
            Standard deviation of the noise: one for all images, or one for each.
        """
        sigmas = torch.as_tensor(sigma, dtype=torch.float64).flatten().expand(len(x)).tolist()
        images = zip(x, sigmas, strict=True)
        denoised = [self._denoise(image[:, None], sigma) for image, sigma in images]
        return torch.stack(denoised).flatten(1, 2)

    def _denoise(self, x: Tensor, sigma: float) -> Tensor:
        low, high = self.trials_range
        trials = round(min(max(1 / max(math.pi * sigma, 1e-9) ** 2, low), high))
        fractions = torch.sin(0.5 * math.pi * x.clamp(0, 1)) ** 2
        return self.module.last_sums(trials * fractions, trials) * (2 / math.pi)
