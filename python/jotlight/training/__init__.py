"""Learning the parameters of a network by error backpropagation (paper, section 3)."""

from jotlight.training.admissible import AdmissibleSet, SafeSet
from jotlight.training.cost import Cost
from jotlight.training.history import History, Record
from jotlight.training.loop import train
from jotlight.training.optimizers import (
    OPTIMIZERS,
    Adam,
    GaussNewton,
    Optimizer,
    ProjectedGradient,
    Step,
)
from jotlight.training.parameters import parameter_vector, split_vector, with_parameters

__all__ = [
    "OPTIMIZERS",
    "Adam",
    "AdmissibleSet",
    "Cost",
    "GaussNewton",
    "History",
    "Optimizer",
    "ProjectedGradient",
    "Record",
    "SafeSet",
    "Step",
    "parameter_vector",
    "split_vector",
    "train",
    "with_parameters",
]
