"""Learning the parameters of a network by error backpropagation (paper, section 3)."""

from jotlight.training.admissible import AdmissibleSet, SafeSet
from jotlight.training.cost import Cost
from jotlight.training.history import History, Record
from jotlight.training.loop import train
from jotlight.training.optimizers import (
    OPTIMISERS,
    Adam,
    GaussNewton,
    Optimiser,
    ProjectedGradient,
    Step,
)
from jotlight.training.parameters import network_of, parts_of, vector_of

__all__ = [
    "OPTIMISERS",
    "Adam",
    "AdmissibleSet",
    "Cost",
    "GaussNewton",
    "History",
    "Optimiser",
    "ProjectedGradient",
    "Record",
    "SafeSet",
    "Step",
    "network_of",
    "parts_of",
    "train",
    "vector_of",
]
