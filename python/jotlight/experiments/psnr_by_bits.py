"""What figures 6a and 6b share: PSNR against K before and after learning."""

import itertools
from collections.abc import Callable, Sequence

from jotlight.array_types import Image
from jotlight.datasets.fetch import Progress
from jotlight.estimators.mle import mle
from jotlight.experiments.experiment import Part, PartResult, Results, Row, RunContext
from jotlight.experiments.report.content import Claim, Column, Curves, Table, Verdict
from jotlight.experiments.report.curves import Axes, Line, render_svg
from jotlight.experiments.training_runs import (
    Scenes,
    paper_sensor,
    train_as_paper,
    train_by_default,
)
from jotlight.networks.network import Network
from jotlight.networks.pretrained import TRAINED_TRIALS
from jotlight.sensing.sensor import Sensor
from jotlight.training import GaussNewton

SETTINGS = {
    "bits": list(TRAINED_TRIALS),
    "sigmas": [0.25, 0.5, 0.6, 0.7, 1.0],
    "learning_steps": None,
    "learning_batch": None,
    "seed": 0,
    # The paper's own descent starts from the smallest σ.
    "descents": [9],
    "sigma": 0.25,
    "learning_rate": 5e-6,
    "steps": 10_000,
    "batch": 128,
}

QUICK_SETTINGS = {
    **SETTINGS,
    "bits": [9, 100],
    "learning_steps": 3,
    "learning_batch": 64,
    "steps": 30,
    "batch": 32,
}

TOLERANCE = 0.5
"""Maximum difference in dB from the paper's value that counts as reproduced."""

Measure = Callable[[Callable[..., Image], Sensor], float]
"""A function that returns the PSNR of a method for a sensor."""


def psnr_parts(
    context: RunContext,
    scenes: Callable[[], Scenes],
    measure: Measure,
    seconds: tuple[float, float],
) -> list[Part]:
    """Return one part for each K and one for each descent.

    The rows have the columns ``bits``, ``estimator`` ("mle", "initial", "learned", "descent"),
    ``sigma``, and ``psnr``. The two `seconds` are the durations of the two kinds of parts.
    """
    settings = context.settings

    def row(bits: int, estimator: str, sigma: float | None, run: Callable[..., Image]) -> Row:
        psnr = measure(run, paper_sensor(bits))
        return {"bits": bits, "estimator": estimator, "sigma": sigma, "psnr": psnr}

    def one_number_of_bits(bits: int) -> Callable[[Progress], PartResult]:
        def run(progress: Progress) -> PartResult:
            sensor = paper_sensor(bits)
            learned, _ = train_by_default(context, f"k{bits}", sensor, scenes(), progress)
            rows = [row(bits, "mle", None, mle)]
            for sigma in settings["sigmas"]:
                start = Network.initial(sensor, sigma=sigma)
                rows.append(row(bits, "initial", sigma, start.reconstruct))
            rows.append(row(bits, "learned", None, learned.reconstruct))
            return PartResult(rows)

        return run

    def one_descent(bits: int) -> Callable[[Progress], PartResult]:
        def run(progress: Progress) -> PartResult:
            name, sigma = f"descent-k{bits}", settings["sigma"]
            learned, _ = train_as_paper(context, name, scenes(), progress, bits, sigma)
            return PartResult([row(bits, "descent", sigma, learned.reconstruct)])

        return run

    return [
        *(Part(f"k{bits}", seconds[0], one_number_of_bits(bits)) for bits in settings["bits"]),
        *(Part(f"descent-k{bits}", seconds[1], one_descent(bits)) for bits in settings["descents"]),
    ]


def psnr_of(results: Results, bits: int, estimator: str, sigma: float | None = None) -> float:
    """Return the PSNR of one row."""
    return float(results.column("psnr", bits=bits, estimator=estimator, sigma=sigma)[0])


def gains(results: Results, sigma: float) -> dict[int, float]:
    """Return learned minus initial PSNR, by K."""
    return {
        bits: psnr_of(results, bits, "learned") - psnr_of(results, bits, "initial", sigma)
        for bits in results.settings["bits"]
    }


def limits_of(results: Results) -> dict[int, float] | None:
    """Return the PSNR that no estimator exceeds, by K, or None where it is unknown."""
    rows = results.rows_where(estimator="limit")
    return {int(row["bits"]): float(row["psnr"]) for row in rows} or None  # type: ignore[arg-type]


def psnr_table(results: Results) -> Table:
    """Return PSNR by K."""
    settings, limits = results.settings, limits_of(results)
    columns = [
        Column("K"),
        Column("MLE", ".2f"),
        *(Column(f"σ = {sigma}", ".2f") for sigma in settings["sigmas"]),
        Column("learned", ".3f" if limits else ".2f"),
    ]
    if limits:
        columns += [Column("limit", ".3f"), Column("from the limit", ".3f")]
    rows = []
    for bits in settings["bits"]:
        learned = psnr_of(results, bits, "learned")
        initial = [psnr_of(results, bits, "initial", sigma) for sigma in settings["sigmas"]]
        row = [bits, psnr_of(results, bits, "mle"), *initial, learned]
        if limits:
            row += [limits[bits], learned - limits[bits]]
        rows.append(row)
    return Table(
        "PSNR in dB by K: maximum likelihood, the initial network by its σ, the learned network",
        columns,
        rows,
    )


def descent_table(results: Results) -> Table:
    """Return what the paper's descent reaches beside jotlight's default training."""
    sigma, steps = results.settings["sigma"], results.settings["steps"]
    rows = []
    for bits in results.settings["descents"]:
        start = psnr_of(results, bits, "initial", sigma)
        end = psnr_of(results, bits, "descent", sigma)
        rows.append([bits, start, end, end - start, psnr_of(results, bits, "learned")])
    return Table(
        f"The paper's descent: {steps:,} steps of projected gradients from σ = {sigma}",
        [
            Column("K"),
            Column("initial, dB", ".2f"),
            Column("after the descent, dB", ".2f"),
            Column("gain, dB", ".2f"),
            Column("after jotlight's default training, dB", ".2f"),
        ],
        rows,
        f"The default training takes {results.settings['learning_steps'] or GaussNewton.steps} "
        "damped Gauss-Newton steps and needs no step size.",
    )


def psnr_curves(results: Results, name: str, title: str) -> Curves:
    """Return PSNR against K as curves."""
    settings, limits = results.settings, limits_of(results)
    bits: Sequence[int] = settings["bits"]
    lines = []
    # One hue marks the initial networks, so markers and styles tell them apart.
    looks = [("v", ":"), ("s", "-"), ("^", "-."), ("D", "--"), ("x", "-")]
    for (marker, style), sigma in zip(itertools.cycle(looks), settings["sigmas"]):
        y = [psnr_of(results, k, "initial", sigma) for k in bits]
        lines.append(
            Line(f"initial, σ = {sigma}", bits, y, color="#8b847c", marker=marker, style=style)
        )
    learned = [psnr_of(results, k, "learned") for k in bits]
    lines.append(Line("learned", bits, learned, color="#d55e00", marker="o"))
    if limits:
        limit = [limits[k] for k in bits]
        lines.append(Line("limit", bits, limit, color="#0072b2", style="--"))
    return Curves(name, title, render_svg([Axes(lines, "trials per pixel K", "PSNR, dB")]))


def every_gain_claim(results: Results, statement: str) -> Claim:
    """Return the claim that learning gains for every K."""
    lowest = {s: min(gains(results, s).values()) for s in results.settings["sigmas"]}
    found = ", ".join(f"{gain:.2f} dB over σ = {sigma}" for sigma, gain in lowest.items())
    gained = [sigma for sigma, gain in lowest.items() if gain > 0]
    return Claim(statement, f"Lowest gain over K: {found}.", *verdict_of(gained, list(lowest)))


def largest_gain_claim(results: Results, paper_gain: float) -> Claim:
    """Return the claim that the largest gain is `paper_gain` dB, for K = 9."""
    settings = results.settings
    every = {sigma: gains(results, sigma) for sigma in settings["sigmas"]}
    largest = {sigma: max(gain.values()) for sigma, gain in every.items()}
    found = ", ".join(
        f"{gain[9]:.2f} dB over σ = {sigma}"
        + ("" if gain[9] == largest[sigma] else f" ({largest[sigma]:.2f} for another K)")
        for sigma, gain in every.items()
    )
    holding = [
        sigma
        for sigma, gain in every.items()
        if abs(gain[9] - paper_gain) <= TOLERANCE and gain[9] == largest[sigma]
    ]
    result = f"By the default training, for K = 9: {found}."
    if 9 in settings["descents"]:
        start = psnr_of(results, 9, "initial", settings["sigma"])
        gain = psnr_of(results, 9, "descent", settings["sigma"]) - start
        result += f" By the paper's descent from σ = {settings['sigma']}: {gain:.2f} dB."
    return Claim(
        f"The largest gain is {paper_gain} dB, for K = 9.",
        result,
        *verdict_of(holding, list(every)),
    )


def verdict_of(holding: list[float], every: list[float]) -> tuple[Verdict, str]:
    """Return the verdict on a claim that holds for some of the initial σ, and the reason."""
    if len(holding) == len(every):
        return "reproduced", ""
    unknown_start = "The paper does not say which σ in [0.25, 1] it starts from."
    if not holding:
        return "not reproduced", f"{unknown_start} The claim holds for none of these."
    which = ", ".join(f"σ = {sigma}" for sigma in holding)
    return "in part", f"{unknown_start} The claim holds for {which} and not for the others."
