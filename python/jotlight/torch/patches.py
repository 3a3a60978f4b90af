"""What a deep network learns from: patches of images, seen anew in every step."""

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jotlight.networks.network import Network
from jotlight.sensing.sensor import Sensor
from jotlight.torch.network import Network as Module
from jotlight.training.images import ImageGenerator, Images, generate_images

FLUX = 0.02, 3.0
"""Photons per jot and frame, in the mean of an image, that a network for many K is for."""
_USUAL = 0.08, 1.0
"""What most patches have: photographs where α = K, and dim captures."""
_OFTEN = 3 / 4
"""The share of patches that have it."""
_USUAL_BITS = 9, 100
"""K of half of the steps, where the network is for so many: the paper's."""
_DARK = 1e-3, 0.3
"""Dark counts per jot and frame, in half of the patches of such a network."""
_MIDDLE, _BRIGHT = 0.44, 4.0
"""The mean intensity of photographs; pixels whose noise has so many times its variance, as those of
intensity 1 have where an image is seen well, count no more than that."""
_MOST = 20.0
"""Photons per bit from which on none tells anything."""
_SELDOM = 1 / 16
"""The share of patches of a network for one K that are far too bright or too dark, so that it knows
black and what is past its range, which photographs seldom have."""
_FAR = 1 / 50, 50.0
"""How many times as bright they are."""
_EASE = 0.6
"""How the error of a good estimate grows with that of the counts, as a power."""


@dataclasses.dataclass(frozen=True)
class Batch:
    """Patches as the sensor sees them."""

    data: Tensor
    """Counts (N, 1, H, W), or bits (N, T, H·K̂, W·K̂) where the network weighs jots singly."""
    truth: Tensor
    """Intensities (N, 1, H, W)."""
    bits: int | None = None
    """K, where the network is told it."""
    light: Tensor | None = None
    """Of each patch the photons per jot and frame at intensity 1."""
    dark: Tensor | None = None
    """Of each patch the dark counts per jot and frame."""

    def to(self, device: torch.device) -> "Batch":
        """Give them on another device."""
        moved: dict[str, Any] = {
            field.name: value.to(device)
            for field in dataclasses.fields(self)
            if isinstance(value := getattr(self, field.name), Tensor)
        }
        return dataclasses.replace(self, **moved)

    def errors(self, module: Module) -> Tensor:
        """Give the square error of each patch in the mean of its pixels.

        Of a network for many K they are to first order in z = arcsin √p, which its last spline
        takes; of the brightest pixels they are kept in bounds, and all are in parts of what is easy
        to reach with as many bits and as much light.
        """
        if self.bits is None:
            squares: Tensor = (module(self.data) - self.truth) ** 2
            return squares.mean((1, 2, 3))
        assert self.light is not None
        assert self.dark is not None
        light, dark = self.light.view(-1, 1, 1, 1), self.dark.view(-1, 1, 1, 1)
        rates = (self.truth * light + dark).clamp(max=_MOST)
        wanted = torch.asin(torch.sqrt(-torch.expm1(-rates)))
        # dc/dz = 2 √(exp(s) - 1) / light
        middle = torch.expm1((_MIDDLE * light + dark).clamp(max=_MOST))
        weights = torch.expm1(rates).minimum(_BRIGHT * middle)
        errors = weights * (module.sums(self.data, self.bits) - wanted) ** 2
        reached = light**2 * (middle / (self.bits * light**2)) ** _EASE
        relative: Tensor = 4 * errors / reached
        return relative.mean((1, 2, 3))


@dataclasses.dataclass(frozen=True)
class Patches:
    """Patches of images; those of a step depend on the seed and the number of the step alone."""

    images: Images | ImageGenerator
    network: Network
    sensor: Sensor
    seed: int
    batch: int
    """How many to a step."""
    side: int

    def views(self, step: int, mine: slice, threads: int) -> Batch:
        """Give those of a step, or some of them."""
        choice = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(step, 0)))
        if callable(self.images):
            images: Images = generate_images(self.images, choice, self.batch)
            chosen = np.arange(len(images))
        else:
            images = self.images
            chosen = choice.integers(len(images), size=self.batch)
        sizes = np.array([images[index].shape for index in chosen])
        first = choice.integers(sizes - self.side + 1)
        turns = choice.integers(8, size=self.batch)
        exposures, factors = self._exposures(choice), self._factors(choice)
        seeds = [
            np.random.SeedSequence(self.seed, spawn_key=(step, 1, n)) for n in range(len(chosen))
        ]
        truth = np.stack(
            [
                _turned(images[index][y : y + self.side, x : x + self.side], turn)
                for index, (y, x), turn in zip(chosen[mine], first[mine], turns[mine], strict=True)
            ]
        )
        if exposures is None:
            seen = self._seen(truth, factors[mine], seeds[mine], threads)
            most = np.float32(self.sensor.max_intensity)
            truth = np.minimum(truth * factors[mine, None, None], most)
            return Batch(seen, torch.from_numpy(truth)[:, None])
        whole = torch.from_numpy(truth)[:, None]
        bits, flux, dark = exposures
        means = np.array([images[index].mean() for index in chosen[mine]])
        light = (flux[mine] / np.maximum(means, 1e-6)).astype(np.float32)
        rates = truth * light[:, None, None] + dark[mine, None, None]
        counts = np.stack(
            [
                np.random.default_rng(seed).binomial(bits, -np.expm1(-rate))
                for rate, seed in zip(rates.astype(np.float64), seeds[mine], strict=True)
            ]
        ).astype(np.float32)
        return Batch(
            torch.from_numpy(counts)[:, None],
            whole,
            bits,
            torch.from_numpy(light),
            torch.from_numpy(dark[mine].astype(np.float32)),
        )

    def _exposures(
        self, choice: np.random.Generator
    ) -> tuple[int, npt.NDArray[np.float64], npt.NDArray[np.float64]] | None:
        """K of a step, and of each patch the flux and the dark counts, for a network told K."""
        if self.network.trials_range is None:
            return None
        low, high = self.network.trials_range
        least, most = max(low, _USUAL_BITS[0]), min(high, _USUAL_BITS[1])
        if least < most and choice.random() < 1 / 2:
            low, high = least, most
        bits = round(math.exp(choice.uniform(math.log(low), math.log(high))))
        flux, usual, dark = (
            np.exp(choice.uniform(math.log(low), math.log(high), self.batch))
            for low, high in (FLUX, _USUAL, _DARK)
        )
        flux = np.where(choice.random(self.batch) < _OFTEN, usual, flux)
        dark = np.where(choice.random(self.batch) < 1 / 2, 0, dark)
        return bits, flux, dark

    def _factors(self, choice: np.random.Generator) -> npt.NDArray[np.float32]:
        """How many times as bright as its image each patch of a step is."""
        low, high = _FAR
        factors = np.exp(choice.uniform(math.log(low), math.log(high), self.batch))
        seldom = choice.random(self.batch) < _SELDOM
        return np.where(seldom, factors, 1).astype(np.float32)

    def _seen(
        self,
        truth: npt.NDArray[np.float32],
        factors: npt.NDArray[np.float32],
        seeds: list[np.random.SeedSequence],
        threads: int,
    ) -> Tensor:
        side, tied = self.sensor.oversampling, self.network.tied
        seen = []
        for patch, factor, seed in zip(truth, factors, seeds, strict=True):
            sensor = dataclasses.replace(self.sensor, gain=self.sensor.gain * float(factor))
            bits = sensor.expose(patch, seed, threads=threads)
            counts = bits.counts(side, threads=threads)[None] if tied else bits.to_array()
            seen.append(counts.astype(np.float32))
        return torch.from_numpy(np.stack(seen))


def _turned(patch: npt.NDArray[np.float32], turn: int) -> npt.NDArray[np.float32]:
    """One of the eight symmetries of a square."""
    patch = np.rot90(patch, turn % 4)
    return patch.T if turn >= 4 else patch
