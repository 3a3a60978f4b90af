"""Training of networks in the engine by error backpropagation (paper, section 3).

:func:`train` trains a network of two layers on photographs. :class:`PhotographPatches` and other
sources of patches feed :func:`jotlight.torch.train`, which trains deep networks.

The modules, in reading order: `train` (the function), `run` (its settings, steps, and result),
`patches` and `images` (training examples), `cost` (the objective and its gradient), `parameters`
(all parameters as one vector), `admissible` (the set that they stay in), `optimizer_protocol`,
`optimizers`, and `gauss_newton` (steps), `history` and `checkpoint` (records and state of a run),
`reporting` and `figure` (its progress and its curves). `patch_sources`, `photographs`,
`url_photographs`, `synthetic_patches`, `color_patches` and `color_drawings` (both with
`random_mosaics`), and `film_patches` are sources of patches for :func:`jotlight.torch.train`.
"""

from jotlight.training.admissible import AdmissibleSet, SafeSet
from jotlight.training.color_drawings import ColorDrawings
from jotlight.training.color_patches import ColorPatches
from jotlight.training.cost import Cost
from jotlight.training.film_patches import FilmExample, FilmPatches
from jotlight.training.gauss_newton import GaussNewton
from jotlight.training.history import History, Record
from jotlight.training.optimizer_protocol import Optimizer, Step
from jotlight.training.optimizers import OPTIMIZERS, Adam, ProjectedGradient
from jotlight.training.parameters import parameter_vector, split_vector, with_parameters
from jotlight.training.patch_sources import (
    GeneratedPatches,
    ImagePatches,
    Patch,
    PatchMixture,
    PatchSource,
)
from jotlight.training.photographs import PhotographPatches, read_photographs
from jotlight.training.random_mosaics import random_mosaic
from jotlight.training.synthetic_patches import SyntheticPatches
from jotlight.training.train import train
from jotlight.training.url_photographs import UrlPhotographs

__all__ = [
    "OPTIMIZERS",
    "Adam",
    "AdmissibleSet",
    "ColorDrawings",
    "ColorPatches",
    "Cost",
    "FilmExample",
    "FilmPatches",
    "GaussNewton",
    "GeneratedPatches",
    "History",
    "ImagePatches",
    "Optimizer",
    "Patch",
    "PatchMixture",
    "PatchSource",
    "PhotographPatches",
    "ProjectedGradient",
    "Record",
    "SafeSet",
    "Step",
    "SyntheticPatches",
    "UrlPhotographs",
    "parameter_vector",
    "random_mosaic",
    "read_photographs",
    "split_vector",
    "train",
    "with_parameters",
]


def __dir__() -> list[str]:
    return __all__
