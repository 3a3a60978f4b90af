"""Figures 6a and 6b share this: PSNR against K before and after learning."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

import jotlight as jl
from jotlight.experiments.experiment import Lab, Outcome, Part, Results, Row, Update
from jotlight.experiments.learning import Scenes, descend, learn, sensor_of
from jotlight.experiments.report.curves import Axes, Line, draw
from jotlight.experiments.report.section import Claim, Column, Curves, Table, Verdict
from jotlight.networks.pretrained import BITS_PER_PIXEL
from jotlight.training import GaussNewton

SETTINGS = {
    "bits": list(BITS_PER_PIXEL),
    "sigmas": [0.25, 0.5, 0.6, 0.7, 1.0],
    "learning_steps": None,
    "learning_batch": None,
    "seed": 0,
    # The paper's own descent, from its least σ.
    "descents": [9],
    "sigma": 0.25,
    "learning_rate": 5e-6,
    "steps": 10_000,
    "batch": 128,
}

QUICK = {
    **SETTINGS,
    "bits": [9, 100],
    "learning_steps": 3,
    "learning_batch": 64,
    "steps": 30,
    "batch": 32,
}

Image = npt.NDArray[np.float32]
Measure = Callable[[Callable[..., Image], jl.Sensor], float]


def parts(
    lab: Lab, scenes: Callable[[], Scenes], measure: Measure, seconds: tuple[float, float]
) -> list[Part]:
    """One part for each K, and one for each descent; `seconds` are those of the two kinds.

    The rows have the columns ``bits``, ``estimator`` ("mle", "initial", "learned", "descent"),
    ``sigma`` and ``psnr``.
    """

    def row(bits: int, estimator: str, sigma: float | None, run: Callable[..., Image]) -> Row:
        psnr = measure(run, sensor_of(bits))
        return {"bits": bits, "estimator": estimator, "sigma": sigma, "psnr": psnr}

    def one_number_of_bits(bits: int) -> Callable[[Update], Outcome]:
        def run(update: Update) -> Outcome:
            sensor = sensor_of(bits)
            learned, _ = learn(lab, f"k{bits}", sensor, scenes(), update)
            rows = [row(bits, "mle", None, jl.mle)]
            for sigma in lab.settings["sigmas"]:
                start = jl.Network.initial(sensor, sigma=sigma)
                rows.append(row(bits, "initial", sigma, start.reconstruct))
            rows.append(row(bits, "learned", None, learned.reconstruct))
            return Outcome(rows)

        return run

    def one_descent(bits: int) -> Callable[[Update], Outcome]:
        def run(update: Update) -> Outcome:
            sigma = lab.settings["sigma"]
            learned, _ = descend(lab, f"descent-k{bits}", scenes(), update, bits, sigma)
            return Outcome([row(bits, "descent", sigma, learned.reconstruct)])

        return run

    settings = lab.settings
    return [
        *(Part(f"k{bits}", seconds[0], one_number_of_bits(bits)) for bits in settings["bits"]),
        *(Part(f"descent-k{bits}", seconds[1], one_descent(bits)) for bits in settings["descents"]),
    ]


def psnr(results: Results, bits: int, estimator: str, sigma: float | None = None) -> float:
    """Give one number of the rows."""
    return float(results.numbers("psnr", bits=bits, estimator=estimator, sigma=sigma)[0])


def gains(results: Results, sigma: float) -> dict[int, float]:
    """Learned less initial PSNR, by K."""
    return {
        bits: psnr(results, bits, "learned") - psnr(results, bits, "initial", sigma)
        for bits in results.settings["bits"]
    }


def limits_of(results: Results) -> dict[int, float] | None:
    """PSNR that no estimator passes, by K, where it is known."""
    rows = results.where(estimator="limit")
    return {int(row["bits"]): float(row["psnr"]) for row in rows} or None  # type: ignore[arg-type]


def table(results: Results) -> Table:
    """PSNR by K."""
    settings, limits = results.settings, limits_of(results)
    columns = [
        Column("K"),
        Column("MLE", 2),
        *(Column(f"σ = {sigma}", 2) for sigma in settings["sigmas"]),
        Column("learned", 3 if limits else 2),
    ]
    if limits:
        columns += [Column("limit", 3), Column("from the limit", 3)]
    rows = []
    for bits in settings["bits"]:
        learned = psnr(results, bits, "learned")
        initial = [psnr(results, bits, "initial", sigma) for sigma in settings["sigmas"]]
        row = [bits, psnr(results, bits, "mle"), *initial, learned]
        if limits:
            row += [limits[bits], learned - limits[bits]]
        rows.append(row)
    return Table(
        "PSNR in dB by K: maximum likelihood, the initial network by its σ, the learned one",
        columns,
        rows,
    )


def descents(results: Results) -> Table:
    """What the paper's descent reaches beside our recipe."""
    sigma, steps = results.settings["sigma"], results.settings["steps"]
    rows = []
    for bits in results.settings["descents"]:
        start = psnr(results, bits, "initial", sigma)
        end = psnr(results, bits, "descent", sigma)
        rows.append([bits, start, end, end - start, psnr(results, bits, "learned")])
    return Table(
        f"The paper's descent: {steps:,} steps of projected gradients from σ = {sigma}",
        [
            Column("K"),
            Column("initial, dB", 2),
            Column("after the descent, dB", 2),
            Column("gain, dB", 2),
            Column("learned by our recipe, dB", 2),
        ],
        rows,
        f"Our recipe takes {results.settings['learning_steps'] or GaussNewton.steps} damped "
        "Gauss-Newton steps and needs no step size.",
    )


def curves(results: Results, name: str, title: str) -> Curves:
    """PSNR against K."""
    settings, limits = results.settings, limits_of(results)
    bits: Sequence[int] = settings["bits"]
    lines = []
    shades = ["#a9a29a", "#9a938b", "#8b847c", "#7d766e", "#706961"]
    for shade, sigma in zip(itertools.cycle(shades), settings["sigmas"]):
        y = [psnr(results, k, "initial", sigma) for k in bits]
        lines.append(Line(f"initial, σ = {sigma}", bits, y, color=shade, marker="."))
    learned = [psnr(results, k, "learned") for k in bits]
    lines.append(Line("learned", bits, learned, color="#d55e00", marker="o"))
    if limits:
        limit = [limits[k] for k in bits]
        lines.append(Line("limit", bits, limit, color="#0072b2", dashed=True))
    return Curves(name, title, draw([Axes(lines, x="bits per pixel K", y="PSNR, dB")]))


def every_gain_claim(results: Results, said: str) -> Claim:
    """That learning gains for every K."""
    lowest = {s: min(gains(results, s).values()) for s in results.settings["sigmas"]}
    words = ", ".join(f"{gain:.2f} dB over σ = {sigma}" for sigma, gain in lowest.items())
    gained = [sigma for sigma, gain in lowest.items() if gain > 0]
    return Claim(said, f"Least gain of any K: {words}.", *verdict_of(gained, list(lowest)))


def largest_gain_claim(results: Results, paper: float) -> Claim:
    """That the largest gain is so many dB, for K = 9."""
    settings = results.settings
    every = {sigma: gains(results, sigma) for sigma in settings["sigmas"]}
    most = {sigma: max(gain.values()) for sigma, gain in every.items()}
    words = ", ".join(
        f"{gain[9]:.2f} dB over σ = {sigma}"
        + ("" if gain[9] == most[sigma] else f" ({most[sigma]:.2f} for another K)")
        for sigma, gain in every.items()
    )
    holding = [
        sigma
        for sigma, gain in every.items()
        if abs(gain[9] - paper) <= TOLERANCE and gain[9] == most[sigma]
    ]
    found = f"By our recipe, for K = 9: {words}."
    if 9 in settings["descents"]:
        start = psnr(results, 9, "initial", settings["sigma"])
        gain = psnr(results, 9, "descent", settings["sigma"]) - start
        found += f" By the paper's descent from σ = {settings['sigma']}: {gain:.2f} dB."
    return Claim(
        f"The largest gain is {paper} dB, for K = 9.", found, *verdict_of(holding, list(every))
    )


TOLERANCE = 0.5
"""dB by which a figure may differ from the paper's and still count as reproduced."""


def verdict_of(holding: list[float], every: list[float]) -> tuple[Verdict, str]:
    """Give the verdict on a claim that holds for some of the starts, and why."""
    if len(holding) == len(every):
        return "reproduced", ""
    open_ = "The paper does not say which σ in [0.25, 1] it starts from."
    if not holding:
        return "not reproduced", f"{open_} It holds for none of these."
    which = " and ".join(f"σ = {sigma}" for sigma in holding)
    return "in part", f"{open_} It holds for {which} and not for the others."
