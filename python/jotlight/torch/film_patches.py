"""Batches of patches of films, for film networks."""

import numpy as np
import torch
from torch import Tensor

from jotlight.networks.planes.film_planes import START
from jotlight.networks.planes.planes_layers import CENTER
from jotlight.torch.network import Network as TorchNetwork
from jotlight.torch.patches import Batch, PatchLoader
from jotlight.training.film_patches import FilmPatches

_MIN_ERROR = 0.003
"""Smallest error of the estimates to which errors are relative."""


class FilmBatch(Batch):
    """N patches of films, whose errors are relative to those of the estimates they improve.

    Otherwise, scenes that no motion explains would have nearly all of the error.
    """

    def squared_errors(self, module: TorchNetwork) -> Tensor:
        """Return the mean square error of each patch, relative to that of the estimate, (N,)."""
        start = self.errors_of(self.data[:, START, None] + CENTER)
        return super().squared_errors(module) / start.clamp(min=_MIN_ERROR)


class FilmPatchLoader(PatchLoader):
    """A source of batches for a film network.

    Examples
    --------
    >>> from jotlight.training.film_patches import FilmExample
    >>> source = FilmPatches([FilmExample(np.zeros((14, 8, 8)), np.zeros((8, 8)), 64.0, 0.4)])
    >>> network = jl.FilmNetwork.initial("small", rng=0)
    >>> loader = FilmPatchLoader(source, network, jl.Sensor(), seed=0, batch_size=2, side=8)
    >>> batch = loader.batch(step=0, shard=slice(None), threads=1)
    >>> batch.data.shape, batch.truth.shape, batch.trials
    (torch.Size([2, 14, 8, 8]), torch.Size([2, 1, 8, 8]), 64)
    """

    def batch(self, step: int, shard: slice, threads: int) -> Batch:
        """Return the batch of a step, or the patches of one process.

        The parameters are those of :meth:`jotlight.torch.patches.PatchLoader.batch`.
        """
        if not isinstance(self.source, FilmPatches):
            raise ValueError(
                "images: expected jotlight.training.FilmPatches for a film network, got "
                f"{type(self.source).__name__}"
            )
        rng = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(step, 0)))
        drawn = self.source.draw_similar(rng, self.side, self.batch_size)
        trials = float(np.exp(np.mean([np.log(each.trials) for each in drawn])))
        drawn = drawn[shard]
        assert self.network.trials_range is not None
        light = np.array([each.light_per_intensity for each in drawn], np.float32)
        return FilmBatch(
            torch.from_numpy(np.stack([each.planes for each in drawn])),
            torch.from_numpy(np.stack([each.truth for each in drawn])[:, None]),
            round(float(np.clip(trials, *self.network.trials_range))),
            torch.from_numpy(light),
            torch.zeros(len(drawn)),
        )
