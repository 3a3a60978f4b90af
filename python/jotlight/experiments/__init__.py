"""The paper's figures, its table of times, and one comparison more: one file for each."""

from jotlight.experiments import fig5, fig6a, fig6b, fig7, gain, timing
from jotlight.experiments.experiment import Experiment

EXPERIMENTS: dict[str, Experiment] = {
    module.EXPERIMENT.name: module.EXPERIMENT for module in (fig5, fig6a, fig6b, fig7, timing, gain)
}
"""The experiments by name, in the order of the paper."""

__all__ = ["EXPERIMENTS", "Experiment"]
