"""What a deep network learns from: patches of images, seen anew in every step."""

import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from jotlight.network import Network
from jotlight.sensor import Sensor
from jotlight.torch.network import Network as Module
from jotlight.training.examples import Scenes, Source, made_scenes

FLUX = 0.02, 3.0
"""Photons per jot and frame, in the mean of an image, that a network for many K is for."""
_USUAL = 0.15, 1.0
"""That of half of the patches: photographs have it where α = K."""
_DARK = 1e-3, 0.3
"""Dark counts per jot and frame, in half of the patches of such a network."""
_MIDDLE, _BRIGHT = 0.44, 4.0
"""The mean intensity of photographs; pixels whose noise has so many times its variance, as those of
intensity 1 have where an image is seen well, count no more than that."""
_MOST = 20.0
"""Photons per bit from which on none tells anything."""
_EASE = 0.6
"""How the error of a good estimate grows with that of the counts, as a power."""


@dataclasses.dataclass(frozen=True)
class Views:
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

    def to(self, device: torch.device) -> "Views":
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

    images: Scenes | Source
    network: Network
    sensor: Sensor
    seed: int
    batch: int
    """How many to a step."""
    side: int

    def views(self, step: int, mine: slice, threads: int) -> Views:
        """Give those of a step, or some of them."""
        choice = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(step, 0)))
        if callable(self.images):
            images: Scenes = made_scenes(self.images, choice, self.batch)
            chosen = np.arange(len(images))
        else:
            images = self.images
            chosen = choice.integers(len(images), size=self.batch)
        sizes = np.array([images[index].shape for index in chosen])
        first = choice.integers(sizes - self.side + 1)
        turns = choice.integers(8, size=self.batch)
        exposures = self._exposures(choice)
        seeds = [
            np.random.SeedSequence(self.seed, spawn_key=(step, 1, n)) for n in range(len(chosen))
        ]
        truth = np.stack(
            [
                _turned(images[index][y : y + self.side, x : x + self.side], turn)
                for index, (y, x), turn in zip(chosen[mine], first[mine], turns[mine], strict=True)
            ]
        )
        whole = torch.from_numpy(truth)[:, None]
        if exposures is None:
            return Views(self._seen(truth, seeds[mine], threads), whole)
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
        return Views(
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
        if self.network.bits is None:
            return None
        low, high = self.network.bits
        bits = round(math.exp(choice.uniform(math.log(low), math.log(high))))
        flux, usual, dark = (
            np.exp(choice.uniform(math.log(low), math.log(high), self.batch))
            for low, high in (FLUX, _USUAL, _DARK)
        )
        flux, dark = (
            np.where(choice.random(self.batch) < 0.5, often, other)
            for often, other in ((usual, flux), (0, dark))
        )
        return bits, flux, dark

    def _seen(
        self, truth: npt.NDArray[np.float32], seeds: list[np.random.SeedSequence], threads: int
    ) -> Tensor:
        side, tied = self.sensor.oversampling, self.network.tied
        seen = []
        for patch, seed in zip(truth, seeds, strict=True):
            bits = self.sensor.expose(patch, seed, threads=threads)
            counts = bits.counts(side, threads=threads)[None] if tied else bits.to_array()
            seen.append(counts.astype(np.float32))
        return torch.from_numpy(np.stack(seen))


def _turned(patch: npt.NDArray[np.float32], turn: int) -> npt.NDArray[np.float32]:
    """One of the eight symmetries of a square."""
    patch = np.rot90(patch, turn % 4)
    return patch.T if turn >= 4 else patch
