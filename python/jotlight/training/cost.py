"""The cost of the examples of one step, for the optimizers to look at."""

from typing import Any

import numpy as np
import numpy.typing as npt

import jotlight._engine as engine
from jotlight.networks.network import Network
from jotlight.training.admissible import AdmissibleSet
from jotlight.training.parameters import Vector, engine_layers
from jotlight.training.patches import PatchSampler

_LARGE = 96
"""Pixels: the side of a patch past which JᵀJ looks at a part of it."""


class Cost:
    """ε of equation (12) on the patches and bits of one step: the mean of ½‖ĉ - c‖² of a patch.

    The bits are drawn where the cost is found, always the same in one step.
    """

    def __init__(
        self,
        network: Network,
        examples: PatchSampler,
        step: int,
        steps: int,
        admissible: AdmissibleSet,
        threads: int | None,
    ) -> None:
        self.network = network
        """Gives the shapes of the parameters."""
        self.step = step
        """The number of the step, from 0."""
        self.steps = steps
        """How many steps the run has."""
        self._batch = examples.batch(step)
        self._admissible = admissible
        self._threads = threads

    def value(self, vector: Vector) -> float:
        """Give ε."""
        errors, _ = engine.squared_errors(self._layers(vector), self._batch, self._threads)
        return 0.5 * float(errors.mean())

    def gradient(self, vector: Vector) -> tuple[float, Vector]:
        """Give ε and ∇ε: equations (14) to (19)."""
        (errors, _), gradient = engine.gradient(self._layers(vector), self._batch, self._threads)
        return 0.5 * float(errors.mean()), gradient

    def normal_equations(self, vector: Vector) -> tuple[float, Vector, npt.NDArray[np.float64]]:
        """Give ε, ∇ε and the mean of JᵀJ, with J the Jacobian (15) of a patch.

        The matrix takes some hundred times as long as the gradient and need not be as exact. So it
        is that of one patch in 8, but of 32 at least, and of no more than 96 x 96 pixels of each,
        brought to the size of all.
        """
        layers = self._layers(vector)
        (errors, pixels), gradient = engine.gradient(layers, self._batch, self._threads)
        part = {**self._batch, "patches": self._cut_patches()}
        (_, few), _, matrix = engine.normal_equations(layers, part, self._threads)
        scale = pixels.mean() / max(few.mean(), 1)
        return 0.5 * float(errors.mean()), gradient, scale * matrix

    def _cut_patches(self) -> npt.NDArray[np.int64]:
        """Patches for the matrix: image, rows, columns; those that are large are cut at random."""
        patches: npt.NDArray[np.int64] = self._batch["patches"]
        patches = patches[: max(32, len(patches) // 8)].copy()
        choice = np.random.default_rng([self.step, len(patches)])
        for first, last in ((1, 2), (3, 4)):
            spare = np.maximum(patches[:, last] - patches[:, first] - _LARGE, 0)
            patches[:, first] += choice.integers(spare + 1)
            patches[:, last] = np.minimum(patches[:, last], patches[:, first] + _LARGE)
        return patches

    def project(self, vector: Vector) -> Vector:
        """Give the nearest point of 𝒜."""
        return self._admissible.project(self.network, vector)

    def _layers(self, vector: Vector) -> Any:
        return engine_layers(self.network, vector)


def mean_psnr(
    network: Network, vector: Vector, images: dict[str, Any], threads: int | None
) -> float:
    """Mean PSNR in dB, for a peak of 1, of the images of :meth:`PatchSampler.whole_images`."""
    errors, pixels = engine.squared_errors(engine_layers(network, vector), images, threads)
    return float(np.mean(10 * np.log10(pixels / np.maximum(errors, 1e-300))))
