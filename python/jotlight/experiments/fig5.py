"""Figure 5: cost and gradient norm along the paper's own descent."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight import datasets
from jotlight.experiments.by_bits import verdict_of
from jotlight.experiments.experiment import Experiment, Lab, Outcome, Part, Results, Update
from jotlight.experiments.learning import descend
from jotlight.experiments.report.curves import Axes, Line, draw
from jotlight.experiments.report.section import Claim, Column, Curves, Section, Table

SETTINGS = {
    "bits": 36,
    "learning_rate": 5e-6,
    "steps": 10_000,
    "batch": 128,
    "sigmas": [0.25, 0.7],
    "seed": 0,
    "window": 1000,
}

_MINOR = 0.02
"""Share of the first window's mean by which that of a later one may rise."""

_COLOURS = ("#2f6fb7", "#d55e00")


def parts(lab: Lab) -> list[Part]:
    """One descent from each σ."""

    def one_descent(sigma: float) -> Callable[[Update], Outcome]:
        def run(update: Update) -> Outcome:
            name, bits = f"descent-{sigma}", lab.settings["bits"]
            _, history = descend(lab, name, datasets.uniform_scenes, update, bits, sigma)
            columns = zip(history.loss, history.gradient_norm, strict=True)
            return Outcome(
                [
                    {"sigma": sigma, "iteration": step, "cost": cost, "gradient_norm": norm}
                    for step, (cost, norm) in enumerate(columns)
                ]
            )

        return run

    return [Part(f"descent-{sigma}", 220, one_descent(sigma)) for sigma in lab.settings["sigmas"]]


def section(results: Results) -> Section:
    """Both curves from each σ, and their means over windows."""
    settings = results.settings
    sigmas = settings["sigmas"]
    means = {sigma: _windows(results, sigma) for sigma in sigmas}
    every = max(1, settings["steps"] // 1000)
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        f"Projected gradient descent, equation (13), with a weight for each jot in h1, as in the "
        f"paper: {settings['steps']:,} steps of size μ = {settings['learning_rate']:g}, each on "
        f"{settings['batch']} new scenes of 32 × 32 with intensities uniform in [0, 1], K = α = "
        f"{settings['bits']}. The paper takes the σ of the initial h2 from [0.25, 1] and does not "
        f"say which; here are σ = {sigmas[0]}, which leaves the pixels nearly as they are, and "
        f"σ = {sigmas[1]}.",
        "jotlight reproduce fig5",
        claims=[_claim(settings["window"], means)],
        tables=[
            Table(
                f"From σ = {sigma}, means over windows of {settings['window']:,} iterations",
                [
                    Column("from iteration"),
                    Column("cost ε", 3),
                    Column("gradient norm ‖∇ε‖", 2),
                    Column("ε varies by, %", 2),
                    Column("‖∇ε‖ varies by, %", 1),
                ],
                [[row * settings["window"], *mean] for row, mean in enumerate(means[sigma])],
                "The last two are standard deviations around the window's trend, as shares of the "
                "mean.",
            )
            for sigma in sigmas
        ],
        curves=[
            Curves(
                "fig5",
                "Cost and gradient norm per iteration",
                draw(
                    [
                        Axes(
                            [
                                Line(
                                    f"σ = {sigma}",
                                    results.numbers("iteration", sigma=sigma)[::every],
                                    results.numbers(column, sigma=sigma)[::every],
                                    color=color,
                                    width=0.5,
                                )
                                for sigma, color in zip(sigmas, _COLOURS, strict=True)
                            ],
                            x="iteration",
                            y=y,
                            y_log=column == "gradient_norm",
                        )
                        for column, y in (
                            ("cost", "cost ε"),
                            ("gradient_norm", "gradient norm ‖∇ε‖"),
                        )
                    ]
                ),
                f"Every {every}th iteration." if every > 1 else "",
            )
        ],
    )


def _windows(results: Results, sigma: float) -> npt.NDArray[np.float64]:
    """Mean cost and gradient norm, and by how many percent each varies, by window."""
    window = results.settings["window"]
    cost = results.numbers("cost", sigma=sigma)
    norm = results.numbers("gradient_norm", sigma=sigma)
    rows = []
    for first in range(0, results.settings["steps"], window):
        part = slice(first, first + window)
        varies = [100 * _oscillation(values[part]) for values in (cost, norm)]
        rows.append((cost[part].mean(), norm[part].mean(), *varies))
    return np.array(rows)


def _claim(window: int, means: dict[float, npt.NDArray[np.float64]]) -> Claim:
    rises = {sigma: _largest_rise(mean[:, :2]) for sigma, mean in means.items()}
    words = [
        f"From σ = {sigma}, by means over {window:,} iterations: the cost goes from "
        f"{mean[0, 0]:.2f} to {mean[-1, 0]:.2f} and the gradient norm from {mean[0, 1]:.1f} to "
        f"{mean[-1, 1]:.1f}; the largest rise in between is {100 * rises[sigma][0]:.1f} % and "
        f"{100 * rises[sigma][1]:.1f} % of where they began. In the last window they vary by "
        f"{mean[-1, 2]:.1f} % and {mean[-1, 3]:.0f} % of their means."
        for sigma, mean in means.items()
    ]
    falling = [sigma for sigma, rise in rises.items() if rise.max() < _MINOR]
    return Claim(
        "Cost and gradient norm decrease along the iterations, with minor oscillations "
        "(figure 5, K = 36, 10⁴ iterations).",
        " ".join(words),
        *verdict_of(falling, list(means)),
    )


def _largest_rise(means: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """By how much a window's mean exceeds that of any before, as a share of the first."""
    rise = np.max(means - np.minimum.accumulate(means), axis=0)
    return np.asarray(rise / means[0])


def _oscillation(values: npt.NDArray[np.float64]) -> float:
    """Standard deviation about the line through a window, as a share of the mean."""
    if len(values) < 3:
        return 0.0
    step = np.arange(len(values))
    line = np.polyval(np.polyfit(step, values, 1), step)
    return float(np.std(values - line) / values.mean())


EXPERIMENT = Experiment(
    "fig5",
    "Figure 5: the descent",
    SETTINGS,
    {**SETTINGS, "steps": 40, "window": 10},
    parts,
    section,
)
