"""Batches of training patches, with new bits in every step."""

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jotlight.array_types import Array
from jotlight.errors import hide_warnings
from jotlight.networks.network import Network
from jotlight.sensing.parameters.intensity_scale import MEANING
from jotlight.sensing.parameters.response import detection_probability
from jotlight.sensing.sensor import Sensor
from jotlight.torch import response
from jotlight.torch.network import Network as TorchNetwork
from jotlight.training.patch_sources import Patch, PatchSource

_LIGHT_RANGE = 0.02, 3.0
"""Mean light of an image in photons per jot and frame, for K-conditioned networks."""

_USUAL_LIGHT_RANGE = 0.08, 1.0
"""Mean light of most patches: photographs with α = K, and dim captures."""

_USUAL_LIGHT_FRACTION = 3 / 4
"""Fraction of patches with usual light."""

_USUAL_TRIALS_RANGE = 9, 100
"""K of half of the steps, as in the paper, if the network's range contains it."""

_DARK_COUNTS_RANGE = 1e-3, 0.3
"""Dark counts per jot and frame, in half of the patches for K-conditioned networks."""

_MEAN_INTENSITY = 0.44
"""Mean intensity of photographs."""

_MAX_RELATIVE_VARIANCE = 4.0
"""Largest weight of a pixel, as noise variance relative to a pixel of mean intensity.

Pixels of intensity 1 in a well-exposed image reach it.
"""

_MAX_RATE = 20.0
"""Largest rate s in the error: a bit carries no information beyond."""

_EXTREME_FACTORS = 1 / 50, 50.0
"""Range of the brightness factor of such patches."""

_EXTREME_LIGHT_RANGE = 0.002, 8.0
"""Mean light of such patches for K-conditioned networks."""

_ERROR_EXPONENT = 0.6
"""Exponent with which the error of a good estimate grows with the error of the counts."""


@dataclasses.dataclass(frozen=True)
class Batch:
    """N patches and their simulated data."""

    data: Tensor
    """Counts (N, 1, H, W), or bits (N, T, H·K̂, W·K̂) for networks with one weight per jot."""
    truth: Tensor
    """Intensities (N, 1, H, W)."""
    trials: int | None = None
    """K, for K-conditioned networks."""
    light_per_intensity: Tensor | None = None
    """Light (photons per jot and frame) at intensity 1, (N,), for K-conditioned networks."""
    dark_counts: Tensor | None = None
    """Dark counts per jot and frame, (N,), for K-conditioned networks."""

    def to(self, device: torch.device) -> "Batch":
        """Return the batch on another device."""
        moved: dict[str, Any] = {
            field.name: value.to(device)
            for field in dataclasses.fields(self)
            if isinstance(value := getattr(self, field.name), Tensor)
        }
        return dataclasses.replace(self, **moved)

    def squared_errors(self, module: TorchNetwork) -> Tensor:
        """Return the mean square error of each patch over its pixels, (N,).

        For K-conditioned networks, it is relative to an error that is easy to reach with the same
        number of bits and the same light. The intensities of bright pixels are compressed, because
        their noise would outweigh that of all others.
        """
        if self.trials is None:
            squares: Tensor = (module.run_layers(self.data) - self.truth) ** 2
            return squares.mean((1, 2, 3))
        return self.errors_of(module.last_sums(self.data, self.trials))

    def errors_of(self, z: Tensor) -> Tensor:
        """Return the mean square error of estimates z = arcsin √p of a K-conditioned network, (N,).

        It is that of :meth:`squared_errors`.
        """
        assert self.trials is not None
        assert self.light_per_intensity is not None
        assert self.dark_counts is not None
        slope, dark = (
            values.view(-1, 1, 1, 1) for values in (self.light_per_intensity, self.dark_counts)
        )
        rates = (self.truth * slope + dark).clamp(max=_MAX_RATE)
        target = torch.asin(torch.sqrt(response.detection_probability(1, rates)))
        mean_weight = torch.expm1((_MEAN_INTENSITY * slope + dark).clamp(max=_MAX_RATE))
        steepest = torch.sqrt(_MAX_RELATIVE_VARIANCE * mean_weight)
        errors = (_compressed_rates(z, steepest) - _compressed_rates(target, steepest)) ** 2
        scale = slope**2 * (mean_weight / (self.trials * slope**2)) ** _ERROR_EXPONENT
        relative: Tensor = errors / scale
        return relative.mean((1, 2, 3))


def _compressed_rates(z: Tensor, steepest: Tensor) -> Tensor:
    """Return the rates s with z = arcsin √(1 - exp(-s)), as straight lines where they are steep.

    The slope ds/dz = 2 √(exp(s) - 1) = 2 tan z grows up to 2 `steepest`. The function is odd, so
    that the error of a negative z has a gradient.

    The network must minimize the error of s, as the PSNR measures it. The mean of z given the bits
    is not the z of the mean of s. With the error of z as the cost, medium is 0.33 dB worse at
    K = 1, and 0.17 dB worse at K = 16 (decision 50).
    """
    magnitude = z.abs()
    curved = magnitude.minimum(torch.atan(steepest))
    rates = 2 * steepest * (magnitude - curved) - 2 * torch.log(torch.cos(curved))
    return torch.sign(z) * rates


class Exposures(NamedTuple):
    """Exposures of the patches of a step, for a K-conditioned network."""

    trials: int
    light: Array
    """Mean light of each patch's image."""
    dark_counts: Array


@dataclasses.dataclass(frozen=True)
class PatchLoader:
    """A source of batches. A batch depends only on the seed and on the number of its step.

    Examples
    --------
    >>> from jotlight.training.patch_sources import ImagePatches
    >>> sensor = jl.Sensor(oversampling=4)
    >>> network = jl.Network.residual(sensor, "small", rng=0)
    >>> source = ImagePatches(np.full((2, 64, 64), 0.5, np.float32))
    >>> loader = PatchLoader(source, network, sensor, seed=0, batch_size=16, side=48)
    >>> loader.batch(step=0, shard=slice(None), threads=1).data.shape
    torch.Size([16, 1, 48, 48])
    """

    extreme_fraction: ClassVar[float] = 1 / 16
    """Fraction of patches that are far too bright or too dark.

    They teach the network black and intensities beyond its range, which photographs seldom have.
    """

    source: PatchSource
    """Source of the patches."""
    network: Network
    """Network that the batches are for, which decides what the data are."""
    sensor: Sensor
    """Sensor without maps. Batches for a K-conditioned network do not depend on it."""
    seed: int
    batch_size: int
    """Number of patches per step, over all processes."""
    side: int
    """Height and width of a patch, in pixels."""

    def batch(self, step: int, shard: slice, threads: int) -> Batch:
        """Return the batch of a step, or the patches of one process.

        Parameters
        ----------
        step : int
            Number of the step, from 0.
        shard : slice
            Which of the patches to return.
        threads : int
            The number of threads of the simulation.
        """
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(step, 0)))
        exposures, factors = self._draw_exposures(rng), self._draw_factors(rng)
        # Each patch has its own generator, so that a process draws its own patches alone.
        generators = [
            np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(step, 1, number)))
            for number in range(self.batch_size)[shard]
        ]
        patches = [self.source.draw(generator, self.side) for generator in generators]
        if exposures is not None:
            return self._expose_conditional(patches, exposures, generators, shard, threads)
        truth = np.stack([patch.values for patch in patches])
        data = self._expose(truth, factors[shard], generators, threads)
        max_intensity = np.float32(self.sensor.max_intensity)
        truth = np.minimum(truth * factors[shard, None, None], max_intensity)
        return Batch(data, torch.from_numpy(truth)[:, None])

    def _draw_exposures(self, rng: np.random.Generator) -> Exposures | None:
        """Return random exposures for a K-conditioned network, and None for another one."""
        if self.network.trials_range is None:
            return None
        low, high = self.network.trials_range
        usual_low, usual_high = max(low, _USUAL_TRIALS_RANGE[0]), min(high, _USUAL_TRIALS_RANGE[1])
        if usual_low < usual_high and rng.random() < 1 / 2:
            low, high = usual_low, usual_high
        trials = round(math.exp(rng.uniform(math.log(low), math.log(high))))
        light, usual_light, extreme_light, dark_counts = (
            self._log_uniform(rng, bounds)
            for bounds in (
                _LIGHT_RANGE,
                _USUAL_LIGHT_RANGE,
                _EXTREME_LIGHT_RANGE,
                _DARK_COUNTS_RANGE,
            )
        )
        chance = rng.random(self.batch_size)
        light = np.where(chance < _USUAL_LIGHT_FRACTION, usual_light, light)
        light = np.where(chance >= 1 - self.extreme_fraction, extreme_light, light)
        dark_counts = np.where(rng.random(self.batch_size) < 1 / 2, 0, dark_counts)
        return Exposures(trials, light, dark_counts)

    def _draw_factors(self, rng: np.random.Generator) -> npt.NDArray[np.float32]:
        """Return the brightness of each patch, relative to its image."""
        factors = self._log_uniform(rng, _EXTREME_FACTORS)
        is_extreme = rng.random(self.batch_size) < self.extreme_fraction
        return np.where(is_extreme, factors, 1).astype(np.float32)

    def _log_uniform(self, rng: np.random.Generator, bounds: tuple[float, float]) -> Array:
        """Return a number per patch, uniform on a logarithmic scale."""
        low, high = bounds
        return np.exp(rng.uniform(math.log(low), math.log(high), self.batch_size))

    def _expose(
        self,
        truth: npt.NDArray[np.float32],
        factors: npt.NDArray[np.float32],
        generators: list[np.random.Generator],
        threads: int,
    ) -> Tensor:
        """Return the counts or bits of patches whose brightness is multiplied by factors."""
        side, tied = self.sensor.oversampling, self.network.tied
        data = []
        for patch, factor, generator in zip(truth, factors, generators, strict=True):
            _check_gray(patch)
            sensor = dataclasses.replace(self.sensor, gain=self.sensor.gain * float(factor))
            with hide_warnings(MEANING):  # a patch may show nothing but a light
                bits = sensor.expose(patch, generator, threads=threads)
            counts = bits.counts(side, threads=threads)[None] if tied else bits.to_array()
            data.append(counts.astype(np.float32))
        return torch.from_numpy(np.stack(data))

    def _expose_conditional(
        self,
        patches: list[Patch],
        exposures: Exposures,
        generators: list[np.random.Generator],
        shard: slice,
        threads: int,
    ) -> Batch:
        """Return a batch for a K-conditioned network."""
        dark_counts = exposures.dark_counts[shard]
        means = np.array([patch.image_mean for patch in patches])
        slopes = (exposures.light[shard] / np.maximum(means, 1e-6)).astype(np.float32)
        trials = [exposures.trials] * len(patches)
        # The start of a color network takes as long as a step.
        with ThreadPoolExecutor(threads) as pool:
            each = patches, slopes, dark_counts, trials, generators
            data = list(pool.map(self.expose_patch, *each))
        truth = np.stack([patch.values for patch in patches])
        return Batch(
            torch.from_numpy(np.stack(data)),
            torch.from_numpy(truth if truth.ndim == 4 else truth[:, None]),
            exposures.trials,
            torch.from_numpy(slopes),
            torch.from_numpy(dark_counts.astype(np.float32)),
        )

    def expose_patch(
        self,
        patch: Patch,
        slope: np.float32,
        dark_counts: np.float64,
        trials: int,
        generator: np.random.Generator,
    ) -> npt.NDArray[np.float32]:
        """Return what a K-conditioned network reads of a patch: counts (1, H, W).

        Parameters
        ----------
        patch : Patch
            The patch.
        slope : float
            Light per jot and frame at intensity 1.
        dark_counts : float
            Dark counts per jot and frame.
        trials : int
            K.
        generator : numpy.random.Generator
            Draws the bits.
        """
        _check_gray(patch.values)
        rate = patch.values * slope + dark_counts
        counts = generator.binomial(trials, detection_probability(1, rate))
        return counts.astype(np.float32)[None]


def _check_gray(values: npt.NDArray[np.float32]) -> None:
    """Raise ValueError unless a patch is gray."""
    if values.ndim != 2:
        raise ValueError(
            "images: expected gray patches (H, W) for a network of gray images, such as those of "
            f"jotlight.training.PhotographPatches, got shape {values.shape}"
        )
