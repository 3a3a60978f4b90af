"""The sensor and the networks for the solvers of deepinv (extra `deepinv`)."""

import math
from typing import Any

import numpy as np
import torch
from deepinv.models import Denoiser, Reconstructor
from deepinv.optim import DataFidelity
from deepinv.physics import Physics
from torch import Tensor

import jotlight
from jotlight.estimators.mle import mle
from jotlight.sensing.likelihood import Likelihood
from jotlight.sensing.sensor import Sensor
from jotlight.torch.network import Network
from jotlight.torch.sensing import Sensing


class SensorPhysics(Physics):  # type: ignore[misc, unused-ignore]
    """A sensor as a forward model y ~ N(A(c)): what it expects of intensities, and what it draws.

    Parameters
    ----------
    sensor : jotlight.Sensor
        Of any kernel, with or without maps of its jots.
    output : {"counts", "bits"}
        What y is, and A(c) the expectation of: counts (N, 1, H, W), or bits (N, T, H·K̂, W·K̂).
    generator : torch.Generator, optional
        Of the draws. Default: PyTorch's own.

    Notes
    -----
    A is not linear, A(c) = Σ P(q, s) over the bits; ``A_vjp`` is its exact derivative. What deepinv
    begins with, ``A_adjoint(y)``, is the estimate of :meth:`A_dagger`.

    Examples
    --------
    >>> physics = SensorPhysics(Sensor(oversampling=4))
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
        self.expecting = Sensing(sensor, output=output, gradient="expectation")
        self.generator = generator

    def A(self, x: Tensor, **_: Any) -> Tensor:  # noqa: N802
        """Give the expected counts or bits."""
        expected: Tensor = self.expecting(x)
        return expected

    def forward(self, x: Tensor, **_: Any) -> Tensor:
        """Draw counts or bits; they pass gradients on straight through."""
        drawn: Tensor = self.sensing(x, self.generator)
        return drawn

    def A_dagger(self, y: Tensor, x_init: Tensor | None = None) -> Tensor:  # noqa: N802
        """Give the maximum-likelihood estimate of each pixel, in [0, S]; not differentiable."""
        data = y.detach().cpu().numpy().astype(np.int32)
        if self.sensing.output == "bits":
            estimates = [mle(jotlight.Bits.from_array(one), self._box) for one in data]
        else:
            estimates = [mle(one[0], self._box) for one in data]
        return torch.from_numpy(np.stack(estimates)[:, None]).to(y)

    def A_adjoint(self, y: Tensor, **_: Any) -> Tensor:  # noqa: N802
        """Give what solvers begin with: the estimate of :meth:`A_dagger`."""
        return self.A_dagger(y)

    @property
    def _box(self) -> Sensor:
        """The sensor with the kernel that has an estimate in closed form."""
        return self.sensing.sensor.replace(kernel="box")


class BitLikelihood(DataFidelity):  # type: ignore[misc, unused-ignore]
    """-ℓ(c), the data fidelity of bits and of their counts: equation (4).

    Its proximal map is solved to rounding by the engine where the data are counts, and by deepinv's
    descent where they are bits. It can be differentiated in the point and in the step.

    Examples
    --------
    >>> physics, fidelity = SensorPhysics(Sensor(frames=16)), BitLikelihood()
    >>> counts = torch.tensor([[[[4.0, 12.0]]]])
    >>> round(fidelity(torch.full((1, 1, 1, 2), 0.5), counts, physics).item(), 3)
    22.924
    >>> fidelity.prox(torch.full((1, 1, 1, 2), 0.5), counts, physics, gamma=1e6).numpy().round(4)
    array([[[[0.2877, 1.    ]]]], dtype=float32)
    """

    def fn(self, x: Tensor, y: Tensor, physics: SensorPhysics, *_: Any, **__: Any) -> Tensor:
        """Give -ℓ of each picture, (N,), in nats."""
        return -physics.sensing.log_likelihood(y, x)

    def grad(self, x: Tensor, y: Tensor, physics: SensorPhysics, *_: Any, **__: Any) -> Tensor:
        """Give -∇ℓ."""
        with torch.enable_grad():
            point = x if x.requires_grad else x.detach().requires_grad_()
            value = self.fn(point, y, physics).sum()
            (slope,) = torch.autograd.grad(value, point, create_graph=x.requires_grad)
        return slope

    def prox(
        self,
        x: Tensor,
        y: Tensor,
        physics: SensorPhysics,
        *args: Any,
        gamma: float | Tensor = 1.0,
        **options: Any,
    ) -> Tensor:
        """Give the c in [0, S] with the least -γ ℓ(c) + ½ ‖c - x‖²."""
        if physics.sensing.output == "bits":
            found: Tensor = super().prox(x, y, physics, *args, gamma=gamma, **options)
            return found.clamp(0, physics.sensing.sensor.max_intensity)
        sensor = physics.sensing.sensor
        _, light, most = sensor.pixel_response()
        # The engine's variable is the light s = α c / K.
        penalty = 1 / (torch.as_tensor(gamma).detach().item() * light**2)
        likelihood = Likelihood(
            y.detach().cpu().numpy().astype(np.int64),
            sensor.bits_per_pixel,
            threshold=sensor.threshold,
            efficiency=sensor.efficiency,
            dark_counts=sensor.dark_counts,
        )
        point = light * x.detach().double().cpu().numpy()
        best = likelihood.proximal(point, penalty, max_light=light * most)
        if not (x.requires_grad or (isinstance(gamma, Tensor) and gamma.requires_grad)):
            return torch.from_numpy(best / light).to(x)
        # A step of Newton's method from the solution does not move, and has its derivatives.
        slope, curvature = (
            torch.from_numpy(a).to(x) for a in likelihood.gradient_and_curvature(best)
        )
        inside = torch.from_numpy((best > 0) & (best < light * most)).to(x.device)
        c = torch.from_numpy(best / light).to(x)
        step = (c - x - gamma * light * slope) / (1 + gamma * light**2 * curvature)
        return torch.where(inside, c - (step - step.detach()), c)


class NetworkReconstructor(Reconstructor):  # type: ignore[misc, unused-ignore]
    """A network as a model of deepinv: from counts or bits to pictures.

    Parameters
    ----------
    network : jotlight.Network

    Examples
    --------
    >>> sensor = Sensor(oversampling=4)
    >>> model = NetworkReconstructor(jotlight.Network.initial(sensor))
    >>> physics = SensorPhysics(sensor)
    >>> model(physics(torch.full((1, 1, 20, 30), 0.5)), physics).shape
    torch.Size([1, 1, 20, 30])
    """

    def __init__(self, network: jotlight.Network) -> None:
        super().__init__()
        self.module = Network(network)

    def forward(self, y: Tensor, physics: SensorPhysics, **_: Any) -> Tensor:
        """Give pictures (N, 1, H, W); of a network that is told K, P(b = 1)."""
        bits = physics.sensing.sensor.bits_per_pixel
        picture: Tensor = self.module(y, bits if self.module.origin.trials_range else None)
        return picture


class NetworkDenoiser(Denoiser):  # type: ignore[misc, unused-ignore]
    """A network that is told K, as a denoiser of white Gaussian noise, for plug-and-play priors.

    Such a network works on z = arcsin √(L/K), whose noise is nearly normal with standard deviation
    1/(2 √K), whatever the light. A picture x in [0, 1] with noise of σ is taken for 2 z/π, seen
    with K = 1/(π σ)².

    Parameters
    ----------
    network : jotlight.Network
        One that is told K. Of the σ that its range of K stands for, the nearest is taken.

    Raises
    ------
    ValueError
        For a network that is not told K.

    Examples
    --------
    >>> denoiser = NetworkDenoiser(jotlight.Network.conditional("small", rng=0))
    >>> denoiser(torch.rand(2, 1, 20, 30), 0.1).shape
    torch.Size([2, 1, 20, 30])
    """

    def __init__(self, network: jotlight.Network) -> None:
        if network.trials_range is None:
            raise ValueError(f"network: expected one that is told K, got {network!r}")
        super().__init__()
        self.module = Network(network)
        self.between = network.trials_range

    def forward(self, x: Tensor, sigma: float | Tensor, **_: Any) -> Tensor:
        """Give pictures (N, 1, H, W); of σ one for all, or one for each (N,)."""
        sigmas = torch.as_tensor(sigma, dtype=torch.float64).flatten().expand(len(x)).tolist()
        found = [self._one(picture[None], sigma) for picture, sigma in zip(x, sigmas, strict=True)]
        return torch.cat(found)

    def _one(self, x: Tensor, sigma: float) -> Tensor:
        low, high = self.between
        bits = round(min(max(1 / max(math.pi * sigma, 1e-9) ** 2, low), high))
        shares = torch.sin(0.5 * math.pi * x.clamp(0, 1)) ** 2
        return self.module.sums(bits * shares, bits) * (2 / math.pi)
