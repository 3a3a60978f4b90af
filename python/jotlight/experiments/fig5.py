"""Figure 5: cost and gradient norm along the paper's own descent."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from jotlight.datasets import uniform_scenes
from jotlight.datasets.fetch import Progress
from jotlight.experiments.experiment import (
    Experiment,
    Part,
    PartResult,
    Results,
    RunContext,
    command_of,
)
from jotlight.experiments.psnr_by_bits import verdict_of
from jotlight.experiments.report.content import Claim, Column, Curves, Section, Table
from jotlight.experiments.report.curves import Axes, Line, render_svg
from jotlight.experiments.training_runs import train_as_paper

SETTINGS = {
    "bits": 36,
    "learning_rate": 5e-6,
    "steps": 10_000,
    "batch": 128,
    "sigmas": [0.25, 0.7],
    "seed": 0,
    "window": 1000,
}

_MINOR_RISE = 0.02
"""Maximum rise of a later window's mean, as a share of the first window's mean."""

_COLORS = ("#2f6fb7", "#d55e00")

_MAX_POINTS = 1000
"""Approximate number of iterations that the figure shows."""


def parts(context: RunContext) -> list[Part]:
    """Return one descent from each σ."""
    settings = context.settings

    def descent(sigma: float) -> Callable[[Progress], PartResult]:
        def run(progress: Progress) -> PartResult:
            name = f"descent-{sigma}"
            _, history = train_as_paper(
                context, name, uniform_scenes, progress, settings["bits"], sigma
            )
            columns = zip(history.loss, history.gradient_norm, strict=True)
            return PartResult(
                [
                    {"sigma": sigma, "iteration": step, "cost": cost, "gradient_norm": norm}
                    for step, (cost, norm) in enumerate(columns)
                ]
            )

        return run

    return [Part(f"descent-{sigma}", 220, descent(sigma)) for sigma in settings["sigmas"]]


def section(results: Results) -> Section:
    """Return both curves from each σ, and their means over windows."""
    settings = results.settings
    sigmas = settings["sigmas"]
    means = {sigma: _window_means(results, sigma) for sigma in sigmas}
    return Section(
        EXPERIMENT.name,
        EXPERIMENT.title,
        f"Projected gradient descent, equation (13), with a weight for each jot in h1, as in the "
        f"paper: {settings['steps']:,} steps of size μ = {settings['learning_rate']:g}, each on "
        f"{settings['batch']} new scenes of 32 × 32 with intensities uniform in [0, 1], K = α = "
        f"{settings['bits']}. The paper takes the σ of the initial h2 from [0.25, 1] and does not "
        f"say which. This experiment uses σ = {sigmas[0]}, which leaves the pixels nearly as they "
        f"are, and σ = {sigmas[1]}.",
        command_of(EXPERIMENT.name, settings),
        ["fig5.csv"],
        claims=[_claim(settings["window"], means)],
        tables=[_table(settings["window"], sigma, means[sigma]) for sigma in sigmas],
        curves=[_curves(results)],
    )


def _table(window: int, sigma: float, means: npt.NDArray[np.float64]) -> Table:
    return Table(
        f"From σ = {sigma}, means over windows of {window:,} iterations",
        [
            Column("from iteration"),
            Column("cost ε", ".3f"),
            Column("gradient norm ‖∇ε‖", ".2f"),
            Column("ε varies by, %", ".2f"),
            Column("‖∇ε‖ varies by, %", ".1f"),
        ],
        [[row * window, *map(float, mean)] for row, mean in enumerate(means)],
        "The last two columns are standard deviations around the window's trend, as shares of "
        "the mean.",
    )


def _curves(results: Results) -> Curves:
    settings = results.settings
    step = max(1, settings["steps"] // _MAX_POINTS)

    def line(column: str, sigma: float, color: str) -> Line:
        x, y = (results.column(name, sigma=sigma)[::step] for name in ("iteration", column))
        return Line(f"σ = {sigma}", x, y, color=color, width=0.5)

    axes = [
        Axes(
            [line(column, *pair) for pair in zip(settings["sigmas"], _COLORS, strict=True)],
            x_label="iteration",
            y_label=label,
            y_log=column == "gradient_norm",
        )
        for column, label in (("cost", "cost ε"), ("gradient_norm", "gradient norm ‖∇ε‖"))
    ]
    return Curves(
        "fig5",
        "Cost and gradient norm per iteration",
        render_svg(axes),
        f"Every {step}th iteration." if step > 1 else "",
    )


def _window_means(results: Results, sigma: float) -> npt.NDArray[np.float64]:
    """Return mean cost, mean gradient norm, and by how many percent each varies, per window."""
    window = results.settings["window"]
    cost = results.column("cost", sigma=sigma)
    norm = results.column("gradient_norm", sigma=sigma)
    rows = []
    for first in range(0, results.settings["steps"], window):
        part = slice(first, first + window)
        varies = [100 * _oscillation(values[part]) for values in (cost, norm)]
        rows.append((cost[part].mean(), norm[part].mean(), *varies))
    return np.array(rows)


def _claim(window: int, means: dict[float, npt.NDArray[np.float64]]) -> Claim:
    rises = {sigma: _largest_rise(mean[:, :2]) for sigma, mean in means.items()}
    sentences = [
        f"From σ = {sigma}, by means over {window:,} iterations: the cost goes from "
        f"{mean[0, 0]:.2f} to {mean[-1, 0]:.2f} and the gradient norm from {mean[0, 1]:.1f} to "
        f"{mean[-1, 1]:.1f}; the largest rise in between is {100 * rises[sigma][0]:.1f} % and "
        f"{100 * rises[sigma][1]:.1f} % of the initial values. In the last window they vary by "
        f"{mean[-1, 2]:.1f} % and {mean[-1, 3]:.0f} % of their means."
        for sigma, mean in means.items()
    ]
    falling = [sigma for sigma, rise in rises.items() if rise.max() < _MINOR_RISE]
    return Claim(
        "Cost and gradient norm decrease along the iterations, with minor oscillations "
        "(figure 5, K = 36, 10⁴ iterations).",
        " ".join(sentences),
        *verdict_of(falling, list(means)),
    )


def _largest_rise(means: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return by how much a window's mean exceeds any earlier one, as a share of the first."""
    rise = np.max(means - np.minimum.accumulate(means), axis=0)
    return np.asarray(rise / means[0])


def _oscillation(values: npt.NDArray[np.float64]) -> float:
    """Return the standard deviation about the line through a window, as a share of the mean."""
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
