"""The training cost of one step, with its gradient and normal equations."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.array_types import Array
from jotlight.networks.network import Network
from jotlight.training.admissible import AdmissibleSet
from jotlight.training.parameters import engine_layers
from jotlight.training.patches import PatchSampler

_MATRIX_SIDE = 96
"""Largest height and width, in pixels, of the patches that the normal equations use."""

_MIN_MATRIX_PATCHES = 32
"""Smallest number of patches that the normal equations use."""


class Cost:
    """The cost ε of equation (12) on the patches and bits of one step: the mean of ½‖ĉ - c‖².

    Every evaluation draws the same bits.

    Parameters
    ----------
    network : Network
        Network that defines the shapes of the parameters.
    sampler : PatchSampler
        Source of the patches.
    step, steps : int
        Number of the step, from 0, and number of all steps of the run.
    admissible : AdmissibleSet
        𝒜.
    threads : int or None
        The number of threads. Default: the number of cores.
    """

    def __init__(
        self,
        network: Network,
        sampler: PatchSampler,
        step: int,
        steps: int,
        admissible: AdmissibleSet,
        threads: int | None,
    ) -> None:
        self.network = network
        self.step = step
        self.steps = steps
        self._batch = sampler.batch(step)
        self._admissible = admissible
        self._threads = threads

    def value(self, vector: Array) -> float:
        """Return ε."""
        errors, _ = engine.squared_errors(self._layers(vector), self._batch, self._threads)
        return 0.5 * float(errors.mean())

    def gradient(self, vector: Array) -> tuple[float, Array]:
        """Return ε and ∇ε, equations (14) to (19)."""
        (errors, _), gradient = engine.gradient(self._layers(vector), self._batch, self._threads)
        return 0.5 * float(errors.mean()), gradient

    def normal_equations(self, vector: Array) -> tuple[float, Array, npt.NDArray[np.float64]]:
        """Return ε, ∇ε, and the mean of JᵀJ over patches, with the Jacobian J of equation (15).

        The matrix would take about a hundred times as long as the gradient, but may be less exact.
        So it uses only an eighth of the patches, but at least 32, and at most 96 × 96 pixels of
        each. It is scaled to the number of all pixels.
        """
        layers = self._layers(vector)
        (errors, pixels), gradient = engine.gradient(layers, self._batch, self._threads)
        part = {**self._batch, "patches": self._matrix_patches()}
        (_, part_pixels), _, matrix = engine.normal_equations(layers, part, self._threads)
        scale = pixels.mean() / max(part_pixels.mean(), 1)
        return 0.5 * float(errors.mean()), gradient, scale * matrix

    def project(self, vector: Array) -> Array:
        """Return the nearest point of 𝒜."""
        return self._admissible.project(self.network, vector)

    def _matrix_patches(self) -> npt.NDArray[np.int64]:
        """Return the patches for the matrix, as (image, rows, columns); large ones are cropped."""
        patches: npt.NDArray[np.int64] = self._batch["patches"]
        patches = patches[: max(_MIN_MATRIX_PATCHES, len(patches) // 8)].copy()
        choice = np.random.default_rng([self.step, len(patches)])
        for first, last in ((1, 2), (3, 4)):
            spare = np.maximum(patches[:, last] - patches[:, first] - _MATRIX_SIDE, 0)
            patches[:, first] += choice.integers(spare + 1)
            patches[:, last] = np.minimum(patches[:, last], patches[:, first] + _MATRIX_SIDE)
        return patches

    def _layers(self, vector: Array) -> Any:
        return engine_layers(self.network, vector)


def mean_psnr(
    network: Network, vector: Array, images: dict[str, Any], threads: int | None
) -> float:
    """Return the mean PSNR in dB, for a peak of 1; `PatchSampler.whole_images` makes `images`."""
    errors, pixels = engine.squared_errors(engine_layers(network, vector), images, threads)
    return float(np.mean(10 * np.log10(pixels / np.maximum(errors, 1e-300))))
