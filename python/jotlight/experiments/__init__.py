"""The experiments of the paper's section 4, and one more: where each method wins.

- `experiment`: what an experiment is: settings, parts, results.
- `fig5`, `fig6a`, `fig6b`, `fig7`, `timing`: a figure or table of the paper. `gain` goes beyond it.
- `psnr_by_bits`: what figures 6a and 6b share.
- `training_runs`: the networks that the experiments train.
- `posterior_mean`: the PSNR that no estimator exceeds on synthetic scenes.
- `bsds_methods`: the methods that `fig7` and `gain` run, and crops of the images.
- `method_titles`: titles of the methods in tables and figures.
- `runner`, `tables`: running parts, keeping their results, and CSV files.
- `png`: images as PNG.
- `report`: from results to pages and figures.
"""

from jotlight.experiments import fig5, fig6a, fig6b, fig7, gain, timing
from jotlight.experiments.experiment import Experiment

EXPERIMENTS: dict[str, Experiment] = {
    module.EXPERIMENT.name: module.EXPERIMENT for module in (fig5, fig6a, fig6b, fig7, timing, gain)
}
"""The experiments by name, in the order of the paper."""

__all__ = ["EXPERIMENTS", "Experiment"]


def __dir__() -> list[str]:
    return __all__
